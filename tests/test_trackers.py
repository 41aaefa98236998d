"""Laws of the image trackers on sequences whose ground truth is known exactly."""

import numpy as np
import pytest
from sequences import SIZE, Sequence, circle, similarity, swing

from vita.errors import BadInput, UnknownName, Untrackable
from vita.types import Feature
from vita.vision import TRACKER_KINDS, make_tracker

CLICK = np.array([163.3, 118.6])


def follow(sequence, click=CLICK, kind="auto", size_px=None) -> tuple[np.ndarray, np.ndarray, list[Feature]]:
    """(k,) errors [px] and (k,) ok flags of a tracker clicked in the first frame, and its features."""
    frames = iter(sequence)
    tracker = make_tracker(kind, next(frames), click, size_px=size_px)
    features = [tracker.update(frame) for frame in frames]
    errors = [np.hypot(*(f.uv - sequence.truth(click, k))) for k, f in enumerate(features, 1)]
    for feature in features:
        assert np.isfinite(feature.uv).all() and np.isfinite(np.array(feature.corners)).all()
        assert 0.0 <= feature.score <= 1.0 and feature.detail
    return np.array(errors), np.array([f.ok for f in features]), features


def lean(k):
    """A strong perspective swing with little else."""
    return similarity(2 * k / 3) @ np.array([[1, 0, 0], [0, 1, 0], [0.003 * np.sin(k / 10), 0, 1.0]])


MOTIONS = {
    "slow": circle(1.0),
    "middling": circle(3.0),
    "fast": circle(12.0),
    "turning": swing(3.0, turn=0.8, zoom=0.0),
    "zooming": swing(3.0, turn=0.0, zoom=0.35),
    "leaning": lean,
    "all": swing(6.0, turn=0.5, zoom=0.2, tilt=0.001),
}


@pytest.mark.parametrize("size_px", [31, None, 61])
@pytest.mark.parametrize("name", MOTIONS)
def test_every_frame_of_a_moving_target_is_within_a_pixel(name, size_px):
    """Under noise of 2 grey levels and light that changes by 30 %, without a single false loss."""
    errors, ok, _ = follow(Sequence(MOTIONS[name], frames=45, seed=4, light=0.3), size_px=size_px)
    assert ok.all()
    assert errors.max() < 1.0
    assert np.median(errors) < (0.1 if size_px != 31 else 0.25)


@pytest.mark.parametrize("share", [0.25, 0.4])
@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_a_partly_covered_target_stays_where_it_is(speed, share):
    """What passes in front and rides along with a part of the patch neither drags nor loses it."""
    bare = Sequence(swing(speed), frames=45, seed=5)

    def cover(k):
        u, v = bare.truth(CLICK, k)
        rise = share * 55 * min(1.0, max(0, k - 6) / 8)
        return (u - 60, v + 27.5 - rise, u + 60, v + 70) if k > 6 else None

    sequence = Sequence(swing(speed), frames=45, seed=5, light=0.2, cover=cover)
    errors, ok, _ = follow(sequence, size_px=55)
    assert ok.mean() > 0.97
    assert (errors[ok] < 1.0).all()
    assert np.median(errors) < 0.1


def test_background_inside_the_region_is_learned_and_left_alone():
    """Clicked at the card's lower edge, two fifths of the region are scene that does not move along."""
    for seed in (0, 1, 2):
        sequence = Sequence(circle(4.0), frames=45, seed=seed)
        errors, ok, _ = follow(sequence, np.array([160.4, 164.3]), size_px=45)
        assert ok.mean() > 0.95
        assert (errors[ok] < 1.0).mean() > 0.95


@pytest.mark.parametrize(("size_px", "bound"), [(31, 0.025), (61, 0.012)])
def test_a_still_target_hardly_jitters(size_px, bound):
    """Standard deviation of u and v [px] under noise of 2 grey levels."""
    for seed in (0, 1):
        _, ok, features = follow(Sequence(circle(0.0), frames=60, seed=seed), size_px=size_px)
        assert ok.all()
        assert np.std([f.uv for f in features], axis=0).max() < bound


