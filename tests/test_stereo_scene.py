"""The scene of the stereo experiment: markers where the settings say, cameras that ride on a tripod, people
as capsules, and things that are carried about."""

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from vita.errors import BadInput, UnknownName
from vita.impedance.config import ImpedanceConfig
from vita.poses import pose_matrix
from vita.scenario.schema import CameraSpec, ObjectSpec, Scenario, SceneSpec, ScriptSpec
from vita.scenario.validate import validate
from vita.sim.camera import camera_pose
from vita.sim.live import LiveRig
from vita.sim.lockstep import LockstepRig
from vita.sim.robots import load_robot
from vita.sim.twin import Twin
from vita.stereo.base import marker_square

CONFIG = ImpedanceConfig()
T_TOOL_MARKER = pose_matrix(CONFIG.tool_marker_xyz, CONFIG.tool_marker_rpy_deg)
T_TARGET_GOAL = pose_matrix(CONFIG.offset_xyz, CONFIG.offset_rpy_deg)
FACING = (90.0, 0.0, 90.0)
"""Of a target that looks along the world's x, upright."""


def scene(robot="wam7"):
    objects = (
        ObjectSpec("target", "target", (0.6, 0.0, 0.18), FACING),
        ObjectSpec("tripod", "tripod", (1.6, 0.0, 0.6), (-105.0, 0.0, 90.0)),
        ObjectSpec("ann", "person", (0.8, -1.4, 0.0)),
        ObjectSpec("ball", "ball", (0.4, 0.6, 0.3)),
    )
    left = CameraSpec("left", mount="tripod", xyz=(-0.1, 0, 0), fov_deg=36)
    right = CameraSpec("right", mount="tripod", xyz=(0.1, 0, 0), fov_deg=36)
    return validate(Scenario(scene=SceneSpec(robot, None, "marker_tool", objects), camera=(left, right)))


@pytest.fixture(scope="module")
def shared():
    with LockstepRig(scene()) as rig:
        yield rig


@pytest.fixture
def rig(shared):
    """A rig with everything where the scenario puts it."""
    shared.hard_reset(load_robot("wam7").q_ready)
    shared.observe()
    return shared


def detected(picture):
    """Marker number to (4, 2) corners [px]."""
    options = cv2.aruco.DetectorParameters()
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    options.cornerRefinementWinSize = 3
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_6X6_250)
    corners, numbers, _ = cv2.aruco.ArucoDetector(dictionary, options).detectMarkers(picture)
    return {} if numbers is None else {int(n): c[0] for n, c in zip(numbers.ravel(), corners, strict=True)}


def assert_both_markers_are_seen(rig):
    """In both pictures, at 25 px and more a side, with each corner where the settings say."""
    frames = rig.observe().frames
    moved = marker_square(CONFIG.tool_marker_m) @ T_TOOL_MARKER[:3, :3].T + T_TOOL_MARKER[:3, 3]
    for name, picture in frames.items():
        seen = detected(np.ascontiguousarray(picture))
        for number, body, square in (
            (CONFIG.tool_marker, "tool", moved),
            (CONFIG.target_marker, "target", marker_square(CONFIG.target_marker_m)),
        ):
            truth = np.array([rig.project(name, body, point) for point in square])
            assert number in seen, f"{name} does not see marker {number} on the {body}"
            off = seen[number] - truth
            # OpenCV's own refinement of corners is coarse on small markers; their mean is not.
            assert np.linalg.norm(off, axis=1).max() < 1.2 and np.linalg.norm(off.mean(axis=0)) < 0.4
            assert np.linalg.norm(truth - np.roll(truth, 1, axis=0), axis=1).min() > 25


def joints_at(arm, q_start, T_base_tool):
    """(n,) joints at which the tool is there."""

    def off(q):
        T = arm.pose(q)
        turn = Rotation.from_matrix(T[:3, :3] @ T_base_tool[:3, :3].T).as_rotvec()
        return np.concatenate([T[:3, 3] - T_base_tool[:3, 3], 0.3 * turn, 1e-4 * (q - q_start)])

    low, high = [joint.lower for joint in arm.joints], [joint.upper for joint in arm.joints]
    found = least_squares(off, q_start, bounds=(low, high))
    assert np.abs(off(found.x)[:6]).max() < 1e-3
    return found.x


@pytest.mark.parametrize("robot", ["wam7", "tx90"])
def test_both_markers_are_seen_at_the_start_and_with_the_tool_at_its_goal(robot):
    """At the ready pose, and at the goal of targets that are moved, nodded, turned and rolled: neither
    marker covers the other, and the drawn markers are those that the settings tell of."""
    model = load_robot(robot)
    with LockstepRig(scene(robot)) as rig:
        assert_both_markers_are_seen(rig)
        for xyz, turn in [
            ((0.6, 0.0, 0.2), (0, 0, 0)),
            ((0.65, 0.15, 0.15), (15, -20, 0)),
            ((0.55, -0.15, 0.25), (-10, 20, 15)),
            ((0.6, 0.05, 0.2), (0, 0, -20)),
        ]:
            T = pose_matrix(xyz, FACING) @ pose_matrix((0, 0, 0), turn)
            rig.hard_reset(joints_at(model.arm_model(), model.q_ready, T @ T_TARGET_GOAL))
            rpy = tuple(Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True))
            rig.perform("drag_target", object="target", xyz=xyz, rpy_deg=rpy)
            assert_both_markers_are_seen(rig)


