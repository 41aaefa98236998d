"""Obstacles in depth pictures: closed forms seen through an ideal lens, and the simulated scene."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vita.errors import BadInput
from vita.poses import look_at, pose_matrix
from vita.scenario.schema import ObjectSpec, SceneSpec
from vita.sim.arm_hull import arm_hull, scene_hull, skeleton_radii
from vita.sim.camera import PinholeCamera
from vita.sim.depth_sensor import DepthSensor
from vita.sim.environment import build_environment
from vita.sim.meshes import box_visual, sphere_visual
from vita.sim.render_gl import GlRenderer
from vita.sim.robots import load_robot
from vita.sim.tools import build_tool
from vita.stereo.base import Lens
from vita.stereo.hull import ArmHull
from vita.stereo.segments import clearances, feet, nearest, nearest_each
from vita.stereo.surfaces import MARGIN_M, MOST, SUPPORT, surfaces

CAMERA = PinholeCamera("left", (640, 480), 50.0)
K = CAMERA.intrinsics
LENS = Lens(K[0, 0], K[1, 1], K[0, 2], K[1, 2])
V, U = 4.0 * np.indices((120, 160))
RAYS = np.stack([U, V, np.ones_like(U)], axis=-1) @ np.linalg.inv(K).T
"""(120, 160, 3) where the pixels of a depth picture look."""
Arm = tuple[np.ndarray, np.ndarray, np.ndarray]
ARM: Arm = (np.array([[0.0, 0.3, 1.0]]), np.array([[0.0, 0.31, 1.0]]), np.array([0.01]))
"""A short piece of an arm, below the middle of the picture, in the camera's own frame."""
STAND = np.eye(4)
"""Closed forms are seen by a camera that stands at the origin of the base frame."""


def seen(depth, reach_m=2.0, table_z=-5.0, arm: Arm = ARM, T=STAND, **more):
    return surfaces(depth, LENS, T, *arm, table_z, reach_m, **more)


def pose_of(model, hull: ArmHull, q) -> Arm:
    """Where the capsules of the arm's hull are at joints q."""
    starts, ends = hull.segments(model.arm_model().frames(q))
    return starts, ends, hull.radii


def turned(T, arm: Arm) -> Arm:
    """The arm after the motion T (4, 4)."""
    starts, ends = (points @ T[:3, :3].T + T[:3, 3] for points in arm[:2])
    return starts, ends, arm[2]


def ball(centre, radius):
    """(120, 160) distances of a ball along the optical axis; infinite beside it."""
    a, b = (RAYS * RAYS).sum(-1), RAYS @ centre
    root = b * b - a * (centre @ centre - radius**2)
    return np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf).astype(np.float32)


def plane(normal, offset):
    """(120, 160) distances of the plane normal . p = offset."""
    with np.errstate(divide="ignore"):
        z = offset / (RAYS @ normal)
    return np.where(z > 0.05, z, np.inf).astype(np.float32)


def angles(normals, truth):
    return np.degrees(np.arccos(np.clip((normals * truth).sum(-1), -1, 1)))


# ---- closed forms ----------------------------------------------------------------------------------


def test_points_and_normals_of_planes_are_exact():
    """For planes tilted in all directions; the inverse distance is linear in the pixel."""
    rng = np.random.default_rng(1)
    for _ in range(12):
        normal = -np.array([*rng.uniform(-0.9, 0.9, 2), 1.0])
        normal /= np.linalg.norm(normal)
        points, normals = seen(plane(normal, 1.2 * normal[2]))
        assert len(points) > 100
        assert np.abs(points @ normal - 1.2 * normal[2]).max() < 1e-5
        assert angles(normals, normal).max() < 0.05
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-9)


@pytest.mark.parametrize("radius, median, most", [(0.15, 0.8, 12.0), (0.08, 2.0, 20.0), (0.05, 3.5, 30.0)])
def test_points_of_a_ball_lie_on_it_and_normals_point_away_from_its_centre(radius, median, most):
    """A ball at 1 m; at its rim, of which half is hidden, the normals lean towards the camera."""
    for x, y in ((0.0, 0.0), (0.2, -0.15), (-0.3, 0.1)):
        centre = np.array([x, y, 1.0])
        points, normals = seen(ball(centre, radius))
        out = (points - centre) / radius
        assert np.abs(np.linalg.norm(out, axis=1) - 1).max() < 1e-4
        error = angles(normals, out)
        assert np.median(error) < median and error.max() < most
        assert ((normals * points).sum(1) < 0).all()


