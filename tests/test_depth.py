"""Depth pictures: the pixels they hold, how they err and fail, and that both rigs give the same ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vita.errors import BadInput
from vita.poses import look_at, pose_matrix
from vita.scenario.schema import CameraSpec, ObjectSpec, Scenario, SceneSpec
from vita.scenario.toml_io import dumps, loads
from vita.sim.camera import PinholeCamera
from vita.sim.camera_view import CameraView
from vita.sim.depth_sensor import DepthSensor
from vita.sim.live import LiveRig
from vita.sim.lockstep import LockstepRig
from vita.sim.meshes import box_visual, cylinder_visual, sheet_visual
from vita.sim.render import make_renderer
from vita.sim.render_gl import GlRenderer
from vita.sim.shared_frames import NUMBERS, SharedFrames
from vita.types import JointStep

T_LEFT = look_at((1.25, -0.75, 0.75), (0.5, 0, 0.25))
SCENARIO = Scenario(
    seed=4,
    scene=SceneSpec(objects=(ObjectSpec("card", "card", (0.55, 0.1, 0.02)),)),
    camera=(
        CameraSpec("left", look_from=(1.2, -0.9, 0.7), look_at=(0.45, 0, 0.25), size=(163, 121), depth=True),
        CameraSpec("right", look_from=(1.2, 0.9, 0.7), look_at=(0.45, 0, 0.25), size=(160, 120)),
    ),
)


def some_meshes():
    table = sheet_visual("world", (1.1, 0.7, 0), (0, -1.4, 0), (-1.2, 0, 0), (0.6, 0.4, 0.3), steps=8)
    arm = [cylinder_visual(f"link{k}", 0.05, 0, 0.2, (0.2 * k, 0.5, 0.8)) for k in range(3)]
    return [table, *arm]


def poses(t):
    return {
        f"link{k}": pose_matrix((0.3 + 0.1 * k, 0, 0.1 * k), (20 * np.sin(t + k), 30 * k, 5 * t))
        for k in range(3)
    }


@pytest.fixture(scope="module")
def rig():
    with LockstepRig(SCENARIO) as rig:
        yield rig


@pytest.fixture
def fresh(rig):
    """The rig at its start, at rest and in good health."""
    rig.command(None)
    rig.release()
    rig.hard_reset(np.radians([0, -35, 0, 110, 0, 15, 0]))
    return rig


# ---- which pixels --------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["gl", "tiny"])
def test_a_depth_picture_holds_every_fourth_row_and_column_of_the_whole_one(backend):
    """Also where the picture's size is no multiple of four; at edges a pixel may fall to either side."""
    renderer = make_renderer(some_meshes(), backend)
    for size in ((320, 240), (163, 121), (158, 119)):
        camera = PinholeCamera("c", size, 40)
        whole = renderer.depth(camera, T_LEFT, poses(0.3))[::4, ::4]
        few = renderer.depth(camera, T_LEFT, poses(0.3), 4)
        assert few.shape == whole.shape and few.dtype == np.float32
        np.testing.assert_array_equal(np.isinf(few), np.isinf(whole))
        seen = np.isfinite(whole)
        assert seen.sum() > 500
        assert np.mean(np.abs(few[seen] - whole[seen]) < 1e-5) > 0.999
    renderer.close()


def test_a_depth_picture_unprojects_onto_the_plane_that_it_shows():
    """With the full picture's intrinsics at four times the row and column, exactly."""
    plane = sheet_visual("plane", (1, 1, 0), (0, -2, 0), (-2, 0, 0), steps=8)
    renderer, camera = GlRenderer([plane]), PinholeCamera("c", (643, 477), 40)
    pose = pose_matrix((0.5, 0, 0.1), (10, -15, 0))
    depth = renderer.depth(camera, T_LEFT, {"plane": pose}, 4).astype(float)
    v, u = np.nonzero(np.isfinite(depth))
    assert len(v) > 5000
    rays = np.stack([4 * u, 4 * v, np.ones(len(u))], 1) @ np.linalg.inv(camera.intrinsics).T
    world = (rays * depth[v, u][:, None]) @ T_LEFT[:3, :3].T + T_LEFT[:3, 3]
    assert np.abs((world - pose[:3, 3]) @ pose[:3, 2]).max() < 2e-6
    renderer.close()


