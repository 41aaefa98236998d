"""Laws of the marker tracker, on codes drawn with exact ground truth."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from sequences import texture

from vita.errors import BadInput, Untrackable
from vita.scenario.schema import CameraSpec, ObjectSpec, Scenario, SceneSpec
from vita.sim.lockstep import LockstepRig
from vita.vision.marker import MarkerTracker

SIZE = (320, 240)
SQUARE = np.array([[-1.0, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])


def picture(number: int, family: str = "6X6_50", px: int = 24) -> np.ndarray:
    """A code and one cell of white around it, `px` texels a cell."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{family}"))
    cells = cv2.aruco.generateImageMarker(dictionary, number, dictionary.markerSize + 2)
    return np.kron(np.pad(cells, 1, constant_values=255), np.ones((px, px), np.uint8))


def pose(
    u: float, v: float, half: float, turn: float = 0.0, tilt: tuple[float, float] = (0, 0)
) -> np.ndarray:
    """(3, 3) from the marker's square [-1, 1]^2 to pixels."""
    c, s = half * np.cos(turn), half * np.sin(turn)
    return np.array([[c, -s, u], [s, c, v], [0, 0, 1.0]]) @ np.array([[1, 0, 0], [0, 1, 0], [*tilt, 1.0]])


def carried(warp: np.ndarray, points: np.ndarray = SQUARE) -> np.ndarray:
    q = points @ warp.T
    return q[:, :2] / q[:, 2:]


