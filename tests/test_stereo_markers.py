"""Laws of the markers in two pictures, on rendered frames against the scene's own geometry."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vita.errors import BadInput, UnknownName
from vita.scenario.schema import CameraSpec
from vita.sim.camera import PinholeCamera, camera_pose
from vita.sim.environment import build_environment
from vita.sim.objects import build_object
from vita.sim.render import Renderer, make_renderer
from vita.sim.tools import build_tool
from vita.stereo.base import Lens, MarkerCorners, StereoRig, marker_square
from vita.stereo.projection import project
from vita.vision.images import Crop
from vita.vision.marker_code import Code
from vita.vision.marker_pose import marker_pose
from vita.vision.marker_search import MarkerSearch
from vita.vision.stereo_markers import StereoMarkers
from vita.vision.stereo_rig import stereo_rig_of

NUMBERS = {"tool": 7, "target": 5}
SIZES = {"tool": 0.05, "target": 0.08}
EYES = ("left", "right")
HEAD = np.eye(4)
HEAD[:3, :3] = np.array([[0.0, -0.15, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.15]])
HEAD[:3, :3] = np.linalg.svd(HEAD[:3, :3])[0] @ np.linalg.svd(HEAD[:3, :3])[2]
HEAD[:3, 3] = 1.6, 0.0, 0.75
"""World pose of what carries both cameras: it looks along -x and a little down."""
T_TOOL_MARKER = np.eye(4)
T_TOOL_MARKER[:3, :3] = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
T_TOOL_MARKER[:3, 3] = 0.0, 0.0, 0.085
"""The drawing of `marker_tool`: its right is the tool's y, its up the tool's -z, its face looks along -x."""


class Scene:
    """Tool and target in front of two cameras 0.2 m apart, drawn without an arm."""

    def __init__(self, renderer: Renderer, fov_deg: float) -> None:
        specs = [
            CameraSpec(name, mount="tripod", xyz=(x, 0, 0), fov_deg=fov_deg)
            for name, x in zip(EYES, (-0.1, 0.1), strict=True)
        ]
        # The renderer knows a camera by its name, and takes one that changes its lens for one that moved.
        names = [f"{spec.name} {fov_deg}" for spec in specs]
        self._renderer = renderer
        self._lenses = [PinholeCamera(n, s.size, s.fov_deg) for n, s in zip(names, specs, strict=True)]
        self._cameras = [camera_pose(spec, {"tripod": HEAD}) for spec in specs]
        self.rig = stereo_rig_of(specs[0], specs[1])
        self._rng = np.random.default_rng(0)
        self._grain = self._rng.standard_normal((480 + 64, 640 + 64, 3), dtype=np.float32)

    def eyes(self) -> StereoMarkers:
        return StereoMarkers(self.rig, EYES, NUMBERS)

    def frames(self, markers: dict[str, np.ndarray], noise: float = 2.0) -> dict[str, np.ndarray]:
        """Both pictures of the markers at these T_left_marker, with `noise` [grey levels]."""
        bodies = {name: self._cameras[0] @ T for name, T in markers.items()}
        bodies["tool"] = bodies["tool"] @ np.linalg.inv(T_TOOL_MARKER)
        pictures = {}
        for eye, lens, T in zip(EYES, self._lenses, self._cameras, strict=True):
            clean = self._renderer.render(lens, T, bodies)
            u, v = self._rng.integers(0, 64, 2)
            noisy = clean + np.float32(noise) * self._grain[u : u + 480, v : v + 640]
            pictures[eye] = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        return pictures

    def truth(self, T: np.ndarray, size: float) -> dict[str, np.ndarray]:
        """(4, 2) pixels of a marker's corners in both pictures, by the projection of eq. 7."""
        points = marker_square(size) @ T[:3, :3].T + T[:3, 3]
        right = points @ self.rig.T_right_left[:3, :3].T + self.rig.T_right_left[:3, 3]
        return {"left": project(self.rig.left, points), "right": project(self.rig.right, right)}


@pytest.fixture(scope="module")
def scenes() -> Iterator[dict[int, Scene]]:
    renderer = make_renderer((*build_tool("marker_tool"), *build_object("target", "target"),
                              *build_environment(True)))  # fmt: skip
    made = {50: Scene(renderer, 50.0), 33: Scene(renderer, 33.4)}
    for scene in made.values():
        for _ in range(4):  # Until cameras that stand still are drawn at their best.
            scene.frames({"tool": pose(1.0), "target": pose(1.2)})
    yield made
    renderer.close()


