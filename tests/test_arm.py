"""The arm in pybullet goes where it is told, and nothing can poison it."""

import numpy as np
import pybullet as p
import pytest

from vita.errors import BadInput
from vita.scenario.library import welcome
from vita.sim.arm import STEP_S, Arm, apply_dead_band
from vita.sim.camera import PinholeCamera, camera_pose
from vita.sim.robots import ROBOTS, load_robot
from vita.sim.world import World
from vita.types import JointStep


@pytest.fixture
def client():
    number = p.connect(p.DIRECT)
    yield number
    p.disconnect(number)


def limits(model) -> tuple[np.ndarray, np.ndarray]:
    return np.array([j.lower for j in model.joints]), np.array([j.upper for j in model.joints])


@pytest.mark.parametrize("name", ROBOTS)
def test_pybullet_stands_where_the_dh_chain_says(client, name):
    """Position of the last frame and of all links within 1e-6 m at 300 random poses."""
    model = load_robot(name)
    assert model.chain is not None
    arm = Arm(client, model)
    rng = np.random.default_rng(5)
    for _ in range(300):
        q = rng.uniform(*limits(model))
        arm.reset(q)
        frames = model.T_world_base @ model.chain.link_frames(q)
        for i in range(model.n):
            state = p.getLinkState(arm.body, i, computeForwardKinematics=True, physicsClientId=client)
            R = np.reshape(p.getMatrixFromQuaternion(state[5]), (3, 3))
            # Link i of the URDF turns with joint i; behind the joint's fixed part comes frame i.
            fixed = model.chain.fixed(i)
            assert np.abs(np.array(state[4]) + R @ fixed[:3, 3] - frames[i + 1][:3, 3]).max() < 1e-6
            assert np.abs(R @ fixed[:3, :3] - frames[i + 1][:3, :3]).max() < 1e-5
        reach = {"wam4": 0.35, "puma560": 0.05625}.get(name, 0.0)
        tool = arm.poses()["tool"][:3, 3]
        assert np.abs(tool - frames[-1][:3, 3] - reach * frames[-1][:3, 2]).max() < 1e-9


def follow(client, arm, steps, acceleration=3.0, speed=0.6):
    """Drive a trapezoid of speeds back and forth; yields the tracking error after each step [rad]."""
    q, v = arm.q(), np.zeros(arm.model.n)
    phases = np.arange(arm.model.n)
    for k in range(steps):
        wanted = speed * np.sign(np.sin(np.pi * k * STEP_S + phases)) if k < 0.75 * steps else 0 * v
        v = v + np.clip(wanted - v, -acceleration * STEP_S, acceleration * STEP_S)
        q = q + v * STEP_S
        arm.drive(q, v)
        p.stepSimulation(physicsClientId=client)
        yield np.abs(arm.q() - q).max()


@pytest.mark.parametrize("name", ROBOTS)
def test_the_arm_tracks_its_set_points(client, name):
    """Better than 1e-4 rad in motion at 0.6 rad/s, better than 1e-6 rad at rest."""
    arm = Arm(client, load_robot(name))
    errors = list(follow(client, arm, 960))
    assert max(errors) < 1e-4
    assert errors[-1] < 1e-6 and np.abs(arm.velocity()).max() < 1e-6


@pytest.mark.parametrize("name", ["tx90", "puma560"])
def test_a_step_through_the_gate_arrives_and_the_arm_stays_there(name):
    """In the world, with its tool and cameras: no faster than the joints may, no drift, no saturation."""
    world = World(welcome(name))
    q0, fastest = world.q(), np.zeros(6)
    target = q0 + np.array([0.5, -0.4, 0.3, 0.8, -0.6, 1.0])
    for _ in range(60):
        world.command(JointStep(dq=target - world.q(), q_from=world.q(), stamp=world.time))
        world.advance()
        fastest = np.maximum(fastest, np.abs(world.arm.velocity()))
    assert np.abs(world.q() - target).max() < 1e-6
    assert (fastest <= [1.001 * joint.max_speed for joint in world.joints]).all() and fastest.max() > 0.5
    for _ in range(30):
        world.command(None)
        world.advance()
    assert np.abs(world.q() - target).max() < 1e-6 and np.abs(world.arm.velocity()).max() < 1e-6
    state = world.gate_state()
    assert state["at_rest"] and not state["fault"] and not state["dropped"]
    assert all(frame.std() > 10 for frame in world.frames().values()), "the cameras see something"
    world.close()


@pytest.mark.parametrize("name", ["tx90", "puma560"])
def test_the_tool_is_seen_by_both_cameras_of_the_empty_scene(name):
    """The printed card is wholly inside of both pictures when the app starts with this arm."""
    scenario, model = welcome(name), load_robot(name)
    card = [[0.0, y, z, 1.0] for y in (-0.035, 0.035) for z in (0.05, 0.12)]
    world_points = (model.poses(model.q_ready)["tool"] @ np.transpose(card))[:3].T
    for spec in scenario.camera:
        camera = PinholeCamera(spec.name, spec.size, spec.fov_deg)
        uv = camera.project(camera_pose(spec, {}), world_points)
        assert (uv > 20).all() and (uv < np.array(spec.size) - 20).all()


