"""Laws of the colour blob tracker, on balls and discs drawn with exact ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from sequences import texture

import vita
from vita.errors import BadInput, Untrackable
from vita.sim.lockstep import LockstepRig
from vita.vision.blob import BlobTracker

SIZE = (320, 240)
ORANGE, GREEN, BLUE = (230, 110, 30), (60, 160, 60), (40, 70, 200)
WHITE, BLACK, GREY = (238, 238, 236), (25, 25, 28), (185, 185, 182)
U, V = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))


@dataclass(frozen=True)
class Blob:
    u: float
    v: float
    radius: float = 12.0
    colour: tuple = ORANGE
    long: float = 1.0
    """Axis ratio of an ellipse whose long axis is along the columns' direction, turned by `turn`."""
    turn: float = 0.0
    shade: float = 0.0
    """How much brighter one side is and darker the other: 0.4 is plus and minus 40 %."""


def cover(blob: Blob) -> np.ndarray:
    """(h, w, 1) how much of each pixel the ellipse covers, from 64 points a pixel."""
    total = np.zeros(U.shape)
    reach = int(blob.radius * max(1.0, blob.long)) + 2
    rows = slice(max(0, int(blob.v) - reach), max(0, int(blob.v) + reach + 2))
    columns = slice(max(0, int(blob.u) - reach), max(0, int(blob.u) + reach + 2))
    near = rows, columns
    for du in np.arange(-7, 8, 2) / 16:
        for dv in np.arange(-7, 8, 2) / 16:
            x, y = U[near] + du - blob.u, V[near] + dv - blob.v
            a = (x * np.cos(blob.turn) + y * np.sin(blob.turn)) / (blob.radius * blob.long)
            b = (y * np.cos(blob.turn) - x * np.sin(blob.turn)) / blob.radius
            total[near] += a * a + b * b < 1
    return (total / 64)[:, :, None]


GROUND = texture(3, 320, 10.0)[: SIZE[1], : SIZE[0], None] - 128


def scene(*blobs: Blob, seed=0, noise=2.0, light=1.0, ground=(118, 120, 116)) -> np.ndarray:
    """A frame with blobs, later ones in front, over a ground of soft texture."""
    frame = GROUND + np.array(ground, float)
    for blob in blobs:
        side = (0.6 * (U - blob.u) - 0.8 * (V - blob.v)) / blob.radius
        colour = np.array(blob.colour) * np.clip(1 + blob.shade * side, 0.2, 1.8)[:, :, None]
        share = cover(blob)
        frame = frame * (1 - share) + share * colour
    frame = cv2.GaussianBlur(frame * light, (0, 0), 0.6)
    frame += np.random.default_rng(seed).normal(0, noise, frame.shape)
    return np.clip(np.rint(frame), 0, 255).astype(np.uint8)


def path(k: int, **more) -> Blob:
    return Blob(80 + 3.1 * k, 120 + 25 * np.sin(k / 6), **more)


def follow(blobs, start=None, **more):
    """The features of a tracker clicked on the first blob, one for each frame."""
    first = blobs[0]
    tracker = BlobTracker(scene(first, **more), start or (first.u, first.v))
    return [tracker.update(scene(blob, seed=k, **more)) for k, blob in enumerate(blobs)]


@pytest.mark.parametrize(
    ("colour", "name"),
    [
        (ORANGE, "orange"),
        (GREEN, "green"),
        (BLUE, "blue"),
        (WHITE, "white"),
        (BLACK, "black"),
        (GREY, "grey"),
    ],
)
@pytest.mark.parametrize("radius", [5.0, 14.0])
def test_the_centre_is_found_to_a_twentieth_of_a_pixel(colour, name, radius):
    blobs = [path(k, radius=radius, colour=colour) for k in range(20)]
    found = follow(blobs)
    assert all(f.ok and f.detail == f"{name} blob {2 * radius:.0f} px" for f in found)
    off = np.array([f.uv - (b.u, b.v) for f, b in zip(found, blobs, strict=True)])
    assert np.sqrt(np.square(off).mean()) < 0.05


