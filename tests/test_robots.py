"""The robots agree with their published figures, with their files, and with any URDF by path."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from vita import cli
from vita.assets import asset
from vita.errors import BadInput, MissingDependency, UnknownName
from vita.poses import look_at
from vita.scenario.library import welcome
from vita.sim.camera import PinholeCamera
from vita.sim.dh import DHChain
from vita.sim.hand import hand_visuals
from vita.sim.hidden_faces import inside
from vita.sim.render import make_renderer
from vita.sim.robot_files import seen_solids, write
from vita.sim.robots import ROBOTS, load_robot
from vita.sim.shading import shaded
from vita.sim.shapes import Solid, ball, joined
from vita.sim.shipped import SHIPPED
from vita.sim.urdf_visuals import visual
from vita.types import Visual

WAM_LIMITS = [(-2.6, 2.6), (-2.0, 2.0), (-2.8, 2.8), (-0.9, 3.1), (-4.76, 1.24), (-1.6, 1.6), (-3.0, 3.0)]
TX90_LIMITS = [(-3.14, 3.14), (-2.27, 2.57), (-2.53, 2.53), (-4.71, 4.71), (-2.01, 2.44), (-4.71, 4.71)]
PUMA_LIMITS_DEG = [(-160, 160), (-45, 225), (-225, 45), (-110, 170), (-100, 100), (-266, 266)]
PUBLISHED = {
    "wam4": (WAM_LIMITS[:4], [2.0] * 4, [77.3, 160.6, 95.6, 29.4]),
    "wam7": (WAM_LIMITS, [2.0] * 7, [77.3, 160.6, 95.6, 29.4, 11.6, 11.6, 2.7]),
    "tx90": (TX90_LIMITS, [4.36, 3.49, 5.24, 7.50, 6.11, 10.47], [318, 166, 76, 34, 29, 11]),
    "puma560": (
        np.radians(PUMA_LIMITS_DEG), np.radians([82, 74, 122, 228, 241, 228]),
        [97.6, 186.4, 89.4, 24.2, 20.1, 21.3],
    ),
}  # fmt: skip
"""Limits [rad], speeds [rad/s] and torques [Nm] of the joints."""
DRAWINGS = sorted({(spec.folder, body) for spec in SHIPPED.values() for body in spec.drawings})
SPEC_OF = {spec.folder: spec for spec in SHIPPED.values()}

SMALL = """<robot name="small">
  <material name="red"><color rgba="0.9 0.1 0.1 1"/></material>
  <link name="world"/>
  <joint name="stand" type="fixed"><parent link="world"/><child link="post"/><origin xyz="0 0 0.1"/></joint>
  <link name="post">
    <visual><geometry><box size="0.2 0.1 0.4"/></geometry><material name="red"/></visual>
    <visual><geometry><sphere radius="0.05"/></geometry></visual>
    <visual>
      <geometry><mesh filename="package://small_description/part.stl" scale="2 2 2"/></geometry>
    </visual>
  </link>
  <joint name="turn" type="revolute">
    <parent link="post"/><child link="arm"/><origin xyz="0 0 0.2" rpy="0.1 0.2 0.3"/><axis xyz="0 2 0"/>
    <limit lower="-1" upper="2" velocity="1.5" effort="20"/>
  </joint>
  <link name="arm">
    <inertial><origin xyz="0 0 0.2"/><mass value="1"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.03" length="0.4"/></geometry></visual>
  </link>
  <joint name="spin" type="continuous">
    <parent link="arm"/><child link="tip"/><origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
  </joint>
  <link name="tip">
    <inertial><mass value="0.3"/>
      <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
</robot>
"""


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A foreign URDF inside a package folder, with every kind of visual geometry."""
    folder = tmp_path / "small_description"
    (folder / "urdf").mkdir(parents=True)
    trimesh.creation.box((0.1, 0.1, 0.1)).export(folder / "part.stl")
    path = folder / "urdf" / "small.urdf"
    path.write_text(SMALL)
    return path


def random_poses(model, count: int, seed: int = 1) -> np.ndarray:
    lower, upper = ([getattr(j, side) for j in model.joints] for side in ("lower", "upper"))
    return np.random.default_rng(seed).uniform(lower, upper, (count, model.n))


