"""Camera images: geometry against the pinhole model, the cached background against drawing it all."""

import threading
import warnings

import numpy as np
import pytest

from vita.errors import BadInput, UnknownName
from vita.poses import look_at, pose_matrix
from vita.sim.camera import PinholeCamera
from vita.sim.meshes import box_visual, cylinder_visual, sheet_visual, sphere_visual
from vita.sim.objects import build_object
from vita.sim.render import STILL_AFTER, make_renderer
from vita.sim.render_gl import GlRenderer

LEFT, RIGHT = PinholeCamera("left", (320, 240), 40), PinholeCamera("right", (320, 240), 40)
T_LEFT, T_RIGHT = look_at((1.25, -0.75, 0.75), (0.5, 0, 0.25)), look_at((1.25, 0.75, 0.75), (0.5, 0, 0.25))


def scene():
    """A table, a printed object and an arm of three bodies."""
    table = sheet_visual("world", (1.1, 0.7, 0), (0, -1.4, 0), (-1.2, 0, 0), (0.6, 0.4, 0.3), steps=8)
    arm = [cylinder_visual(f"link{k}", 0.05, 0, 0.2, (0.2 * k, 0.5, 0.8)) for k in range(3)]
    return [table, *build_object("card", "card"), *build_object("cube", "cube"), *arm]


def poses(t, card=0.0):
    bodies = {"card": pose_matrix((0.6 + card, 0, 0.02)), "cube": pose_matrix((0.4, 0.2, 0.03), (0, 0, 30))}
    for k in range(3):
        bodies[f"link{k}"] = pose_matrix((0.3 + 0.1 * k, 0, 0.1 * k), (20 * np.sin(t + k), 30 * k, 5 * t))
    return bodies


@pytest.fixture(scope="module")
def cached():
    renderer = GlRenderer(scene())
    yield renderer
    renderer.close()


@pytest.fixture(scope="module")
def uncached():
    renderer = GlRenderer(scene(), cache=False)
    yield renderer
    renderer.close()


def assert_same(cached, uncached, camera, T, bodies):
    assert np.array_equal(cached.render(camera, T, bodies), uncached.render(camera, T, bodies))


def test_cached_pictures_equal_uncached_ones_while_the_arm_moves(cached, uncached):
    for k in range(8):
        for camera, T in ((LEFT, T_LEFT), (RIGHT, T_RIGHT)):
            assert_same(cached, uncached, camera, T, poses(0.2 * k))