def test_it_is_several_times_better_than_camshift_alone():
    blobs = [path(k) for k in range(20)]
    frames = [scene(b, seed=k) for k, b in enumerate(blobs)]
    tracker = BlobTracker(frames[0], (80, 120))
    hsv = cv2.cvtColor(frames[0], cv2.COLOR_RGB2HSV)
    table = cv2.calcHist([hsv[115:126, 75:86]], [0], None, [32], [0, 180])
    cv2.normalize(table, table, 0, 255, cv2.NORM_MINMAX)
    window, ours, theirs = (66, 106, 28, 28), [], []
    for frame, blob in zip(frames, blobs, strict=True):
        hsv = cv2.cvtColor(frame, cv2.COLOR_RGB2HSV)
        likely = cv2.calcBackProject([hsv], [0], table, [0, 180], 1)
        likely[hsv[:, :, 1] < 60] = 0
        (center, _, _), window = cv2.CamShift(likely, window, (3, 10, 1))
        theirs.append(np.array(center) - (blob.u, blob.v))
        ours.append(tracker.update(frame).uv - (blob.u, blob.v))
    assert np.square(ours).mean() ** 0.5 < 0.2 * np.square(theirs).mean() ** 0.5


def test_shade_on_a_ball_pulls_the_centre_by_less_than_a_tenth_of_a_pixel():
    blobs = [path(k, shade=0.4) for k in range(20)]
    off = np.array([f.uv - (b.u, b.v) for f, b in zip(follow(blobs), blobs, strict=True)])
    assert np.abs(off.mean(axis=0)).max() < 0.1


def test_fast_motion_and_changing_light_are_followed():
    blobs = [Blob(40 + 12 * k, 120 + 40 * np.sin(k / 4)) for k in range(20)]
    tracker = BlobTracker(scene(blobs[0]), (40, 120))
    for k, blob in enumerate(blobs):
        feature = tracker.update(scene(blob, seed=k, light=1 + 0.25 * np.sin(k / 5), noise=4))
        assert feature.ok and np.abs(feature.uv - (blob.u, blob.v)).max() < 0.15, k


def test_the_outline_is_the_ellipse_that_is_seen():
    blob = Blob(150, 110, 10, BLUE, long=2.0, turn=0.6)
    feature = follow([blob])[0]
    assert feature.outline is not None and feature.outline.shape[0] <= 32
    x, y = (feature.outline - (150, 110)).T
    a = (x * np.cos(0.6) + y * np.sin(0.6)) / 20
    b = (y * np.cos(0.6) - x * np.sin(0.6)) / 10
    assert np.abs(np.hypot(a, b) - 1).max() < 0.06


def away(k: int) -> Blob:
    """Something grey-brown that hides what was there."""
    return Blob(80, 120, 40, (112, 100, 92))


GONE = {
    "it is covered": away,
    "it changes its colour": lambda k: Blob(80, 120, 12, BLUE),
    "it turns from orange to dark brown": lambda k: Blob(80, 120, 12, (78, 37, 10)),
    "it turns grey": lambda k: Blob(80, 120, 12, (140, 140, 140)),
    "it shrinks below a third": lambda k: Blob(80, 120, 12 * 0.5),
    "it grows threefold": lambda k: Blob(80, 120, 12 * 1.9),
}


@pytest.mark.parametrize("what", GONE)
def test_it_is_lost_within_3_frames_when(what):
    tracker = BlobTracker(scene(Blob(80, 120)), (80, 120))
    last = tracker.update(scene(Blob(80, 120), seed=1))
    found = [tracker.update(scene(GONE[what](k), seed=k)) for k in range(6)]
    assert not any(f.ok for f in found[2:])
    assert all(f.score == 0 and f.detail and np.array_equal(f.uv, last.uv) for f in found[2:])


def test_a_white_one_that_turns_black_is_lost():
    tracker = BlobTracker(scene(Blob(80, 120, colour=WHITE)), (80, 120))
    assert not any(tracker.update(scene(Blob(80, 120, colour=BLACK), seed=k)).ok for k in range(4))


def test_a_slow_cover_never_pulls_the_centre_far():
    """While a board slides over the ball at 1 px a frame it is lost before the centre is off by 2 px."""
    tracker = BlobTracker(scene(Blob(150, 120)), (150, 120))
    for k in range(30):
        frame = scene(Blob(150, 120), seed=k).copy()
        frame[:, 136 : 136 + k] = (100, 104, 98)
        feature = tracker.update(frame)
        assert not feature.ok or np.abs(feature.uv - (150, 120)).max() < 2.0, k
    assert not feature.ok


def test_it_leaves_the_view_and_comes_back():
    tracker = BlobTracker(scene(Blob(290, 120)), (290, 120))
    seen = [tracker.update(scene(Blob(290 + 4 * k, 120), seed=k)) for k in range(12)]
    assert seen[0].ok and not seen[-1].ok
    back = [tracker.update(scene(Blob(60, 60), seed=k)) for k in range(4)]
    assert back[-1].ok and np.abs(back[-1].uv - (60, 60)).max() < 0.1