def test_the_clicked_point_is_reported_as_clicked_with_its_fraction():
    """No rounding: points that differ by a fraction of a pixel stay apart by that fraction."""
    frames = list(Sequence(circle(2.0), frames=12, seed=3, noise=0.0))
    truth = Sequence(circle(2.0), frames=12, seed=3, noise=0.0)
    for offset in ((0.0, 0.0), (0.25, 0.5), (0.73, 0.11)):
        click = np.array([160.0, 119.0]) + offset
        tracker = make_tracker("auto", frames[0], click)
        for k, frame in enumerate(frames):
            assert np.hypot(*(tracker.update(frame).uv - truth.truth(click, k))) < 0.05


@pytest.mark.parametrize("seed", [1, 2])
def test_covered_is_lost_within_three_frames_and_found_again(seed):
    """While lost the last good pixel stays; uncovered, the tracker recovers by itself."""
    sequence = Sequence(
        swing(2.0), frames=45, seed=seed, cover=lambda k: (70, 40, 260, 210) if 15 <= k < 30 else None
    )
    errors, ok, features = follow(sequence)
    assert ok[:14].all()
    assert not ok[14 + 3 : 29].any()
    assert ok[29 + 3 :].all() and (errors[29 + 3 :] < 1.0).all()
    lost = [f.uv for f in features[17:29]]
    assert all(np.array_equal(uv, lost[0]) for uv in lost)


def test_leaving_the_view_is_lost_and_coming_back_is_found():
    sequence = Sequence(lambda k: similarity(du=230 * np.sin(np.pi * k / 50)), frames=50, seed=6)
    errors, ok, _ = follow(sequence)
    inside = np.array([sequence.truth(CLICK, k)[0] < SIZE[0] - 0.5 for k in range(1, 50)])
    gone = int(np.argmin(inside))
    assert not ok[gone + 3 : gone + int((~inside).sum())].any()
    assert ok[-4:].all()
    assert (errors[ok] < 1.0).all()


def test_a_jump_within_reach_of_the_search_is_found():
    """A target that is elsewhere from one frame to the next is found by looking around."""
    sequence = Sequence(lambda k: similarity(40.0, -15.0) if k >= 10 else np.eye(3), 25, seed=2)
    errors, ok, _ = follow(sequence)
    assert ok[-10:].all() and (errors[-10:] < 0.5).all()


def test_near_the_border_the_region_is_shifted_into_the_frame():
    frames = list(Sequence(circle(1.0), frames=10, seed=8))
    for click in ([2.2, 3.7], [318.9, 238.4], [150.0, 0.0]):
        tracker = make_tracker("auto", frames[0], click)
        feature = tracker.update(frames[0])
        assert feature.ok
        assert np.abs(feature.uv - click).max() < 0.05
        assert feature.corners is not None
        assert feature.corners.min() > -1.0
        assert (feature.corners.max(axis=0) < np.array(SIZE)).all()


def test_corners_start_top_left_and_go_clockwise():
    frame = next(iter(Sequence(circle(1.0), frames=1)))
    corners = make_tracker("auto", frame, CLICK, size_px=41).update(frame).corners
    assert corners is not None
    expected = CLICK + 20.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    assert np.abs(np.subtract(corners, expected)).max() < 0.2