def pose(z: float, x: float = 0.0, y: float = 0.0, tilt_deg=(0.0, 0.0, 0.0)) -> np.ndarray:
    """T_left_marker of a marker at (x, y, z) that is tilted from looking straight at the left camera."""
    T = np.eye(4)
    turn = Rotation.from_rotvec(np.radians(tilt_deg)) * Rotation.from_euler("x", 180, degrees=True)
    T[:3, :3], T[:3, 3] = turn.as_matrix(), (x, y, z)
    return T


def apart(T: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Distance [mm] and angle [deg]."""
    turn = Rotation.from_matrix(T[:3, :3] @ truth[:3, :3].T)
    return 1e3 * float(np.linalg.norm(T[:3, 3] - truth[:3, 3])), float(np.degrees(turn.magnitude()))


def walk(k: int) -> dict[str, np.ndarray]:
    """Both markers on their way: up to 5 px and 2 degrees a frame."""
    s, c = np.sin(k / 7), np.cos(k / 9)
    return {
        "tool": pose(1.0 + 0.1 * s, 0.02 + 0.05 * c, 0.06 * s, (25 * s, 20 * c, 2 * k)),
        "target": pose(1.2, 0.25 + 0.08 * s, 0.05 * c, (20 * c, -30 * s, -1.5 * k)),
    }


def test_the_projection_agrees_with_the_rendered_picture(scenes):
    """T2 asks for half a pixel: every corner of both markers, in both pictures, is within 0.15 px."""
    for scene in scenes.values():
        for tilt in ((0, 0, 0), (35, 0, 20), (0, -35, 200)):
            placed = {"tool": pose(0.9, 0.03, 0.02, tilt), "target": pose(1.1, 0.17, -0.03, tilt)}
            got = scene.eyes().look(scene.frames(placed))
            for name, corners in got.items():
                truth = scene.truth(placed[name], SIZES[name])
                for seen, true in ((corners.left, truth["left"]), (corners.right, truth["right"])):
                    assert seen is not None and np.abs(seen - true).max() < 0.15, (name, tilt)


def test_the_corners_are_as_good_as_they_say(scenes):
    """Over a walk the errors of all coordinates are about as large as the sigma that is told, or less."""
    scene = scenes[50]
    eyes, off = scene.eyes(), []
    for k in range(30):
        placed = walk(k)
        for name, corners in eyes.look(scene.frames(placed)).items():
            truth = scene.truth(placed[name], SIZES[name])
            assert corners.left is not None and corners.right is not None
            off += [(corners.left - truth["left"]) / corners.sigma_px]
            off += [(corners.right - truth["right"]) / corners.sigma_px]
            assert 0.01 < corners.sigma_px < 0.2
    size = np.sqrt(np.mean(np.square(off)))
    assert 0.2 < size < 1.1, size
    assert np.abs(np.mean(off, axis=0)).max() < 0.75, "no offset such as a detector's half pixel"


@pytest.mark.parametrize(
    ("fov", "z", "mm", "deg"), [(50, 0.8, 0.5, 0.5), (50, 1.2, 1.5, 1.5), (33, 1.6, 1.5, 1.5)]
)
def test_pictures_give_poses(scenes, fov, z, mm, deg):
    """From frames to poses of both markers: within these limits in every frame of a tumbling motion."""
    scene = scenes[fov]
    eyes = scene.eyes()
    for k in range(8):
        s, c = np.sin(k / 2), np.cos(k / 3)
        placed = {
            "tool": pose(z, 0.03 + 0.01 * s, 0.01 * c, (25 * s, 25 * c, 0)),
            "target": pose(z, 0.17, 0.02 * s, (-25 * c, 25 * s, 30)),
        }
        for name, corners in eyes.look(scene.frames(placed)).items():
            sight = marker_pose(scene.rig, corners, SIZES[name])
            off_mm, off_deg = apart(sight.T_left_marker, placed[name])
            assert off_mm < mm and off_deg < deg, (name, k, off_mm, off_deg)


def test_the_face_looks_back_at_the_camera(scenes):
    """z of the found pose points out of the printed face: to the cameras, for both markers."""
    placed = {"tool": pose(1.0, 0.02), "target": pose(1.0, 0.2)}
    for name, corners in scenes[50].eyes().look(scenes[50].frames(placed)).items():
        T = marker_pose(scenes[50].rig, corners, SIZES[name]).T_left_marker
        assert T[2, 2] < -0.99 and T[1, 1] < -0.99 and T[0, 0] > 0.99


def test_what_is_followed_is_not_searched_and_one_search_serves_all(scenes, monkeypatch):
    """Whole pictures are searched only for what is missing, and once for all that are."""
    scene, searches = scenes[50], []
    find = MarkerSearch.find

    def counted(self, crop):
        searches.append(crop.gray.shape == (480, 640))
        return find(self, crop)

    monkeypatch.setattr(MarkerSearch, "find", counted)
    eyes = scene.eyes()
    eyes.look(scene.frames(walk(0)))
    assert searches == [True, True], "two markers, one search in each picture"
    for k in range(1, 12):
        eyes.look(scene.frames(walk(k)))
    assert sum(searches) == 2
    assert searches.count(False) < 11, "nor the surroundings, most of the time"
    gone = {"tool": walk(12)["tool"], "target": pose(1.2, 5.0)}
    before = sum(searches)
    frames = scene.frames(gone)
    for _ in range(75):
        got = eyes.look(frames)
        assert got["tool"].seen and not got["target"].seen
    assert 20 < sum(searches) - before < 85, "the one that stays away is sought less often"
    assert any(eyes.look(scene.frames(walk(12)))["target"].seen for _ in range(4)), "and yet found again"


def test_a_marker_that_jumps_is_found_in_the_same_frame(scenes):
    scene = scenes[50]
    eyes = scene.eyes()
    eyes.look(scene.frames(walk(0)))
    placed = {"tool": pose(0.8, 0.1, -0.15, (0, 20, 120)), "target": pose(1.4, -0.1, 0.1, (20, 0, -100))}
    for name, corners in eyes.look(scene.frames(placed)).items():
        truth = scene.truth(placed[name], SIZES[name])
        assert corners.left is not None and np.abs(corners.left - truth["left"]).max() < 0.5
        assert corners.right is not None and np.abs(corners.right - truth["right"]).max() < 0.5


@pytest.mark.parametrize("side", range(4))
def test_covered_by_a_third_it_is_not_seen_by_that_camera_alone(scenes, side):
    """A grey sheet over a third of the target's left picture, from each of its sides."""
    scene, placed = scenes[50], walk(3)
    eyes = scene.eyes()
    eyes.look(scene.frames(placed))
    frames = scene.frames(placed)
    corners = np.roll(scene.truth(placed["target"], 0.1)["left"], -side, axis=0)
    third = np.array([corners[0], corners[1], corners[1] + (corners[2] - corners[1]) * 0.4,
                      corners[0] + (corners[3] - corners[0]) * 0.4])  # fmt: skip
    cv2.fillConvexPoly(frames["left"], np.rint(third).astype(np.int32), (128, 130, 126))
    for _ in range(3):
        got = eyes.look(frames)
        assert got["target"].left is None and got["target"].right is not None
        assert got["tool"].left is not None
        assert ("left", "target") not in eyes.corners and ("right", "target") in eyes.corners


def test_a_finger_on_the_code_is_a_loss_though_the_outline_is_whole(scenes):
    """More cells than one read wrong: whatever covers them may cover the outline as well."""
    scene, placed = scenes[50], walk(3)
    eyes = scene.eyes()
    eyes.look(scene.frames(placed))
    frames = scene.frames(placed)
    corners = scene.truth(placed["target"], 0.08)["left"]
    u, v = np.rint(corners.mean(axis=0)).astype(int).tolist()
    side = float(np.linalg.norm(corners[1] - corners[0]))
    cv2.circle(frames["left"], (u, v), round(0.1 * side), (222, 180, 160), -1)
    got = eyes.look(frames)["target"]
    assert got.left is None and got.right is not None


def test_edge_on_blurred_or_black_it_is_not_seen_and_then_again(scenes):
    scene, placed = scenes[50], walk(3)
    eyes = scene.eyes()
    good = scene.frames(placed)
    edge = dict(placed, target=pose(1.2, 0.3, 0.05, (82, 0, 0)))
    smear = {name: cv2.blur(frame, (41, 1)) for name, frame in good.items()}
    black = {name: np.zeros_like(frame) for name, frame in good.items()}
    for bad in (scene.frames(edge), smear, black):
        assert eyes.look(good)["target"].left is not None
        assert eyes.look(bad)["target"].left is None
    assert eyes.look(good)["target"].left is not None


def test_another_number_in_its_place_is_not_it(scenes):
    scene = scenes[50]
    placed = {"tool": pose(1.0, 0.02), "target": pose(1.0, 0.2)}
    eyes = StereoMarkers(scene.rig, EYES, {"tool": 5, "target": 9})
    got = eyes.look(scene.frames(placed))
    assert not got["target"].seen and got["tool"].seen
    assert np.abs(got["tool"].left - scene.truth(placed["target"], 0.08)["left"]).max() < 0.15


def test_slow_motion_blur_leaves_the_corners_at_the_middle_of_the_exposure(scenes):
    """Six pictures along a way of 2.5 px, four fifths of a cell, averaged as an open shutter does."""
    scene, eyes = scenes[50], scenes[50].eyes()
    for k in range(6):
        way = [pose(1.0, 0.02 + 0.005 * (k + t), 0.0, (15, 10, 0)) for t in np.linspace(0, 1, 6)]
        shots = [scene.frames({"tool": T, "target": pose(1.0, 0.3)}, noise=0) for T in way]
        frames = {c: np.mean([s[c] for s in shots], axis=0).round().astype(np.uint8) for c in EYES}
        corners = eyes.look(frames)["tool"]
        middle = scene.truth(pose(1.0, 0.02 + 0.005 * (k + 0.5), 0.0, (15, 10, 0)), 0.05)
        assert corners.left is not None and np.abs(corners.left - middle["left"]).max() < 0.4
        assert np.abs(corners.left - middle["left"]).max() < 4 * corners.sigma_px


def test_distortion_is_taken_off_and_the_raw_corners_stay_where_the_picture_has_them(scenes):
    """The picture is bent as the lens model says; the corners come out straight."""
    scene, placed = scenes[50], walk(0)
    lens = Lens(scene.rig.left.fx, scene.rig.left.fy, 319.5, 239.5, (-0.25, 0.08, 0.001, -0.002, 0.0))
    rig = StereoRig(lens, scene.rig.right, scene.rig.T_right_left)
    frames = scene.frames(placed)
    grid = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1).reshape(-1, 1, 2)
    ideal = cv2.undistortPoints(grid, lens.matrix, np.array(lens.distortion), P=lens.matrix)
    ideal = ideal.reshape(480, 640, 2).astype(np.float32)
    frames["left"] = cv2.remap(frames["left"], ideal, None, cv2.INTER_LINEAR)  # pyright: ignore
    eyes = StereoMarkers(rig, EYES, NUMBERS)
    corners = eyes.look(frames)["target"]
    truth = scene.truth(placed["target"], 0.08)["left"]
    assert corners.left is not None and np.abs(corners.left - truth).max() < 0.25
    rays = np.column_stack([(truth - (lens.cx, lens.cy)) / lens.fx, np.ones(4)])
    bent, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), lens.matrix, np.array(lens.distortion))
    raw = eyes.corners["left", "target"]
    assert np.abs(raw - bent[:, 0]).max() < 0.25 and np.abs(raw - truth).max() > 0.5