@pytest.mark.parametrize("colour", [ORANGE, WHITE])
def test_a_lost_one_is_found_anywhere_among_others(colour):
    """Not the blob of another colour, nor a much larger one of the same."""
    other = Blob(250, 60, 12, GREEN), Blob(90, 190, 30, colour)
    tracker = BlobTracker(scene(Blob(80, 60, colour=colour), *other), (80, 60))
    for k in range(8):
        assert not tracker.update(scene(*other, seed=k)).ok
    back = [tracker.update(scene(Blob(240, 180, 11, colour), *other, seed=k)) for k in range(5)]
    assert back[-1].ok and np.abs(back[-1].uv - (240, 180)).max() < 0.15


def test_one_of_the_same_colour_beside_it_does_not_pull_and_a_touching_one_is_noticed():
    other = Blob(150, 120)
    tracker = BlobTracker(scene(Blob(90, 120), other), (90, 120))
    touched = False
    for k in range(25):
        gap = 60 - 2 * k  # between the centres; they touch at 24
        feature = tracker.update(scene(Blob(150 - gap, 120), other, seed=k))
        if gap > 30:
            assert feature.ok and np.abs(feature.uv - (150 - gap, 120)).max() < 0.2, gap
        elif gap < 20:
            touched |= not feature.ok
            assert not feature.ok or abs(feature.uv[0] - 150) < 1 or abs(feature.uv[0] - (150 - gap)) < 1, gap
    assert touched


def test_a_wall_a_gradient_and_a_colour_that_is_everywhere_are_refused_with_a_way_out():
    wall = scene(Blob(230, 60))
    with pytest.raises(Untrackable) as caught:
        BlobTracker(wall, (80, 150))
    assert (
        caught.value.suggestion is not None
        and np.abs(np.subtract(caught.value.suggestion, (230, 60))).max() < 2
    )
    assert BlobTracker(wall, caught.value.suggestion).update(wall).ok
    with pytest.raises(Untrackable) as nothing:
        BlobTracker(scene(), (80, 150))
    assert nothing.value.suggestion is None
    ramp = np.repeat(np.tile(np.linspace(20, 235, 320).astype(np.uint8), (240, 1))[:, :, None], 3, axis=2)
    with pytest.raises(Untrackable):
        BlobTracker(ramp, (160, 120))
    many = [Blob(20 + 26 * i, 20 + 26 * j, 9) for i in range(12) for j in range(9)]
    with pytest.raises(Untrackable, match="orange"):
        BlobTracker(scene(*many), (150, 124))
    rings = Blob(150, 120, 20), Blob(150, 120, 13, GREY), Blob(150, 120, 8)
    with pytest.raises(Untrackable, match="orange is all around"):
        BlobTracker(scene(*rings), (150, 120))
    half = np.where(U < 160, 0, 255).astype(np.uint8)
    with pytest.raises(Untrackable, match="edge"):
        BlobTracker(np.repeat(half[:, :, None], 3, axis=2), (40, 40))


def test_bad_input_is_refused_and_bad_frames_are_losses():
    frame = scene(Blob(80, 120, colour=WHITE))
    for uv in ((400, 10), (np.nan, 3), "here"):
        with pytest.raises(BadInput):
            BlobTracker(frame, uv)
    with pytest.raises(BadInput, match="size_px"):
        BlobTracker(frame, (80, 120), size_px=1)
    tracker = BlobTracker(frame, (80, 120))
    for bad in (None, frame[:100], frame.astype(np.float32), np.zeros((0, 0, 3), np.uint8)):
        assert not tracker.update(bad).ok  # type: ignore[arg-type]
    assert tracker.update(frame).ok
    gray = np.ascontiguousarray(frame[:, :, 1])
    assert np.abs(BlobTracker(gray, (80, 120)).update(gray).uv - (80, 120)).max() < 0.1


def test_two_runs_are_identical():
    blobs = [path(k) for k in range(6)]
    for a, b in zip(follow(blobs), follow(blobs), strict=True):
        assert np.array_equal(a.uv, b.uv) and a.score == b.score and str(a) == str(b)


def test_the_ball_of_the_simulation_is_found_on_a_table_of_nearly_its_colour():
    with LockstepRig(vita.load("point_to_point")) as rig:
        seen = rig.observe()
        for camera, frame in seen.frames.items():
            truth = rig.project(camera, "post", (0, 0, 0))
            feature = BlobTracker(frame, truth + (2, -2)).update(frame)
            assert feature.detail.startswith("orange blob") and np.abs(feature.uv - truth).max() < 0.15