def test_an_edge_between_two_surfaces_bends_no_normal():
    """Up to the last pixel of each, whether what lies behind is tilted or not."""
    before, behind = np.array([0.0, 0.0, -1.0]), np.array([0.5, 0.0, -1.0]) / np.sqrt(1.25)
    depth = plane(behind, 1.4 * behind[2])
    depth[:, 80:] = plane(before, -0.9)[:, 80:]
    points, normals = seen(depth)
    near = np.abs(points[:, 2] - 0.9) < 1e-5
    assert near.sum() > 100 and (~near).sum() > 100
    assert angles(normals[near], before).max() < 0.05 and angles(normals[~near], behind).max() < 0.05


def test_noise_moves_points_by_no_more_than_itself_and_tilts_normals_by_a_few_degrees():
    rng = np.random.default_rng(2)
    centre = np.array([0.05, -0.1, 1.0])
    depth = ball(centre, 0.15)
    noisy = depth + np.where(np.isinf(depth), 0, 0.002 * rng.standard_normal(depth.shape)).astype("f4")
    points, normals = seen(noisy)
    out = points - centre
    away = np.linalg.norm(out, axis=1)
    assert 0.0005 < (away - 0.15).std() < 0.002
    assert np.median(angles(normals, out / away[:, None])) < 3.0


def test_the_base_frame_is_any_frame():
    """A law: moving camera and arm by one rigid motion moves points and normals by it."""
    rng = np.random.default_rng(3)
    depth = ball(np.array([0.1, 0.0, 1.0]), 0.1)
    points, normals = seen(depth)
    for _ in range(5):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.uniform(-1, 1, 3)
        moved, tilted = seen(depth, arm=turned(T, ARM), T=T)
        np.testing.assert_allclose(moved, points @ T[:3, :3].T + T[:3, 3], atol=2e-6)
        np.testing.assert_allclose(tilted, normals @ T[:3, :3].T, atol=1e-5)


def test_everything_reported_is_within_reach_above_the_table_and_outside_the_arm():
    """And everything of a wall that is, is reported."""
    wall = plane(np.array([0.0, 0.0, -1.0]), -1.1)
    points, _ = seen(wall, reach_m=0.3, margin_m=0.02)
    away = clearances(points, *ARM).min(axis=1)
    assert 0.02 < away.min() < 0.11 and 0.29 < away.max() < 0.3
    truth = 1.1 * RAYS.reshape(-1, 3)
    inside = clearances(truth, *ARM)[:, 0]
    wanted, near = (inside > 0.02) & (inside < 0.3), (inside > 0.02) & (inside < 0.15 * 0.3)
    assert near.sum() < MOST < 2500 < wanted.sum()  # So many that those far from the arm are thinned out.
    assert 0.05 * wanted.sum() < len(points) < 0.5 * wanted.sum()
    assert (away < 0.15 * 0.3).sum() == near.sum()
    T = pose_matrix((0, 0, 0), (180, 0, 0))  # Looking down, from a height of 0.
    floor = seen(wall, 0.5, -1.1, turned(T, ARM), T)[0]
    shelf = seen(wall, 0.5, -1.1 - 2 * MARGIN_M, turned(T, ARM), T)[0]
    assert len(floor) == 0 and len(shelf) > 100


def test_a_stride_gives_the_same_surface_from_fewer_pixels():
    depth = plane(np.array([0.3, 0.2, -1.0]) / np.linalg.norm([0.3, 0.2, -1.0]), -0.9)
    normal = np.array([0.3, 0.2, -1.0]) / np.linalg.norm([0.3, 0.2, -1.0])
    fine, _ = seen(depth, reach_m=0.25)
    points, normals = seen(depth, reach_m=0.25, stride=2)
    assert 0.1 * len(fine) < len(points)
    assert np.abs(points @ normal + 0.9).max() < 1e-5 and angles(normals, normal).max() < 0.5


# ---- what is no obstacle ---------------------------------------------------------------------------