def test_cached_pictures_stay_right_after_the_camera_moved(cached, uncached):
    for k in range(4):
        T = look_at((1.25, -0.75 + 0.1 * (k // 2), 0.75), (0.5, 0, 0.25))
        assert_same(cached, uncached, LEFT, T, poses(0.3 * k))
    for fov in (30, 50):
        assert_same(cached, uncached, PinholeCamera("left", (320, 240), fov), T_LEFT, poses(0.1))


def test_cached_pictures_stay_right_while_and_after_a_still_body_is_dragged(cached, uncached):
    for k in range(40):
        bodies = poses(0.05 * k, card=0.01 * min(k, 12))
        if k % 4 == 0 or k < 16:
            assert_same(cached, uncached, LEFT, T_LEFT, bodies)
        else:
            cached.render(LEFT, T_LEFT, bodies)


def test_a_body_that_leaves_the_image_leaves_nothing_behind(cached, uncached):
    for x in (0.6, 5.0, 0.6, -8.0):
        assert_same(cached, uncached, LEFT, T_LEFT, {**poses(0), "cube": pose_matrix((x, 0, 0.1))})


def test_a_body_through_the_camera_does_not_break_the_cache(cached, uncached):
    for shift in (0.0, 0.01, 0.02):
        bodies = {**poses(0), "link0": pose_matrix((1.25 - shift, -0.75, 0.6))}
        assert_same(cached, uncached, LEFT, T_LEFT, bodies)


def test_copying_a_rectangle_equals_copying_all_of_it(cached, monkeypatch):
    """The fallback for drivers without the direct copy gives the same pictures."""
    monkeypatch.setattr("vita.sim.gl_copy._function", lambda name: None)
    other = GlRenderer(scene())
    for k in range(6):
        camera = PinholeCamera("copied", (320, 240), 40)  # One that neither of them has seen before.
        assert_same(cached, other, camera, T_LEFT, poses(0.2 * k))
    other.close()


def test_a_camera_that_moved_gets_its_best_picture_when_it_has_stood_still(uncached):
    """While it moves its pictures are coarser but alike: no brighter, and nothing is displaced."""
    camera = PinholeCamera("moved", (320, 240), 40)
    best = uncached.render(camera, T_LEFT, poses(0)).astype(float)  # The first picture is a good one.
    uncached.render(camera, T_RIGHT, poses(0))
    plain = uncached.render(camera, T_LEFT, poses(0)).astype(float)
    assert 0 < np.abs(plain - best).mean() < 1.5 and abs(plain.mean() - best.mean()) < 0.1
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        assert np.abs(np.roll(plain, (dy, dx), (0, 1)) - best).mean() > 2 * np.abs(plain - best).mean()
    for _ in range(STILL_AFTER):
        again = uncached.render(camera, T_LEFT, poses(0))
    assert np.array_equal(again, best)


def test_two_renderers_give_the_same_bits():
    first, second = GlRenderer(scene()), GlRenderer(scene())
    assert np.array_equal(first.render(LEFT, T_LEFT, poses(1)), second.render(LEFT, T_LEFT, poses(1)))
    assert np.array_equal(first.depth(LEFT, T_LEFT, poses(1)), second.depth(LEFT, T_LEFT, poses(1)))
    first.close()
    second.close()


def test_pictures_cannot_be_written_to(cached):
    for k in range(3):
        with pytest.raises(ValueError):
            cached.render(LEFT, T_LEFT, poses(k))[0, 0] = 0


@pytest.mark.parametrize("backend, samples, most", [("gl", 4, 0.3), ("gl", 0, 0.3), ("tiny", 0, 1.5)])
def test_a_ball_is_seen_where_the_camera_model_says(backend, samples, most):
    camera, T = PinholeCamera("c", (640, 480), 40), look_at((1.25, -0.75, 0.75), (0.5, 0, 0.25))
    renderer = make_renderer([sphere_visual("ball", 0.01, (1.0, 0.1, 0.1))], backend, samples)
    for xyz in [(0.5, 0, 0.25), (0.3, 0.2, 0.3), (0.55, -0.25, 0.1), (0.7, 0.1, 0.4), (0.2, -0.2, 0.5)]:
        picture = renderer.render(camera, T, {"ball": pose_matrix(xyz)}).astype(float)
        # Red without green and blue is the ball; how much of it is how far the pixel is covered.
        weight = np.clip(picture[:, :, 0] - picture[:, :, 1] - 25, 0, 80)
        rows, columns = np.indices(weight.shape)
        seen = np.array([(weight * columns).sum(), (weight * rows).sum()]) / weight.sum()
        assert np.linalg.norm(seen - camera.project(T, np.array([xyz]))[0]) < most
    renderer.close()


@pytest.mark.parametrize("backend, most_mm", [("gl", 1.0), ("tiny", 8.0)])
def test_the_depth_image_of_a_plane_unprojects_onto_that_plane(backend, most_mm):
    plane = sheet_visual("plane", (1, 1, 0), (0, -2, 0), (-2, 0, 0), steps=8)
    renderer = make_renderer([plane], backend)
    pose = pose_matrix((0.5, 0, 0.1), (10, -15, 0))
    depth = renderer.depth(LEFT, T_LEFT, {"plane": pose}).astype(float)
    v, u = np.nonzero(np.isfinite(depth))
    assert len(v) > 20000
    rays = np.stack([u, v, np.ones(len(u))], 1) @ np.linalg.inv(LEFT.intrinsics).T
    world = (rays * depth[v, u][:, None]) @ T_LEFT[:3, :3].T + T_LEFT[:3, 3]
    heights = (world - pose[:3, 3]) @ pose[:3, 2]
    assert 1000 * np.abs(heights).max() < most_mm
    renderer.close()


def test_depth_is_infinite_where_nothing_is():
    renderer = GlRenderer([box_visual("box", (0.1, 0.1, 0.1), (1, 1, 1))])
    depth = renderer.depth(LEFT, look_at((1, 0, 0), (0, 0, 0)), {"box": np.eye(4)})
    assert depth.dtype == np.float32 and depth.shape == (240, 320)
    assert np.isinf(depth[0, 0]) and np.isclose(depth[120, 160], 0.95, atol=1e-5)
    renderer.close()


@pytest.mark.parametrize("backend", ["gl", "tiny"])
def test_a_printed_face_is_upright_and_not_mirrored(backend):
    """Top left red, top right green, bottom left blue, as on the picture that is printed."""
    picture = np.full((64, 64, 3), 255, np.uint8)
    picture[:32, :32], picture[:32, 32:], picture[32:, :32] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    sheet = sheet_visual("sheet", (-0.2, 0.2, 0), (0.4, 0, 0), (0, -0.4, 0), texture=picture)
    renderer = make_renderer([sheet], backend)
    seen = renderer.render(LEFT, look_at((0, 0, 1), (0, 0, 0), up=(0, 1, 0)), {"sheet": np.eye(4)}).astype(
        int
    )
    for (row, column), channel in {(90, 130): 0, (90, 190): 1, (150, 130): 2}.items():
        assert seen[row, column].argmax() == channel and seen[row, column].min() < 60
    renderer.close()


def test_a_lost_opengl_is_announced_with_its_reason(monkeypatch):
    monkeypatch.setattr(
        "moderngl.create_context", lambda **_: (_ for _ in ()).throw(RuntimeError("no EGL here"))
    )
    with pytest.warns(RuntimeWarning, match="no EGL here"):
        renderer = make_renderer(scene())
    assert renderer.name == "tiny"
    renderer.close()


def test_a_working_opengl_is_taken_in_silence():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        renderer = make_renderer(scene())
    assert renderer.name == "gl"
    renderer.close()
    renderer.close()


def test_another_thread_is_refused(cached):
    caught = []

    def draw():
        try:
            cached.render(LEFT, T_LEFT, poses(0))
        except BadInput as error:
            caught.append(error)

    thread = threading.Thread(target=draw)
    thread.start()
    thread.join()
    assert caught


def test_a_body_without_a_pose_is_named(cached):
    with pytest.raises(UnknownName, match="cube"):
        cached.render(LEFT, T_LEFT, {k: v for k, v in poses(0).items() if k != "cube"})


def test_an_unknown_backend_lists_the_choices():
    with pytest.raises(UnknownName, match="auto, gl, tiny"):
        make_renderer([], "vulkan")  # type: ignore[arg-type]
