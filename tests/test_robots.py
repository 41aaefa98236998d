"""The robots agree with their published figures, with their files, and with any URDF by path."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from vita.assets import asset
from vita.errors import BadInput, MissingDependency, UnknownName
from vita.sim import wam
from vita.sim.camera import PinholeCamera, look_at
from vita.sim.dh import DHChain
from vita.sim.hand import hand_visuals
from vita.sim.hidden_faces import inside
from vita.sim.render import make_renderer
from vita.sim.robots import ROBOTS, load_robot
from vita.sim.shading import shaded
from vita.sim.shapes import ball, joined
from vita.sim.urdf_visuals import visual
from vita.sim.wam_shapes import BODIES, COLORS, link_solids
from vita.types import Visual

LIMITS = [(-2.6, 2.6), (-2.0, 2.0), (-2.8, 2.8), (-0.9, 3.1), (-4.76, 1.24), (-1.6, 1.6), (-3.0, 3.0)]

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


@pytest.mark.parametrize("name", ROBOTS)
def test_the_urdf_tree_is_the_dh_chain(name):
    """Two independent descriptions of one arm agree at 200 random poses, in position and orientation."""
    model = load_robot(name)
    assert model.chain is not None
    reach = np.eye(4)
    reach[2, 3] = 0.35 if name == "wam4" else 0.0
    for q in random_poses(model, 200):
        expected = model.T_world_base @ model.chain.link_frames(q)[-1] @ reach
        poses = model.poses(q)
        np.testing.assert_allclose(poses["tool"], expected, atol=1e-12)
        np.testing.assert_allclose(poses["flange"], expected, atol=1e-12)


@pytest.mark.parametrize("name, n", [("wam4", 4), ("wam7", 7)])
def test_joints_are_the_published_ones(name, n):
    model = load_robot(name)
    assert [(j.lower, j.upper) for j in model.joints] == LIMITS[:n]
    assert {j.max_speed for j in model.joints} == {2.0}
    assert model.link_names == ("base", *(f"link{i + 1}" for i in range(n)))
    assert [joint.effort for joint in model.urdf_joints] == list(wam.TORQUES[:n])


@pytest.mark.parametrize("name", ROBOTS)
def test_ready_pose_is_inside_the_limits_with_the_hand_in_front_pointing_down(name):
    model = load_robot(name)
    for joint, q in zip(model.joints, model.q_ready, strict=True):
        assert joint.lower + 0.2 < q < joint.upper - 0.2
    tool = model.poses(model.q_ready)["tool"]
    assert 0.4 < tool[0, 3] < 0.7 and abs(tool[1, 3]) < 1e-9 and 0.2 < tool[2, 3] < 0.5
    assert tool[2, 2] < -0.9


@pytest.mark.parametrize("name", ROBOTS)
def test_visuals_are_sound_and_belong_to_links(name):
    model = load_robot(name)
    visuals = model.visuals()
    assert {v.body for v in visuals} == set(model.link_names)
    for v in visuals:
        assert_sound(v, closed=False)  # What is hidden inside of a neighbour has been left out.
    assert 6_000 < sum(len(v.faces) for v in visuals) < 10_000
    floor = min(v.vertices[:, 2].min() for v in visuals if v.body == "base")
    assert floor == pytest.approx(-wam.SHOULDER_HEIGHT, abs=1e-4)


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


@pytest.mark.parametrize("body", BODIES)
def test_every_solid_of_the_arm_is_closed_and_looks_outwards(body):
    for color, solid in BODIES[body]():
        assert_sound(visual(body, solid, COLORS[color]))


def test_the_hand_is_sound_and_sits_on_the_tool_frame():
    visuals = hand_visuals()
    assert {v.body for v in visuals} == {"tool"}
    for v in visuals:
        assert_sound(v)
    points = np.concatenate([v.vertices for v in visuals])
    assert points[:, 2].min() == pytest.approx(0.0, abs=1e-6) and 0.15 < points[:, 2].max() < 0.25


def test_the_shipped_files_are_what_the_generator_writes(tmp_path):
    """URDF text to the letter, meshes to 1e-5 m (their precision), and no file more or less."""
    folder = asset("robots", "wam")
    written = {path.relative_to(tmp_path) for path in wam.write(tmp_path)}
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
    assert sum((folder / relative).stat().st_size for relative in shipped) < 1.5e6


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
        wam.WAMS["wam7"].chain.link_frames(np.zeros(6))


def test_a_missing_asset_is_an_environment_error():
    with pytest.raises(MissingDependency, match="nothing/here"):
        asset("nothing", "here")


def test_robots_need_no_physics_engine():
    code = "import sys, vita.sim.robots as r; r.load_robot('wam4').visuals(); "
    code += "assert 'pybullet' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_inside_tells_a_point_in_a_ball_from_one_outside():
    points = np.random.default_rng(5).uniform(-0.15, 0.15, (500, 3))
    distance = np.linalg.norm(points, axis=1)
    found = inside(points, ball(0.1, 24, 14))
    assert found[distance < 0.095].all() and not found[distance > 0.1].any()


@pytest.mark.parametrize("body", ["link1", "link3", "forearm"])
def test_faces_that_are_left_out_cannot_be_seen(body):
    """From all around, the distances to a body with and without its hidden faces are the same."""
    whole = joined([solid for _, solid in BODIES[body]()])
    seen = joined(list(link_solids(body).values()))
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