def test_two_identical_runs_agree_to_the_bit():
    runs = []
    for _ in range(2):
        number = p.connect(p.DIRECT)
        arm = Arm(number, load_robot("wam7"))
        list(follow(number, arm, 120))
        runs.append(arm.q())
        p.disconnect(number)
    assert (runs[0] == runs[1]).all()


def test_the_motors_do_not_exceed_the_speed_limit(client):
    """pybullet ignores the URDF's limit by itself; a far set-point must not make the arm race."""
    arm = Arm(client, load_robot("wam7"))
    target = arm.q() + 0.5
    fastest = 0.0
    for _ in range(120):
        arm.drive(target, np.zeros(7))
        p.stepSimulation(physicsClientId=client)
        fastest = max(fastest, float(np.abs(arm.velocity()).max()))
    assert 1.0 < fastest < 2.2


@pytest.mark.parametrize("method", ["drive", "drive speed", "reset"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_is_refused_and_leaves_the_arm_unharmed(client, method, bad):
    arm = Arm(client, load_robot("wam7"))
    good, poison = arm.q(), arm.q()
    poison[3] = bad
    with pytest.raises(BadInput, match="joint4"):
        if method == "reset":
            arm.reset(poison)
        else:
            arm.drive(*((poison, 0 * good) if method == "drive" else (good, poison)))
    for _ in range(10):
        p.stepSimulation(physicsClientId=client)
    np.testing.assert_allclose(arm.q(), good, atol=1e-9)
    assert all(np.isfinite(T).all() for T in arm.poses().values())


@pytest.mark.parametrize("shape", [(6,), (8,), (7, 1), ()])
def test_a_wrong_shape_is_refused(client, shape):
    arm = Arm(client, load_robot("wam7"))
    with pytest.raises(BadInput, match="needs shape"):
        arm.drive(np.zeros(shape), np.zeros(7))


def test_dead_band_drops_small_motions_and_keeps_the_others_whole(client):
    """Thesis 5.1.3: |motion| < TOL is not carried out; a motion of TOL or more is, unshortened."""
    q_from = np.array([0.0, 1.0, -1.0, 0.5])
    motion = np.array([0.009, -0.011, 0.010, -0.0099])
    target = apply_dead_band(q_from, q_from + motion, 0.00999999)
    np.testing.assert_array_equal(target == q_from, [True, False, False, True])
    np.testing.assert_allclose((target - q_from)[1:3], motion[1:3])
    np.testing.assert_array_equal(apply_dead_band(q_from, q_from + motion, 0.0), q_from + motion)
    arm = Arm(client, load_robot("wam4"))
    assert arm.dead_band_rad == 0.0, "the dead band is off unless asked for"
    for wrong in (-0.1, np.nan):
        with pytest.raises(BadInput, match="dead_band_rad"):
            Arm(client, load_robot("wam4"), dead_band_rad=wrong)


def test_a_foreign_arm_with_fingers_and_sloppy_masses_tracks_too(client, tmp_path):
    """Mesh by package name, a joint without limits of speed and effort, links without mass."""
    (tmp_path / "pkg").mkdir()
    (tmp_path / "pkg" / "cube.obj").write_text(
        "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    joint = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="{4}"/>'
    joint += '<origin xyz="0 0 0.2"/>'
    limit = '<limit lower="{}" upper="{}"/></joint>'
    text = '<robot name="pkg_arm">' + "".join(
        f'<link name="{x}"/>' for x in ("a", "b", "c", "d", "left", "right")
    )
    text = text.replace('<link name="b"/>', '<link name="b"><visual><geometry><mesh filename="package://pkg/cube.obj"/>'
                        "</geometry></visual></link>")  # fmt: skip
    for name, parent, child, axis in (
        ("j1", "a", "b", "0 0 1"),
        ("j2", "b", "c", "0 1 0"),
        ("j3", "c", "d", "0 1 0"),
    ):
        text += joint.format(name, "revolute", parent, child, axis) + limit.format(-2, 2)
    for name in ("left", "right"):
        text += joint.format(name + "_slide", "prismatic", "d", name, "1 0 0") + limit.format(0, 0.04)
    path = tmp_path / "pkg" / "arm.urdf"
    path.write_text(text + "</robot>")
    model = load_robot(str(path))
    assert [j.name for j in model.joints] == ["j1", "j2", "j3"]
    arm = Arm(client, model)
    assert max(follow(client, arm, 240)) < 1e-4
    poses = arm.poses()
    for i in range(p.getNumJoints(arm.body, physicsClientId=client)):
        name = p.getJointInfo(arm.body, i, physicsClientId=client)[12].decode()
        where = p.getLinkState(arm.body, i, computeForwardKinematics=True, physicsClientId=client)[4]
        np.testing.assert_allclose(poses[name][:3, 3], where, atol=1e-5)