def test_pixels_without_neighbours_are_noise():
    """Up to `SUPPORT` pixels together are nothing; one more is something."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        depth = np.full((120, 160), np.inf, np.float32)
        for v, u in zip(range(2, 118, 6), rng.permutation(np.arange(3, 157, 7))[:20], strict=True):
            depth[v, u : u + rng.integers(1, SUPPORT + 1)] = rng.uniform(0.7, 1.3)
        assert len(seen(depth)[0]) == 0
    depth[50, 60:65] = 1.0
    assert len(seen(depth)[0]) == 1


def test_what_was_not_measured_is_nothing():
    """NaN, infinity and distances of zero, all over the picture or among pixels that show something."""
    for nothing in (np.nan, np.inf, 0.0, -1.0):
        assert len(seen(np.full((120, 160), nothing, np.float32))[0]) == 0
        depth = ball(np.array([0.0, 0.0, 1.0]), 0.15)
        whole = len(seen(depth)[0])
        depth[::3, ::3] = nothing
        points, normals = seen(depth)
        assert 0.5 * whole < len(points) < whole
        assert np.isfinite(points).all() and np.isfinite(normals).all()


def test_pixels_that_blend_the_arm_with_the_background_are_nothing():
    """Where an edge of the arm falls within pixels, a sensor gives something in between, all along it."""
    wall = plane(np.array([0.0, 0.0, -1.0]), -1.6)
    arm = (np.array([[-1.0, 0.0, 0.8]]), np.array([[1.0, 0.0, 0.8]]), np.array([0.05]))
    depth = wall.copy()
    rows = np.abs(RAYS[:, 0, 1] * 0.8) < 0.05
    depth[rows] = 0.76
    for share in (0.2, 0.4, 0.6, 0.8):
        blended = depth.copy()
        for edge in (np.flatnonzero(rows)[0] - 1, np.flatnonzero(rows)[-1] + 1):
            blended[edge] = share * 0.76 + (1 - share) * 1.6
        points, _ = seen(blended, arm=arm, reach_m=0.7)
        assert len(points) == 0
    blended[edge + 1] = blended[edge] - 0.002  # A ledge of two rows is a thing, not a blend.
    blended[edge + 2] = blended[edge] - 0.004
    assert len(seen(blended, arm=arm, reach_m=0.7)[0]) > 0


def test_a_post_of_one_pixel_is_seen_and_its_normal_is_across_it():
    """No neighbour tells how a thin thing is tilted sideways; it is then taken to face the camera."""
    depth = np.full((120, 160), np.inf, np.float32)
    depth[20:100, 90] = 1.0
    points, normals = seen(depth)
    assert len(points) > 60
    assert angles(normals, np.array([0.0, 0.0, -1.0])).max() < 1.0


# ---- in the simulated scene --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def wam():
    model, tool = load_robot("wam7"), build_tool("card_tool")
    return model, arm_hull(model, tool), (*model.visuals(), *tool)


@pytest.fixture(scope="module")
def scene(wam):
    """The arm at its table with a ball, a box and a panel that can be put anywhere."""
    things = (
        sphere_visual("ball", 0.12, (1, 0, 0), segments=96),
        box_visual("box", (0.2, 0.3, 0.25), (0, 1, 0)),
        box_visual("panel", (0.01, 0.6, 0.6), (0, 0, 1)),
    )
    renderer = GlRenderer([*build_environment(True), *wam[2], *things])
    yield renderer
    renderer.close()


AWAY = {name: pose_matrix((0, 0, -50)) for name in ("ball", "box", "panel")}


def test_nothing_of_arm_or_table_is_an_obstacle_and_a_ball_beside_the_arm_is(wam, scene):
    """In 50 random poses of the whole joint range, seen from all sides, with the noise of a Kinect, and with
    the camera 5 mm and a quarter of a degree off from where it is taken to be."""
    model, hull, _ = wam
    rng = np.random.default_rng(5)
    sensor = DepthSensor(CAMERA, 2.0, 1)
    low, high = np.array([[joint.lower, joint.upper] for joint in model.joints]).T
    found = 0
    for k in range(50):
        q = rng.uniform(low, high)
        T = look_at((0.2 + 1.4 * np.cos(k), 1.4 * np.sin(k), rng.uniform(0.6, 1.4)), (0.2, 0.0, 0.4))
        arm = pose_of(model, hull, q)
        believed = T @ pose_matrix(0.005 * _unit(rng), 0.25 * _unit(rng))
        poses = model.poses(q) | AWAY
        depth = sensor.measure(scene, T, poses, ())
        assert len(surfaces(depth, LENS, believed, *arm, 0.0)[0]) == 0, f"pose {k}"
        centre = poses["tool"][:3, 3] + 0.3 * _unit(rng)
        if centre[2] < 0.2 or clearances(centre[None], *arm).min() < 0.18:
            continue
        depth = sensor.measure(scene, T, poses | {"ball": pose_matrix(centre)}, ())
        points, _ = surfaces(depth, LENS, believed, *arm, 0.0)
        if len(points):
            found += 1
            assert np.abs(np.linalg.norm(points - centre, axis=1) - 0.12).max() < 0.04
    assert found >= 15  # In the others the ball is behind the arm or beside the picture.


def _unit(rng):
    direction = rng.standard_normal(3)
    return direction / np.linalg.norm(direction)


def test_surfaces_of_ball_box_and_panel_are_where_they_are(wam, scene):
    """Points to the exactness of the meshes, normals to a few degrees of the closed form."""
    model, hull, _ = wam
    q, T = model.q_ready, look_at((1.3, -0.8, 0.9), (0.4, 0, 0.45))
    arm = pose_of(model, hull, q)
    poses = {
        "ball": pose_matrix((0.55, -0.3, 0.6)),
        "box": pose_matrix((0.3, 0.4, 0.3), (10, 20, 30)),
        "panel": pose_matrix((0.1, -0.35, 0.7), (0, 0, -20)),
    }
    for name, pose in poses.items():
        depth = scene.depth(CAMERA, T, model.poses(q) | AWAY | {name: pose}, 4)
        points, normals = surfaces(depth, LENS, T, *arm, 0.0)
        assert len(points) > 60, name
        local, facing = (points - pose[:3, 3]) @ pose[:3, :3], normals @ pose[:3, :3]
        if name == "ball":
            away = np.linalg.norm(local, axis=1)
            assert np.abs(away - 0.12).max() < 3e-4
            error = angles(facing, local / away[:, None])
            assert np.median(error) < 2.0 and error.max() < 18.0
            continue
        half = np.array([0.1, 0.15, 0.125]) if name == "box" else np.array([0.005, 0.3, 0.3])
        gaps = half - np.abs(local)
        side = gaps.argmin(axis=1)
        assert np.abs(gaps.min(axis=1)).max() < 1e-5
        face = np.zeros_like(local)
        face[np.arange(len(local)), side] = np.sign(local[np.arange(len(local)), side])
        error = angles(facing, face)
        assert np.median(error) < 0.5 and (error < 5.0).mean() > 0.6  # The others stand at an edge.


# ---- how thick an arm is -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["wam4", "wam7", "tx90", "puma560"])
def test_the_hull_contains_every_mesh_in_every_pose_and_no_capsule_is_wider_than_it_must_be(name):
    model, tool = load_robot(name), build_tool("marker_tool")
    hull = arm_hull(model, tool)
    rng = np.random.default_rng(6)
    for _ in range(4):
        q = rng.uniform(-2, 2, model.n)
        poses, arm = model.poses(q), pose_of(model, hull, q)
        thinner = np.full(len(hull.radii), -np.inf)
        for visual in (*model.visuals(), *tool):
            T = poses[visual.body]
            corners = visual.vertices @ T[:3, :3].T + T[:3, 3]
            middles = corners[visual.faces].mean(axis=1)
            away = clearances(np.vstack([corners, middles]), *arm)
            assert away.min(axis=1).max() < 1e-9
            inner = np.where(away < 1e-9, away, -np.inf)
            thinner = np.maximum(thinner, inner.max(axis=0))
        assert (thinner > -0.005).all()
    outer = np.array(hull.frames) >= 2
    assert outer.sum() >= 3 and (hull.radii[outer] < 0.13).all()


def test_what_the_arm_carries_belongs_to_it():
    """A card mounted on the tool, and the tool itself, widen the hull; what stands on the table does not."""
    model = load_robot("wam7")
    bare = scene_hull(model, SceneSpec(tool="none"))
    beside = ObjectSpec("cube", "cube", (0.5, 0, 0.03))
    held = ObjectSpec("card", "card", (0.0, 0.0, 0.3), mount="tool")
    alone = scene_hull(model, SceneSpec(tool="none", objects=(beside,)))
    assert np.array_equal(alone.radii, bare.radii)
    frames = model.arm_model().frames(model.q_ready)
    corner = frames[-1, :3, :3] @ [0.03, 0.04, 0.3] + frames[-1, :3, 3]
    for scene, inside in ((SceneSpec(tool="none"), False), (SceneSpec(tool="none", objects=(held,)), True)):
        hull = scene_hull(model, scene)
        away = clearances(corner[None], *hull.segments(frames), hull.radii).min()
        assert (away < 1e-9) == inside


def test_skeleton_radii_reach_every_moving_mesh_from_the_segments_between_joints():
    """In every pose; where the tool reaches beyond the last frame, its radius covers it."""
    for name in ("wam7", "tx90"):
        model, tool = load_robot(name), build_tool("card_tool")
        radii, arm = skeleton_radii(model, tool), model.arm_model()
        assert radii.shape == (model.n,) and radii[-1] == pytest.approx(0.125, abs=0.003)
        for shift in (0.0, 0.7, -0.4):
            q = model.q_ready + shift
            points, poses = arm.frames(q)[:, :3, 3], model.poses(q)
            for visual in (*model.visuals(), *tool):
                if visual.body in ("base", model.link_names[0]):
                    continue
                T = poses[visual.body]
                away = clearances(visual.vertices @ T[:3, :3].T + T[:3, 3], points[:-1], points[1:], radii)
                assert away.min(axis=1).max() < 1e-9


def test_hulls_that_do_not_fit_are_refused():
    with pytest.raises(BadInput, match="radii"):
        ArmHull((0,), np.zeros((1, 3)), np.ones((1, 3)), np.ones(2))
    with pytest.raises(BadInput, match="frames"):
        ArmHull((3,), np.zeros((1, 3)), np.ones((1, 3)), np.ones(1)).segments(np.eye(4)[None])
    depth = np.ones((120, 160), np.float32)
    for arm in ((np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)), (ARM[0], ARM[1], np.zeros(2))):
        with pytest.raises(BadInput, match="starts"):
            seen(depth, arm=arm)
    with pytest.raises(BadInput, match="stride"):
        seen(depth, stride=0)


# ---- what is nearest -----------------------------------------------------------------------------------


def test_the_nearest_pair_is_nearer_than_any_other():
    """Against two thousand points along each segment, degenerate ones among them."""
    rng = np.random.default_rng(7)
    share = np.linspace(0, 1, 2001)[:, None]
    for _ in range(6):
        starts, ends = rng.uniform(-1, 1, (2, 5, 3))
        ends[2] = starts[2]
        points, normals = rng.uniform(-1, 1, (30, 3)), rng.standard_normal((30, 3))
        radii = rng.uniform(0, 0.1, 5)
        dense = starts + share[:, None] * (ends - starts)
        away = np.linalg.norm(dense[:, :, None] - points, axis=-1).min(axis=0)
        skins = clearances(points, starts, ends, radii)
        np.testing.assert_allclose(skins, (away - radii[:, None]).T, atol=1e-3)
        for thick in (None, radii):
            found = nearest(points, normals, starts, ends, thick)
            skin = away - (0 if thick is None else radii[:, None])
            assert found.distance == pytest.approx(skin.min(), abs=1e-3)
            s, k = np.unravel_index(skin.argmin(), skin.shape)
            assert found.segment == s
            assert np.array_equal(found.on_surface, points[k]) and np.array_equal(found.normal, normals[k])
            each = nearest_each(points, normals, starts, ends, thick)
            np.testing.assert_allclose([one.distance for one in each], skin.min(axis=1), atol=1e-3)
            spot = feet(points, starts, ends)[k, s]
            np.testing.assert_allclose(found.on_arm, spot, atol=1e-12)


def test_without_a_surface_nothing_is_near():
    nothing = np.zeros((0, 3))
    found = nearest(nothing, nothing, *ARM)
    assert found.distance == np.inf and found.segment == -1
    assert np.isnan(found.on_arm).all() and not found.normal.any()
    assert len(nearest_each(nothing, nothing, *ARM[:2])) == 1