def test_the_search_knows_every_turn_and_small_codes(scenes):
    """Any way up, down to cells of two pixels, and with its corners in the code's own order."""
    scene, search = scenes[50], MarkerSearch([Code("6X6_250", 7), Code("6X6_250", 5)])
    for turn in range(0, 360, 45):
        placed = {"tool": pose(1.55, 0.02, 0.0, (0, 0, turn)), "target": pose(1.2, 0.3, 0, (0, 0, -turn))}
        crop = Crop(cv2.cvtColor(scene.frames(placed)["left"], cv2.COLOR_RGB2GRAY), np.zeros(2))
        found = search.find(crop)
        for name, number in NUMBERS.items():
            truth = scene.truth(placed[name], SIZES[name])["left"]
            near = [quad for n, quad in found if n == number and np.abs(quad - truth).max() < 2.0]
            assert near, (turn, name)


def test_two_runs_are_identical(scenes):
    frames = [scenes[50].frames(walk(k)) for k in range(5)]
    runs = [[eyes.look(f)["tool"] for f in frames] for eyes in (scenes[50].eyes(), scenes[50].eyes())]
    for a, b in zip(*runs, strict=True):
        assert np.array_equal(a.left, b.left) and a.sigma_px == b.sigma_px  # pyright: ignore


def test_bad_input_is_refused_and_bad_frames_are_losses(scenes):
    scene = scenes[50]
    for cameras, numbers, why in (
        (("left", "left"), NUMBERS, "two different cameras"),
        (EYES, {"tool": 5, "target": 5}, "number of its own"),
        (EYES, {}, "number of its own"),
        (EYES, {"tool": 250}, "0 to 249"),
        (EYES, {"tool": -1}, "0 to 249"),
    ):
        with pytest.raises(BadInput, match=why):
            StereoMarkers(scene.rig, cameras, numbers)
    eyes, frames = scene.eyes(), scene.frames(walk(0))
    with pytest.raises(UnknownName, match="right"):
        eyes.look({"left": frames["left"]})
    for bad in (None, frames["left"][:0], frames["left"].astype(float)):
        got = eyes.look({"left": bad, "right": frames["right"]})  # type: ignore[dict-item]
        assert got["tool"].left is None and got["tool"].right is not None
    assert isinstance(got["tool"], MarkerCorners)
