"""Laws of the point tracker on sequences whose ground truth is known exactly."""

import cv2
import numpy as np
import pytest
from scipy.special import ndtr
from sequences import SIZE, Sequence, circle, similarity, swing, texture
from shapes import BLUR, U, V, across, along, frame

from vita.errors import BadInput, Untrackable
from vita.vision import warps
from vita.vision.images import Crop
from vita.vision.point import PointTracker
from vita.vision.window import Window


def corners(picture, count=4):
    """(k, 2) strong corners in the middle of the card."""
    part = np.ascontiguousarray(picture[80:160, 120:200, 0])
    found = cv2.goodFeaturesToTrack(part, count, 0.05, 12, blockSize=5)
    return found.reshape(-1, 2).astype(float) + (120, 80)


def follow(sequence, clicks=None, **options):
    """(k, c) errors [px] and ok flags of trackers on `clicks` (c, 2), and the features."""
    frames = iter(sequence)
    first = next(frames)
    clicks = corners(first) if clicks is None else np.atleast_2d(clicks)
    trackers = [PointTracker(first, click, **options) for click in clicks]
    off, ok, features = [], [], []
    for k, seen in enumerate(frames, 1):
        row = [tracker.update(seen) for tracker in trackers]
        for feature in row:
            assert 0 <= feature.score <= 1 and feature.detail
            assert feature.corners is not None and feature.corners.shape == (4, 2)
        off.append([np.hypot(*(f.uv - sequence.truth(c, k))) for f, c in zip(row, clicks, strict=True)])
        ok.append([f.ok for f in row])
        features.append(row)
    return np.array(off), np.array(ok), features