def test_at_the_goal_the_tools_marker_is_15_cm_above_the_targets_and_parallel():
    assert np.allclose(T_TARGET_GOAL @ T_TOOL_MARKER, pose_matrix((0, 0.15, 0)), atol=1e-12)


# ---- cameras on a tripod -------------------------------------------------------------------------


def test_cameras_ride_on_the_tripod(rig):
    """Moved and turned, it takes both cameras along: truth, projection and picture agree, and the two stay
    as they are to one another."""
    before = {k: np.array(T) for k, T in rig.poses().items()}
    rig.observe()
    to = ((1.55, 0.2, 0.65), (-105.0, 0.0, 105.0))
    rig.perform("drag_target", object="tripod", xyz=to[0], rpy_deg=to[1], over_s=0.1)
    for _ in range(5):
        rig.observe()
    after = rig.poses()
    for name, x in (("left", -0.1), ("right", 0.1)):
        assert np.allclose(after[f"camera:{name}"], pose_matrix(*to) @ pose_matrix((x, 0, 0)), atol=1e-12)
    pair = [np.linalg.inv(T["camera:right"]) @ T["camera:left"] for T in (before, after)]
    assert np.allclose(pair[0], pair[1], atol=1e-12) and np.allclose(pair[0][:3, 3], (-0.2, 0, 0))
    assert_both_markers_are_seen(rig)


def test_the_twin_puts_a_cameras_tripod_where_the_simulation_has_it(rig):
    twin = Twin(scene())
    assert np.allclose(twin.bodies(twin.q0)["camera:left"], rig.poses()["camera:left"], atol=1e-9)
    assert not twin.on_hand("camera:left") and not twin.on_arm("camera:left")


def test_a_camera_rides_on_a_robot_link_or_an_object_and_on_nothing_else():
    with pytest.raises(UnknownName, match="tripod") as caught:
        validate(Scenario(camera=(CameraSpec("eye", mount="tripot"),), scene=SceneSpec(objects=(
            ObjectSpec("tripod", "tripod"),))))  # fmt: skip
    assert caught.value.path == "camera[0].mount" and {"tripod", "tool"} <= set(caught.value.choices)
    assert "world" not in caught.value.choices
    spec = CameraSpec("eye", mount="tripod", xyz=(0, 0, 0.1))
    assert np.allclose(camera_pose(spec, {"tripod": pose_matrix((1, 2, 3))})[:3, 3], (1, 2, 3.1))


# ---- obstacles -------------------------------------------------------------------------------------


def test_obstacles_are_people_and_balls_where_they_are_now(rig):
    """They move with the object, and the rest of the scene is none."""
    first = rig.obstacles()
    assert {c.body for c in first} == {"ann", "ball"}
    rig.perform("drag_target", object="ann", xyz=(0.9, -1.2, 0.0), over_s=0.2)
    rig.perform("drag_target", object="ball", xyz=(0.5, 0.3, 0.3))
    for _ in range(8):
        rig.observe()
    for old, new in zip(first, rig.obstacles(), strict=True):
        by = (0.1, 0.2, 0.0) if old.body == "ann" else (0.1, -0.3, 0.0)
        assert np.allclose(new.start - old.start, by) and np.allclose(new.end - old.end, by)
        assert new.radius == old.radius > 0


def test_the_live_rig_tells_of_the_same_obstacles():
    """Its parent process computes them from the poses that came with the pictures."""
    objects = (ObjectSpec("ball", "ball", (0.4, 0.6, 0.3)),)
    scenario = Scenario(scene=SceneSpec("wam4", None, "none", objects, table=False))
    with LiveRig(scenario) as live:
        live.observe()
        assert np.allclose(live.obstacles()[0].start, (0.4, 0.6, 0.3))
        live.perform("drag_target", object="ball", xyz=(0.1, 0.2, 0.3))
        live.observe()
        (ball,) = live.obstacles()
        assert ball.body == "ball" and np.allclose(ball.start, (0.1, 0.2, 0.3))


# ---- carrying ----------------------------------------------------------------------------------------


def test_the_script_carries_a_target_and_refuses_what_it_does_not_know(rig):
    scenario = scene()
    entry = ScriptSpec(0.0, "carry", {"object": "target", "path": "circle", "speed_m_s": 0.2})
    assert validate(Scenario(scene=scenario.scene, script=(entry,))).script[0].arguments["speed_m_s"] == 0.2
    for wrong, words in (
        ({"object": "target", "path": "square"}, "circle, line, wave"),
        ({"object": "target"}, "'path'"),
        ({"object": "targit", "path": "line"}, "target"),
        ({"object": "target", "path": "line", "speed_m_s": -1}, "speed_m_s"),
    ):
        with pytest.raises(BadInput, match=words):
            validate(Scenario(scene=scenario.scene, script=(ScriptSpec(0.0, "carry", wrong),)))
    with pytest.raises(UnknownName, match="circle, line, wave"):
        rig.perform("carry", object="target", path="square")
    with pytest.raises(UnknownName, match="target"):
        rig.perform("carry", object="targit", path="line")
    rig.observe()
    rig.perform("carry", object="target", path="line", speed_m_s=0.3, length_m=0.2)
    places = []
    for _ in range(40):
        rig.observe()
        places.append(rig.locate("target", (0, 0, 0)))
    assert np.ptp(places, axis=0)[1] > 0.09 and np.ptp(places, axis=0)[[0, 2]].max() < 1e-9