def half_plain(noise=2.0):
    """A frame that is a plain wall on the left and textured on the right."""
    rng = np.random.default_rng(11)
    frame = next(iter(Sequence(circle(0.0), frames=1, seed=11, noise=0.0))).astype(np.float64)
    frame[:, :190] = 120
    return np.clip(np.rint(frame + rng.normal(0, noise, frame.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("noise", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("size_px", [None, 31])
def test_a_plain_wall_is_refused_with_a_suggestion_that_is_accepted(noise, size_px):
    frame = half_plain(noise)
    with pytest.raises(Untrackable, match="nothing to hold on to here") as refusal:
        make_tracker("auto", frame, [40.0, 100.0], size_px=size_px)
    suggestion = np.array(getattr(refusal.value, "suggestion", None))
    assert suggestion[0] > 150
    assert f"({suggestion[0]:.0f}, {suggestion[1]:.0f})" in str(refusal.value)
    tracker = make_tracker("auto", frame, suggestion, size_px=size_px)
    assert np.hypot(*(tracker.update(frame).uv - suggestion)) < 0.05


def test_an_edge_is_refused_since_one_would_slide_along_it():
    frame = np.full((240, 320, 3), 60, np.uint8)
    frame[:, 160:] = 200
    with pytest.raises(Untrackable):
        make_tracker("auto", frame, [160.0, 120.0])


def test_a_wholly_plain_picture_offers_nothing():
    with pytest.raises(Untrackable, match="Nowhere") as refusal:
        make_tracker("auto", np.full((240, 320, 3), 90, np.uint8), [100.0, 100.0])
    assert getattr(refusal.value, "suggestion", "missing") is None


@pytest.mark.parametrize("kind", TRACKER_KINDS)
@pytest.mark.parametrize("place", ([-3.0, 10.0], [320.0, 10.0], [10.0, 239.6], [np.nan, 5.0], [1.0], "here"))
def test_a_click_outside_the_frame_is_refused(kind, place):
    frame = next(iter(Sequence(circle(0.0), frames=1)))
    with pytest.raises(BadInput):
        make_tracker(kind, frame, place)
    with pytest.raises(BadInput, match="320 x 240"):
        make_tracker(kind, frame, [400.0, 20.0], to=[100.0, 100.0] if kind == "line" else None)


def test_unknown_kinds_and_sizes_are_refused_with_the_choices():
    frame = next(iter(Sequence(circle(0.0), frames=1)))
    with pytest.raises(UnknownName, match="auto"):
        make_tracker("outo", frame, CLICK)
    for size in (3.0, 1000.0, float("nan")):
        with pytest.raises(BadInput, match="size_px"):
            make_tracker("auto", frame, CLICK, size_px=size)


@pytest.mark.parametrize(
    "bad",
    [None, np.zeros((9, 9, 3), np.uint8), np.zeros((240, 320, 3)), np.zeros((240, 320, 3), np.uint8)],
    ids=["none", "small", "float", "black"],
)
def test_an_unusable_frame_is_a_loss_and_no_error(bad):
    frames = list(Sequence(circle(1.0), frames=6, seed=1))
    tracker = make_tracker("auto", frames[0], CLICK)
    good = tracker.update(frames[1])
    lost = tracker.update(bad)
    assert not lost.ok and np.array_equal(lost.uv, good.uv) and lost.detail
    assert tracker.update(frames[2]).ok


def test_two_runs_are_identical_to_the_bit():
    def run():
        def cover(k):
            return (60, 60, 240, 130) if 10 < k < 18 else None

        sequence = Sequence(swing(6.0, tilt=0.001), 30, seed=9, light=0.3, cover=cover)
        return [(f.uv.tobytes(), f.status, f.score, str(f.corners)) for f in follow(sequence)[2]]

    assert run() == run()


def shaken(k):
    """Large unsteady motion that no prediction helps with."""
    return similarity(14 * np.sin(2.5 * k), 14 * np.sin(1.7 * k))


def test_unsteady_motion_is_followed():
    errors, ok, _ = follow(Sequence(shaken, frames=30, seed=1), size_px=41)
    assert ok.all() and (errors < 0.5).all()


def test_gray_and_colour_frames_agree_and_the_frame_is_not_kept():
    """A driver that fills one buffer again and again must not change the tracker's memory."""
    frames = list(Sequence(shaken, frames=20, seed=1))
    by_copy = make_tracker("auto", frames[0], CLICK)
    buffer = frames[0].copy()
    by_buffer = make_tracker("auto", buffer, CLICK)
    gray = np.ascontiguousarray(frames[0][:, :, 0])
    by_gray = make_tracker("auto", gray, CLICK)
    for frame in frames[1:]:
        buffer[:], gray[:] = frame, frame[:, :, 0]
        uv = by_copy.update(frame).uv
        assert np.array_equal(by_buffer.update(buffer).uv, uv)
        assert np.array_equal(by_gray.update(gray).uv, uv)