def test_at_zero_the_wam7_stands_straight_up():
    """The published check: flange at (0, 0, 0.9109) above the shoulder, identity orientation."""
    model = load_robot("wam7")
    assert model.chain is not None
    expected = np.eye(4)
    expected[2, 3] = 0.9109
    np.testing.assert_allclose(model.chain.link_frames(np.zeros(7))[-1], expected, atol=1e-12)
    tool = model.poses(np.zeros(7))["tool"]
    np.testing.assert_allclose(tool[:3, 3], [0, 0, 0.346 + 0.9109], atol=1e-12)


def test_at_zero_the_tx90_stands_straight_up():
    """The published check: flange at (0.05, 0.05, 1.428) above the mounting plane, identity orientation."""
    expected = np.eye(4)
    expected[:3, 3] = 0.05, 0.05, 1.428
    np.testing.assert_allclose(load_robot("tx90").poses(np.zeros(6))["tool"], expected, atol=1e-12)


def test_the_puma_reaches_where_published():
    """Without a tool: (0.5963, -0.1501, -0.0144) from the shoulder, 0.6718 m above the mounting plane; the
    flange is 56.25 mm further along the last axis, which then points forwards."""
    model = load_robot("puma560")
    q = np.array([0, np.pi / 4, np.pi, 0, np.pi / 4, 0])
    wrist = model.poses(q)["link6"][:3, 3]
    np.testing.assert_allclose(wrist, [0.5963, -0.1501, 0.6718 - 0.0144], atol=5e-5)
    tool = model.poses(q)["tool"]
    np.testing.assert_allclose(tool[:3, 3], wrist + [0.05625, 0, 0], atol=1e-9)
    np.testing.assert_allclose(tool[:3, 2], [1, 0, 0], atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_urdf_tree_is_the_dh_chain(name):
    """Two independent descriptions of one arm agree at 200 random poses, in position and orientation."""
    model = load_robot(name)
    assert model.chain is not None
    reach = np.eye(4)
    reach[2, 3] = {"wam4": 0.35, "puma560": 0.05625}.get(name, 0.0)
    for q in random_poses(model, 200):
        expected = model.T_world_base @ model.chain.link_frames(q)[-1] @ reach
        poses = model.poses(q)
        np.testing.assert_allclose(poses["tool"], expected, atol=1e-12)
        np.testing.assert_allclose(poses["flange"], expected, atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_joints_are_the_published_ones(name):
    model = load_robot(name)
    limits, speeds, torques = PUBLISHED[name]
    np.testing.assert_array_equal([(j.lower, j.upper) for j in model.joints], limits)
    np.testing.assert_array_equal([j.max_speed for j in model.joints], speeds)
    assert [joint.effort for joint in model.urdf_joints] == torques
    assert model.link_names == ("base", *(f"link{i + 1}" for i in range(len(torques))))


def test_the_names_of_the_robots_are_those_of_their_figures():
    assert tuple(SHIPPED) == ROBOTS and all(spec.name == name for name, spec in SHIPPED.items())
    with pytest.raises(BadInput, match="wam7.speeds.* needs 7 entries, has 6"):
        replace(SHIPPED["wam7"], speeds=(1.0,) * 6)


@pytest.mark.parametrize("name", ROBOTS)
def test_ready_pose_is_inside_the_limits_with_the_hand_in_front_pointing_down(name):
    """And far from singular: every motion of the hand that the joints allow costs few of them."""
    model = load_robot(name)
    for joint, q in zip(model.joints, model.q_ready, strict=True):
        assert joint.lower + 0.2 < q < joint.upper - 0.2
    tool = model.poses(model.q_ready)["tool"]
    assert 0.4 < tool[0, 3] < 0.7 and abs(tool[1, 3]) < 1e-4 and 0.2 < tool[2, 3] < 0.5
    assert tool[2, 2] < -0.9
    arm = model.arm_model()
    J = arm.jacobian(arm.frames(model.q_ready))
    assert np.linalg.svd(J, compute_uv=False)[min(6, model.n) - 1] > 0.08


@pytest.mark.parametrize("name", ROBOTS)
def test_visuals_are_sound_and_belong_to_links(name):
    model = load_robot(name)
    visuals = model.visuals()
    assert {v.body for v in visuals} == set(model.link_names)
    for v in visuals:
        assert_sound(v, closed=False)  # What is hidden inside of a neighbour has been left out.
    assert 4_000 < sum(len(v.faces) for v in visuals) < 10_000
    floor = min(v.vertices[:, 2].min() for v in visuals if v.body == "base")
    assert floor == pytest.approx(-model.T_world_base[2, 3], abs=1e-4), "it stands on the mounting plane"


def assert_sound(v: Visual, closed: bool = True) -> None:
    assert np.isfinite(v.vertices).all() and v.faces.max() < len(v.vertices)
    np.testing.assert_allclose(np.linalg.norm(v.normals, axis=1), 1.0, atol=1e-6)
    a, b, c = (v.vertices[v.faces[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    # Every corner's normal is on the side that its face looks to.
    for k in range(3):
        assert (np.einsum("ij,ij->i", across, v.normals[v.faces[:, k]]) > 0).all()
    # A closed mesh that looks outwards has a positive volume.
    assert not closed or np.einsum("ij,ij->i", a, np.cross(b, c)).sum() > 0


@pytest.mark.parametrize(("folder", "body"), DRAWINGS)
def test_every_solid_of_the_arm_is_closed_and_looks_outwards(folder, body):
    spec = SPEC_OF[folder]
    for color, solid in spec.drawings[body]():
        assert_sound(visual(body, solid, spec.colors[color]))


def just_outside(solid: Solid, gap: float) -> np.ndarray:
    """About a hundred points that stand off the middles of a solid's faces by `gap` [m]."""
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    out = np.cross(b - a, c - a)
    points = (a + b + c) / 3 + gap * out / np.linalg.norm(out, axis=1, keepdims=True)
    return points[:: max(1, len(points) // 100)]


@pytest.mark.parametrize("name", ROBOTS)
def test_no_part_floats_and_each_link_meets_the_one_that_carries_it(name):
    """At a random pose every solid is reached from the base over steps from one to another that is at most
    3 mm away, on the same link or on the next."""
    model, spec = load_robot(name), SHIPPED[name]
    poses = model.poses(random_poses(model, 1, seed=3)[0])
    on, solids = [], []
    for i, (link, body) in enumerate(zip(model.link_names, spec.meshes, strict=True)):
        drawn = [solid.moved(poses[link]) for _, solid in spec.drawings[body]()]
        on, solids = [*on, *(i for _ in drawn)], [*solids, *drawn]
    points = [just_outside(solid, 0.003) for solid in solids]
    apart, reached = set(range(1, len(solids))), [0]
    while reached:
        i = reached.pop()
        near = {
            j
            for j in apart
            if abs(on[i] - on[j]) <= 1
            and (inside(points[i], solids[j]).any() or inside(points[j], solids[i]).any())
        }
        apart -= near
        reached += near
    assert not apart


def test_the_hand_is_sound_and_sits_on_the_tool_frame():
    visuals = hand_visuals()
    assert {v.body for v in visuals} == {"tool"}
    for v in visuals:
        assert_sound(v)
    points = np.concatenate([v.vertices for v in visuals])
    assert points[:, 2].min() == pytest.approx(0.0, abs=1e-6) and 0.15 < points[:, 2].max() < 0.25


def test_the_shipped_files_are_what_the_generator_writes(tmp_path):
    """URDF text to the letter, meshes to 1e-5 m (their precision), and no file more or less."""
    folder = asset("robots")
    written = {path.relative_to(tmp_path) for path in write(tmp_path, SHIPPED.values())}
    shipped = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
    assert written == shipped
    for relative in written:
        new, old = (tmp_path / relative).read_text(), (folder / relative).read_text()
        if relative.suffix == ".urdf":
            assert new == old
            continue
        new_lines, old_lines = ([line.split() for line in text.splitlines()] for text in (new, old))
        assert [line[0] for line in new_lines] == [line[0] for line in old_lines]
        numbers = [
            [x for line in lines if line[0] == "v" for x in line[1:]] for lines in (new_lines, old_lines)
        ]
        np.testing.assert_allclose(np.array(numbers[0], float), np.array(numbers[1], float), atol=1.1e-5)
    for home in folder.iterdir():
        assert sum(path.stat().st_size for path in home.rglob("*") if path.is_file()) < 0.65e6


def test_any_urdf_loads_by_path(small):
    model = load_robot(str(small))
    assert model.name == "small" and model.chain is None
    assert [j.name for j in model.joints] == ["turn", "spin"]
    assert (model.joints[0].lower, model.joints[0].upper, model.joints[0].max_speed) == (-1, 2, 1.5)
    assert np.isfinite([model.joints[1].lower, model.joints[1].upper]).all()
    # `world` means the world everywhere else, so the foreign link of that name steps aside.
    assert model.link_names == ("world_link", "post", "arm", "tip")
    tip = model.poses(np.zeros(2))["tip"]
    c, s = np.cos, np.sin  # Rz(0.3) Ry(0.2) Rx(0.1) applied to z
    up = [
        c(0.3) * s(0.2) * c(0.1) + s(0.3) * s(0.1),
        s(0.3) * s(0.2) * c(0.1) - c(0.3) * s(0.1),
        c(0.2) * c(0.1),
    ]
    np.testing.assert_allclose(tip[:3, 3], np.array([0, 0, 0.3]) + 0.4 * np.array(up), atol=1e-12)


def test_foreign_visuals_have_the_sizes_of_the_file(small):
    visuals = load_robot(str(small)).visuals()
    sizes = [(v.body, np.round(np.ptp(v.vertices, axis=0), 3).tolist()) for v in visuals]
    assert sizes[0] == ("post", [0.2, 0.1, 0.4]) and visuals[0].color == (0.9, 0.1, 0.1)
    assert sizes[2] == ("post", [0.2, 0.2, 0.2])  # the mesh of 0.1 m, scaled by two
    assert sizes[3][0] == "arm" and sizes[3][1][2] == 0.4
    for v in visuals:
        assert_sound(v)


def test_fingers_do_not_count_as_the_arm(tmp_path):
    """Behind three joints, two moving branches are a gripper; the arm ends where they part."""
    links = ["base", "l1", "l2", "l3", "left", "right", "frame"]
    text = "".join(f'<link name="{name}"/>' for name in links)
    chain = [("base", "l1"), ("l1", "l2"), ("l2", "l3"), ("l3", "left"), ("l3", "right")]
    for parent, child in chain:
        text += f'<joint name="to_{child}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        text += '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    text += '<joint name="to_frame" type="fixed"><parent link="l3"/><child link="frame"/></joint>'
    path = tmp_path / "gripper.urdf"
    path.write_text(f'<robot name="g">{text}</robot>')
    model = load_robot(str(path))
    assert [j.name for j in model.joints] == ["to_l1", "to_l2", "to_l3"] and model.link_names[-1] == "frame"


def test_an_unknown_name_lists_the_choices():
    with pytest.raises(UnknownName, match="Did you mean 'wam7'") as caught:
        load_robot("wam8")
    assert set(ROBOTS) <= set(caught.value.choices)


@pytest.mark.parametrize(
    "old, new, reason",
    [
        ("<robot", "<robott", "not a readable URDF|outermost"),
        ("</robot>", "", "not a readable URDF"),
        (
            'link="post"/><child link="arm"',
            'link="nowhere"/><child link="arm"',
            "'nowhere', which does not exist",
        ),
        ('lower="-1"', 'lower="3"', "lower < upper"),
        ('lower="-1"', 'lower="nan"', "finite"),
        ('type="revolute"', 'type="planar"', "'planar' is not supported"),
        ("part.stl", "lost.stl", "lost.stl.* was not found"),
        ('axis xyz="0 2 0"', 'axis xyz="0 0 0"', "no length"),
        ('size="0.2 0.1 0.4"', 'size="0.2 0.1"', "3 finite"),
    ],
)
def test_a_broken_file_is_refused_with_the_reason(small, old, new, reason):
    assert old in SMALL
    small.write_text(SMALL.replace(old, new))
    with pytest.raises(BadInput, match=reason) as caught:
        load_robot(str(small))
    assert str(small) in str(caught.value)


def test_a_missing_file_and_a_robot_that_cannot_move_are_refused(tmp_path):
    with pytest.raises(BadInput, match="no such file"):
        load_robot(str(tmp_path / "none.urdf"))
    (tmp_path / "still.urdf").write_text('<robot name="still"><link name="a"/></robot>')
    with pytest.raises(BadInput, match="no joint that moves"):
        load_robot(str(tmp_path / "still.urdf"))


def test_an_unreadable_mesh_falls_back_to_the_collision_shape(small):
    """The robot stays usable and the user is told."""
    box = "<collision><geometry><box size='0.3 0.3 0.3'/></geometry></collision>"
    small.write_text(SMALL.replace('<link name="post">', f'<link name="post">{box}'))
    (small.parent.parent / "part.stl").write_bytes(b"solid nothing")
    with pytest.warns(UserWarning, match="'post' is drawn by its collision shape"):
        visuals = load_robot(str(small)).visuals()
    np.testing.assert_allclose(np.ptp(visuals[0].vertices, axis=0), 0.3)


def test_smoothing_keeps_the_edges_of_a_box_and_rounds_a_ball():
    box, ball = trimesh.creation.box(), trimesh.creation.icosphere(3)
    _, _, normals = shaded(box.vertices, box.faces)
    assert len(normals) == 24 and set(np.abs(normals).max(axis=1)) == {1.0}
    vertices, _, normals = shaded(ball.vertices, ball.faces)
    assert len(vertices) == len(ball.vertices)
    np.testing.assert_allclose(normals, vertices, atol=0.02)


def test_dh_parameters_of_unequal_lengths_are_refused():
    with pytest.raises(BadInput, match="equal lengths"):
        DHChain((0, 0), (0,), (0,), (0,))
    with pytest.raises(BadInput, match="expected 7"):
        SHIPPED["wam7"].chain.link_frames(np.zeros(6))


def test_a_missing_asset_is_an_environment_error():
    with pytest.raises(MissingDependency, match="nothing/here"):
        asset("nothing", "here")


def test_robots_need_no_physics_engine():
    code = "import sys, vita.sim.robots as r; r.load_robot('tx90').visuals(); "
    code += "assert 'pybullet' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_app_starts_with_any_robot_and_nothing_drawn(name):
    assert cli._parser().parse_args(["serve", "--robot", name]).robot == name
    scenario = welcome(name)
    assert scenario.scene.robot == name and scenario.scene.objects and scenario.camera
    assert not scenario.tracker and not scenario.constraint and scenario.expect is None


def test_the_command_line_knows_the_robots_without_loading_them():
    code = "import sys, vita.cli as c; c._parser(); print([m for m in sys.modules if 'vita.sim.' in m])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['vita.sim.robot_names']"


@pytest.mark.parametrize("name", ["tx90", "puma560"])
def test_a_task_can_be_checked_with_the_robot(name, tmp_path, capsys):
    """The same scenario suits every arm. (Small pictures and projected points: this is about the robot.)"""
    text = asset("scenarios", "point_to_point.toml").read_text()
    for old, new in (
        ('robot = "wam7"', f'robot = "{name}"'),
        ("fov_deg = 36", "fov_deg = 36\nsize = [160, 120]"),
        ('attach = { body = "tool"', 'kind = "projected"\nattach = { body = "tool"'),
    ):
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "task.toml"
    path.write_text(text)
    assert cli.main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert name in out and "4 error rows hold 3 of 6 joint motions" in out


def test_inside_tells_a_point_in_a_ball_from_one_outside():
    points = np.random.default_rng(5).uniform(-0.15, 0.15, (500, 3))
    distance = np.linalg.norm(points, axis=1)
    found = inside(points, ball(0.1, 24, 14))
    assert found[distance < 0.095].all() and not found[distance > 0.1].any()


@pytest.mark.parametrize(
    ("folder", "body"),
    [("wam", "link1"), ("wam", "link3"), ("wam", "forearm"), ("tx90", "link1"), ("puma560", "link1")],
)
def test_faces_that_are_left_out_cannot_be_seen(folder, body):
    """From all around, the distances to a body with and without its hidden faces are the same."""
    spec = SPEC_OF[folder]
    whole = joined([solid for _, solid in spec.drawings[body]()])
    seen = joined(list(seen_solids(spec, body).values()))
    assert len(seen.faces) < 0.85 * len(whole.faces)
    renderers = [make_renderer([visual(body, solid, (1, 1, 1))], "gl") for solid in (whole, seen)]
    middle = whole.vertices.mean(axis=0)
    sides = [(0.7, 0, 0.2), (-0.6, 0.3, -0.2), (0.1, 0.7, 0.1), (0, -0.7, 0), (0.1, 0, 0.8), (0, 0.1, -0.8)]
    for offset in sides:
        camera, T = PinholeCamera("c", (320, 240), 50), look_at(middle + offset, middle)
        first, second = (renderer.depth(camera, T, {body: np.eye(4)}) for renderer in renderers)
        assert np.isfinite(first).sum() > 1000
        assert np.isclose(first, second, atol=1e-5).all()
    for renderer in renderers:
        renderer.close()