MOTIONS = {
    "slow": circle(1.0),
    "fast": circle(12.0),
    "turning": swing(3.0, turn=0.8, zoom=0.0),
    "zooming": swing(3.0, turn=0.0, zoom=0.35),
    "all": swing(6.0, turn=0.5, zoom=0.2, tilt=0.001),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_corners_stay_sub_pixel_from_the_first_frame_to_the_last(name):
    """Light changes by 30 % and noise is 2 grey levels; no false loss and no drift."""
    off, ok, _ = follow(Sequence(MOTIONS[name], frames=45, seed=4, light=0.3))
    assert ok.all()
    assert np.median(off) < 0.06 and off.max() < 0.3
    assert np.median(off[-10:]) < 0.1


def test_a_still_point_hardly_jitters():
    _, ok, features = follow(Sequence(circle(0.0), frames=40, seed=1))
    assert ok.all()
    spots = np.array([[f.uv for f in row] for row in features])
    assert spots.std(axis=0).max() < 0.05


def test_a_part_of_the_window_may_be_covered():
    """A thing that rides along in front of the window's lower third."""
    bare = Sequence(swing(2.0), frames=40, seed=5)
    click = corners(next(iter(bare)), 1)[0]

    def cover(k):
        u, v = bare.truth(click, k)
        return (u - 40, v + 10.5 - 7 * min(1.0, (k - 6) / 8), u + 40, v + 60) if k > 6 else None

    off, ok, _ = follow(Sequence(swing(2.0), frames=40, seed=5, cover=cover), click)
    assert ok.mean() > 0.95
    assert off[ok].max() < 0.5


@pytest.mark.parametrize("angle", [0.2, 1.2])
@pytest.mark.parametrize("bright", [235.0, 20.0])
def test_the_corner_of_a_thing_is_followed_and_not_the_background(angle, bright):
    """Three quarters of the window are textured scene that stays behind."""
    scene = texture(5, 400, contrast=20.0)[: SIZE[1], : SIZE[0]].astype(float)
    rng = np.random.default_rng(0)

    def place(k):
        at = np.array([150.0, 110.0]) + [25 * np.sin(k / 9), 18 * np.sin(k / 6)]
        return at, angle + 0.2 * np.sin(k / 12)

    tracker, off = None, []
    for k in range(50):
        tip, turn = place(k)
        away = np.stack([U, V], axis=-1) - tip
        share = ndtr(away @ along(turn) / BLUR) * ndtr(away @ across(turn) / BLUR)
        seen = frame(scene * (1 - share) + bright * share, rng)
        if tracker is None:
            tracker = PointTracker(seen, tip)
            continue
        feature = tracker.update(seen)
        off.append(np.hypot(*(feature.uv - tip)) if feature.ok else np.nan)
    off = np.array(off)
    assert np.isfinite(off).mean() > 0.95
    assert np.nanmedian(off) < 0.5 and (off < 1.0).mean() > 0.85 and np.nanmax(off) < 2.5


def test_pixels_that_never_agree_stop_counting():
    """Once it is learned that a part of the window is something else, a plain fit ignores that part."""
    seen, other = (next(iter(Sequence(circle(0.0), frames=1, seed=seed, noise=0.0))) for seed in (4, 7))
    warp = warps.square(np.array([160.0, 120.0]), 10.5)
    window = Window(Crop.cut(seen, warps.corners(warp), 20), warp, 21, 2, np.zeros(2))
    changed = seen.copy()
    changed[:, 163:] = other[:, 163:]
    crop = Crop.cut(changed, warps.corners(warp), 20)
    mine = np.tile(np.arange(21) - 10 < 1, 21).astype(float)
    before = np.hypot(*(window.align(crop, warp, 12).warp[:2, 2] - (160, 120)))
    for _ in range(15):
        window.learn(mine)
    after = np.hypot(*(window.align(crop, warp, 12).warp[:2, 2] - (160, 120)))
    assert after < 0.1 < before


def test_a_click_near_the_rim_reports_the_click_though_its_window_lies_further_in():
    seen = next(iter(Sequence(circle(0.0), frames=1, seed=4)))
    for click in ((4.3, 120.6), (160.2, 3.4), (316.5, 200.0)):
        feature = PointTracker(seen, click).update(seen)
        assert feature.ok and feature.uv == pytest.approx(click, abs=0.05)
        assert np.array(feature.corners).mean(axis=0) != pytest.approx(click, abs=1.0)


@pytest.mark.parametrize("seed", [1, 2])
def test_covered_is_lost_within_three_frames_and_found_again(seed):
    """Optical flow would sit still on the cover and call it fine; while lost the last good pixel stays."""
    sequence = Sequence(
        swing(2.0), frames=40, seed=seed, cover=lambda k: (70, 40, 260, 210) if 12 <= k < 26 else None
    )
    off, ok, features = follow(sequence)
    assert ok[:11].all()
    assert not ok[11 + 3 : 25].any()
    assert ok[25 + 3 :].all() and off[25 + 3 :].max() < 0.5
    for column in range(ok.shape[1]):
        assert np.array_equal(features[15][column].uv, features[24][column].uv)


def test_leaving_the_view_is_lost_and_coming_back_is_found():
    sequence = Sequence(lambda k: similarity(du=230 * np.sin(np.pi * k / 50)), frames=51, seed=6)
    click = corners(next(iter(sequence)), 1)[0]
    off, ok, _ = follow(sequence, click)
    inside = np.array([sequence.truth(click, k)[0] < SIZE[0] - 0.5 for k in range(1, 51)])
    gone = int(np.argmin(inside))
    assert not ok[gone + 3 : gone + int((~inside).sum())].any()
    assert ok[-4:].all() and off[ok].max() < 1.0


def test_the_clicked_point_is_reported_as_clicked_with_its_fraction():
    frames = list(Sequence(circle(2.0), frames=8, seed=3, noise=0.0))
    truth = Sequence(circle(2.0), frames=8, seed=3, noise=0.0)
    for offset in ((0.0, 0.0), (0.25, 0.5), (0.73, 0.11)):
        click = corners(frames[0], 1)[0] + offset
        tracker = PointTracker(frames[0], click)
        for k, seen in enumerate(frames):
            assert np.hypot(*(tracker.update(seen).uv - truth.truth(click, k))) < 0.1


def test_blank_places_and_straight_edges_are_refused_with_the_nearest_corner():
    picture = np.full((240, 320, 3), 80, np.uint8)
    picture[100:200, 150:280] = 180
    noisy = picture + np.random.default_rng(0).integers(0, 4, picture.shape, dtype=np.uint8)
    for click in ((60, 60), (215, 100), (150, 150)):
        with pytest.raises(Untrackable, match="corner") as refused:
            PointTracker(noisy, click)
        suggestion = np.array(refused.value.suggestion)
        truth = np.array([(a, b) for a in (149.5, 279.5) for b in (99.5, 199.5)])
        away = np.hypot(*(truth - suggestion).T)
        assert away.min() < 0.7
        assert away.argmin() == np.hypot(*(truth - click).T).argmin()
        assert PointTracker(noisy, suggestion).update(noisy).ok
    with pytest.raises(Untrackable) as refused:
        PointTracker(np.full((240, 320, 3), 80, np.uint8), (100, 100))
    assert refused.value.suggestion is None


@pytest.mark.parametrize("uv", [(-3, 10), (400, 100), (np.nan, 1), "here"])
def test_bad_clicks_are_refused(uv):
    with pytest.raises(BadInput) as refused:
        PointTracker(next(iter(Sequence(circle(0.0)))), uv)
    assert not isinstance(refused.value, Untrackable)


def test_a_bad_frame_is_lost_and_the_next_good_one_is_found():
    seen = next(iter(Sequence(circle(0.0), seed=4)))
    tracker = PointTracker(seen, corners(seen, 1)[0])
    before = tracker.update(seen)
    for bad in (None, seen[:100], seen.astype(float), "frame"):
        feature = tracker.update(bad)  # type: ignore[arg-type]
        assert not feature.ok and np.array_equal(feature.uv, before.uv)
    assert tracker.update(seen).ok


def test_two_runs_agree_to_the_bit_and_grey_frames_do_as_well():
    runs = [follow(Sequence(circle(6.0), frames=10, seed=4))[2] for _ in range(2)]
    for first, second in zip(*runs, strict=True):
        for a, b in zip(first, second, strict=True):
            assert np.array_equal(a.uv, b.uv) and a.score == b.score
    sequence = list(Sequence(circle(6.0), frames=10, seed=4))
    click = corners(sequence[0], 1)[0]
    colour, grey = PointTracker(sequence[0], click), PointTracker(sequence[0][:, :, 0], click)
    for seen in sequence[1:]:
        assert np.hypot(*(colour.update(seen).uv - grey.update(seen[:, :, 0]).uv)) < 0.02