def scene(
    *marks: tuple[int, np.ndarray],
    family: str = "6X6_50",
    seed: int = 0,
    noise: float = 2.0,
    blur: float = 0.5,
    light: float = 1.0,
) -> np.ndarray:
    """A frame with markers (number, pose), later ones in front, drawn 4 times as fine and averaged."""
    fine = 4
    wide = cv2.resize(texture(5, 300), (SIZE[0] * fine, SIZE[1] * fine)).clip(0, 255)
    for number, warp in marks:
        code = picture(number, family).astype(np.float32)
        side = code.shape[0]
        inner = side - 2 * 24
        into_square = np.array([[2 / inner, 0, (0.5 - 24) * 2 / inner - 1],
                                [0, 2 / inner, (0.5 - 24) * 2 / inner - 1], [0, 0, 1.0]])  # fmt: skip
        finer = np.array([[fine, 0, (fine - 1) / 2], [0, fine, (fine - 1) / 2], [0, 0, 1.0]])
        whole = finer @ warp @ into_square
        # Texels smaller than pixels would flicker: average them first.
        shrink = side / max(1.0, fine * np.ptp(carried(warp)[:, 0]) * side / inner)
        soft = cv2.GaussianBlur(code, (0, 0), max(0.3, 0.4 * shrink))
        cv2.warpPerspective(soft, whole, wide.shape[::-1], dst=wide, borderMode=cv2.BORDER_TRANSPARENT)
    frame = cv2.resize(wide, SIZE, interpolation=cv2.INTER_AREA) * 0.8 * light + 20
    frame = cv2.GaussianBlur(frame, (0, 0), blur)
    frame += np.random.default_rng(seed).normal(0, noise, frame.shape)
    return np.repeat(np.clip(np.rint(frame), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


def wander(k: int, half: float) -> np.ndarray:
    """A motion of about 3 px a frame with turn, scale and tilt."""
    return pose(
        120 + 2.7 * k, 110 + 15 * np.sin(k / 7), half * (1 + 0.1 * np.sin(k / 9)), 0.08 * k,
        (0.12 * np.sin(k / 6), 0.12 * np.cos(k / 8)),
    )  # fmt: skip


@pytest.mark.parametrize("half", [15, 25, 40])
def test_corners_are_within_a_tenth_of_a_pixel(half):
    tracker = MarkerTracker(scene((7, wander(0, half))), carried(wander(0, half))[1])
    off = []
    for k in range(30):
        feature = tracker.update(scene((7, wander(k, half)), seed=k))
        assert feature.ok and feature.corners is not None, k
        truth = carried(wander(k, half))
        off.append(feature.corners - truth)
        assert np.linalg.norm(feature.uv - truth[1]) < 0.35
    assert np.sqrt(np.square(off).sum(axis=2).mean()) < 0.1
    assert np.abs(np.mean(off, axis=(0, 1))).max() < 0.03, "no offset such as the detector's own half pixel"


@pytest.mark.parametrize("family", ["4X4_50", "5X5_50", "6X6_250", "APRILTAG_36h11", "ARUCO_ORIGINAL"])
@pytest.mark.parametrize("turn", [0.3, 1.9, -2.5])
def test_every_common_family_is_known_and_corner_1_is_its_own_top_left(family, turn):
    warp = pose(150, 110, 32, turn)
    tracker = MarkerTracker(scene((11, warp), family=family), (150, 110))
    feature = tracker.update(scene((11, warp), family=family, seed=1))
    assert feature.detail == "marker 11, centre"
    assert feature.corners is not None and np.abs(feature.corners - carried(warp)).max() < 0.3


def test_a_click_near_a_corner_or_the_centre_is_moved_there_and_elsewhere_it_stays():
    warp = pose(150, 110, 40, 0.2, (0.15, -0.1))
    frame = scene((3, warp))
    corner, middle = carried(warp), carried(warp, np.array([[0, 0, 1.0]]))[0]
    for k in range(4):
        feature = MarkerTracker(frame, corner[k] + (4, -4)).update(frame)
        assert feature.detail == f"marker 3, corner {k + 1}" and np.abs(feature.uv - corner[k]).max() < 0.2
    feature = MarkerTracker(frame, middle + (5, 5)).update(frame)
    assert feature.detail == "marker 3, centre" and np.abs(feature.uv - middle).max() < 0.1
    half_way = 0.5 * (middle + corner[2])
    feature = MarkerTracker(frame, half_way).update(frame)
    assert feature.detail == "marker 3, a point on it" and np.abs(feature.uv - half_way).max() < 1e-3


def test_a_point_on_the_marker_stays_on_its_place_of_the_plane():
    """Carried by the homography: the point is at the same place of the square in every frame."""
    spot = np.array([[0.45, -0.35, 1.0]])
    tracker = MarkerTracker(scene((7, wander(0, 30))), carried(wander(0, 30), spot)[0])
    for k in range(0, 30, 2):
        feature = tracker.update(scene((7, wander(k, 30)), seed=k))
        assert feature.ok and np.linalg.norm(feature.uv - carried(wander(k, 30), spot)[0]) < 0.2


def test_two_markers_that_cross_keep_their_numbers():
    """Each passes in front of or behind the other; afterwards each tracker is still on its own."""
    first, second = (lambda k: pose(90 + 4 * k, 120, 26, 0.1)), (lambda k: pose(230 - 4 * k, 122, 26, 0.1))
    start = scene((1, first(0)), (2, second(0)))
    trackers = MarkerTracker(start, (90, 120)), MarkerTracker(start, (230, 122))
    hidden = 0
    for k in range(36):
        frame = scene((1, first(k)), (2, second(k)), seed=k)
        for tracker, warp in zip(trackers, (first(k), second(k)), strict=True):
            feature = tracker.update(frame)
            hidden += not feature.ok
            if feature.ok:
                assert np.linalg.norm(feature.uv - carried(warp, np.array([[0, 0, 1.0]]))[0]) < 0.5, k
    assert all(t.update(frame).ok for t in trackers)
    assert hidden >= 5, "the marker behind was really covered"


def test_it_is_lost_at_once_when_gone_and_found_anywhere_turned_and_scaled():
    warp = pose(90, 80, 30)
    tracker = MarkerTracker(scene((5, warp)), carried(warp)[0])
    last = tracker.update(scene((5, warp), seed=1))
    for k in range(6):
        feature = tracker.update(scene(seed=k))
        assert not feature.ok and feature.score == 0 and "marker 5" in feature.detail
        assert np.array_equal(feature.uv, last.uv)
    assert not tracker.update(scene((6, warp))).ok, "another number in the same place is not it"
    elsewhere = pose(230, 150, 20, 2.2)
    again = [tracker.update(scene((5, elsewhere), seed=k)) for k in range(3)]
    assert again[1].ok and np.linalg.norm(again[1].uv - carried(elsewhere)[0]) < 0.35


@pytest.mark.parametrize("number", [6, None])
def test_another_number_or_an_empty_frame_in_its_place_is_noticed_in_the_same_frame(number):
    warp = pose(150, 110, 30, 0.1)
    tracker = MarkerTracker(scene((5, warp)), (150, 110))
    assert tracker.update(scene((5, warp), seed=1)).ok
    if number is None:
        frame = scene((5, warp), seed=2)
        cv2.fillConvexPoly(
            frame, np.rint(carried(0.97 * warp @ np.diag([1, 1, 1 / 0.97]))).astype(int), (30, 30, 30)
        )
    else:
        frame = scene((number, warp), seed=2)
    assert not tracker.update(frame).ok


def test_a_stain_on_the_outline_does_not_pull_the_corners():
    """A dark drop over a sixth of one side, half of it outside: the line is fitted to the rest."""
    warp = pose(150, 110, 40, 0.15)
    tracker = MarkerTracker(scene((5, warp)), carried(warp)[1])
    u, v = carried(warp, np.array([[-0.3, -1.0, 1]]))[0]
    for k in range(3):
        frame = scene((5, warp), seed=k)
        cv2.circle(frame, (round(u), round(v)), 6, (40, 40, 40), -1)
        feature = tracker.update(frame)
        assert feature.ok and feature.corners is not None
        assert np.linalg.norm(feature.corners - carried(warp), axis=1).max() < 0.15


def test_fast_motion_blur_and_light_do_not_lose_it():
    half = 25
    tracker = MarkerTracker(scene((9, pose(60, 110, half))), (60, 110))
    for k in range(1, 16):
        u = 60 + 12 * k
        frame = scene((9, pose(u, 110, half)), seed=k, blur=1.5, light=1 + 0.3 * np.sin(k), noise=5)
        feature = tracker.update(frame)
        assert feature.ok and abs(feature.uv[0] - u) < 0.3, k


def test_a_drop_that_hides_a_cell_from_the_detector_does_not_lose_it():
    """The detector refuses a frame with a gap; the outline and the other cells still say what it is."""
    warp = pose(150, 110, 40, 0.15)
    tracker = MarkerTracker(scene((5, warp)), (150, 110))
    place = carried(warp, np.array([[-0.875 + 0.25 * 3, -0.875, 1], [0, 0, 1]]))
    frame = scene((5, warp), seed=1)
    cv2.circle(frame, (round(place[0, 0]), round(place[0, 1])), 6, (215, 215, 215), -1)
    feature = tracker.update(frame)
    assert feature.ok and np.abs(feature.uv - place[1]).max() < 0.1


def test_where_there_is_no_marker_the_nearest_is_offered():
    near, far = pose(250, 180, 20), pose(60, 60, 20)
    frame = scene((1, far), (2, near))
    with pytest.raises(Untrackable) as caught:
        MarkerTracker(frame, (200, 150))
    assert caught.value.suggestion is not None
    assert np.abs(np.array(caught.value.suggestion) - (250, 180)).max() < 0.5
    assert MarkerTracker(frame, caught.value.suggestion).update(frame).detail == "marker 2, centre"
    with pytest.raises(Untrackable, match="nor anywhere") as nothing:
        MarkerTracker(scene(), (200, 150))
    assert nothing.value.suggestion is None


def test_bad_input_is_refused_and_bad_frames_are_losses():
    warp = pose(150, 110, 30)
    frame = scene((5, warp))
    with pytest.raises(BadInput):
        MarkerTracker(frame, (400, 10))
    with pytest.raises(BadInput):
        MarkerTracker(frame.astype(float), (150, 110))  # type: ignore[arg-type]
    tracker = MarkerTracker(frame, (150, 110))
    for bad in (None, frame[:100], frame.astype(np.float32), np.zeros((0, 0, 3), np.uint8)):
        assert not tracker.update(bad).ok  # type: ignore[arg-type]
    assert tracker.update(frame).ok
    gray = MarkerTracker(frame[:, :, 0].copy(), (150, 110)).update(frame[:, :, 0].copy())
    assert gray.ok and np.allclose(gray.uv, (150, 110), atol=0.1)


def test_two_runs_are_identical():
    frames = [scene((7, wander(k, 20)), seed=k) for k in range(8)]
    runs = []
    for _ in range(2):
        tracker = MarkerTracker(frames[0], (120, 110))
        runs.append([tracker.update(f) for f in frames])
    assert all(np.array_equal(a.uv, b.uv) and a.score == b.score for a, b in zip(*runs, strict=True))


def test_the_marker_of_the_simulation_is_a_real_code():
    """Its corners on the rendered picture are where the scene has them."""
    mark = ObjectSpec("code", "marker", (0.5, 0.0, 0.1), (0, 0, 25))
    camera = CameraSpec("top", (0.35, -0.1, 0.55), (0.5, 0.0, 0.1), size=(320, 240))
    corners = [(-0.04, 0.04, 0), (0.04, 0.04, 0), (0.04, -0.04, 0), (-0.04, -0.04, 0)]
    with LockstepRig(Scenario(scene=SceneSpec(objects=(mark,), tool="none"), camera=(camera,))) as rig:
        frame = rig.observe().frames["top"]
        truth = np.array([rig.project("top", "code", corner) for corner in corners])
    tracker = MarkerTracker(frame, truth[2])
    feature = tracker.update(frame)
    assert feature.detail == "marker 5, corner 3"
    assert feature.corners is not None and np.abs(feature.corners - truth).max() < 0.2