def test_what_stands_still_is_kept_and_nothing_is_left_behind():
    """Distances equal those drawn from scratch while arm, camera and lens change, to the bit."""
    kept, anew = GlRenderer(some_meshes()), GlRenderer(some_meshes(), cache=False)
    for k in range(24):
        camera = PinholeCamera("c", (160, 120), 40 if k < 20 else 50)
        T = T_LEFT if k < 16 else look_at((1.25, -0.7, 0.75), (0.5, 0, 0.25))
        bodies = poses(0.1 * min(k, 3)) | {"link2": pose_matrix((0.5, 0.05 * (k // 12), 0.2))}
        kept.render(camera, T, bodies)
        assert np.array_equal(kept.depth(camera, T, bodies, 4), anew.depth(camera, T, bodies, 4))
    kept.close()
    anew.close()


def test_the_fallback_takes_its_distances_from_the_picture_it_has_just_drawn(monkeypatch):
    """And draws anew where anything has changed since."""
    renderer, camera = make_renderer(some_meshes(), "tiny"), PinholeCamera("c", (160, 120), 40)
    drawn = []
    shoot = renderer._shoot  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setattr(renderer, "_shoot", lambda *a: drawn.append(1) or shoot(*a))
    renderer.render(camera, T_LEFT, poses(0))
    first = renderer.depth(camera, T_LEFT, poses(0), 4)
    assert len(drawn) == 1
    second = renderer.depth(camera, T_LEFT, poses(1), 4)
    assert len(drawn) == 2 and not np.array_equal(first, second)
    renderer.depth(PinholeCamera("c", (160, 120), 45), T_LEFT, poses(1), 4)
    assert len(drawn) == 3
    renderer.close()


# ---- how it errs ---------------------------------------------------------------------------------


def test_noise_grows_with_the_square_of_the_distance():
    """And has the deviation asked for at 1 m; where nothing is, nothing is measured."""
    for distance in (0.5, 1.0, 2.0):
        wall = box_visual("wall", (4, 2.0, 0.02), (1, 1, 1), pose_matrix((0, 0, distance + 0.01)))
        renderer, camera = GlRenderer([wall]), PinholeCamera("c", (640, 480), 60)
        depth = DepthSensor(camera, 3.0, 5).measure(renderer, np.eye(4), {"wall": np.eye(4)}, ())
        assert np.isinf(depth).any() == (distance == 2.0)
        error = 1e3 * (depth[np.isfinite(depth)] - distance)
        assert abs(error.mean()) < 0.1 * distance**2
        assert error.std() == pytest.approx(3.0 * distance**2, rel=0.03)
        renderer.close()


def test_noise_is_repeatable_and_leaves_the_pictures_as_they_were():
    """A seed gives the same depths again, other cameras other ones; what a camera shows does not depend on
    whether it measures depth."""
    spec = SCENARIO.camera[0]
    renderer = GlRenderer(some_meshes())

    def views(spec, seed=7):
        view, seen = CameraView(spec, 2.0, seed, 2.0), []
        for now in (0.0, 0.1):
            frame = view.frame(renderer, poses(0), now)
            seen.append((frame, view.depth(renderer, poses(0), now)))
        return seen

    one, same, without = views(spec), views(spec), views(replace(spec, depth=False))
    for a, b, c in zip(one, same, without, strict=True):
        assert np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])
        assert np.array_equal(a[0], c[0]) and c[1] is None
    others = [one[1], views(replace(spec, name="other"))[0], views(spec, seed=8)[0]]
    assert not any(np.array_equal(one[0][1], other[1]) for other in others)
    renderer.close()


# ---- on a rig ------------------------------------------------------------------------------------


def test_only_cameras_with_depth_measure_it(fresh):
    """Read-only, a quarter of the frame's size, and of the moment of the frames: it shows the table's top."""
    seen = fresh.observe()
    assert list(seen.depths) == ["left"]
    depth = seen.depths["left"]
    assert depth.shape == (31, 41) and depth.dtype == np.float32
    with pytest.raises(ValueError):
        depth[0, 0] = 1.0
    camera, T = PinholeCamera("left", (163, 121)), fresh.poses()["camera:left"]
    v, u = np.nonzero(np.isfinite(depth))
    rays = np.stack([4 * u, 4 * v, np.ones(len(u))], 1) @ np.linalg.inv(camera.intrinsics).T
    world = (rays * depth[v, u][:, None]) @ T[:3, :3].T + T[:3, 3]
    assert (np.abs(world[:, 2]) < 1e-5).mean() > 0.2


def test_depth_follows_the_arm_and_freezes_with_the_picture(fresh):
    first = fresh.observe()
    fresh.command(JointStep(np.array([0.2, 0, 0, 0, 0, 0, 0]), first.q, first.stamp))
    fresh.observe()
    moved = fresh.observe()
    assert not np.array_equal(moved.depths["left"], first.depths["left"])
    fresh.perform("freeze_camera", camera="left")
    for _ in range(3):
        now = fresh.observe()
        assert np.array_equal(now.depths["left"], moved.depths["left"])
        assert np.array_equal(now.frames["left"], moved.frames["left"])
    fresh.perform("unfreeze_camera", camera="left")
    assert not np.array_equal(fresh.observe().depths["left"], moved.depths["left"])


def test_a_dark_lens_measures_nothing_and_a_cover_hides_what_is_behind_it(fresh):
    """What could not be measured is NaN, not free space; the rest of the picture stays as it is."""
    clear = fresh.observe().depths["left"]
    assert not np.isnan(clear).any()
    fresh.perform("cover", camera="left", at=(60.0, 40.0), size_px=32.0)
    seen = fresh.observe()
    dark = np.isnan(seen.depths["left"])
    grey = np.zeros((121, 163), dtype=bool)
    grey[24:56, 44:76] = True
    assert np.array_equal(dark, grey[::4, ::4]) and dark.sum() == 64
    assert np.array_equal(seen.depths["left"][~dark], clear[~dark])
    fresh.perform("black_camera", camera="left")
    assert np.isnan(fresh.observe().depths["left"]).all()
    fresh.perform("uncover", camera="left")
    assert np.array_equal(fresh.observe().depths["left"], clear)


def test_the_live_rig_gives_the_depths_of_the_lockstep_rig(fresh):
    """At rest, through shared memory, beside a camera without depth; frozen with the picture."""
    expected = fresh.observe().depths["left"]
    with LiveRig(SCENARIO) as live:
        live.hard_reset(np.radians([0, -35, 0, 110, 0, 15, 0]))
        seen = live.observe(5.0)
        assert list(seen.depths) == ["left"]
        assert np.array_equal(seen.depths["left"], expected)
        with pytest.raises(ValueError):
            seen.depths["left"][0, 0] = 1.0
        live.perform("black_camera", camera="left")
        assert np.isnan(live.observe(5.0).depths["left"]).all()


def test_depths_lie_beside_the_frames_in_shared_memory():
    """Neither overwrites the other in any slot of the ring, and what was read does not change."""
    cameras = [("a", (9, 7)), ("b", (5, 3)), ("c", (8, 8))]
    owner = SharedFrames(cameras, None, ["a", "c"])
    other = SharedFrames(cameras, owner.name, ["a", "c"])
    try:
        for number in range(1, 7):
            frames = {
                name: np.full((h, w, 3), number + k, np.uint8) for k, (name, (w, h)) in enumerate(cameras)
            }
            depths = {"a": np.full((2, 3), number + 0.5, "f4"), "c": np.full((2, 2), -number, "f4")}
            numbers = dict.fromkeys(NUMBERS, 0.0) | {"number": number}
            other.publish(numbers, np.zeros(7), {"x": np.eye(4)}, frames, depths)
        seen = owner.read(7, ["x"])
        assert seen is not None and set(seen.depths) == {"a", "c"}
        for name, image in frames.items():
            assert np.array_equal(seen.frames[name], image)
        for name, depth in depths.items():
            assert np.array_equal(seen.depths[name], depth)
        other.publish(numbers | {"number": 10}, np.zeros(7), {"x": np.eye(4)}, frames, {"a": 0 * depths["a"]})
        assert np.array_equal(seen.depths["a"], depths["a"])
    finally:
        other.close()
        owner.close()


def test_the_file_says_which_cameras_measure_depth_and_how_well():
    text = "schema = 1\n[scene]\ndepth_noise_mm = {}\n[[camera]]\nname = 'left'\nlook_from = [1, 0, 1]\n"
    text += "look_at = [0, 0, 0]\ndepth = true\n"
    scenario = loads(text.format(2.5))
    assert scenario.scene.depth_noise_mm == 2.5 and scenario.camera[0].depth
    with pytest.raises(BadInput, match="depth_noise_mm"):
        loads(text.format(-1.0))
    assert loads(dumps(scenario)) == scenario
