"""Laws of the patch tracker where a region holds more than its target, or looks like something else."""

import cv2
import numpy as np
import pytest
from sequences import Sequence, circle, similarity, texture

from vita.errors import Untrackable
from vita.vision import make_tracker
from vita.vision.patch import PatchTracker

CLICK = np.array([163.3, 118.6])


def follow(sequence, click, **options):
    """(k,) errors [px] and (k,) ok flags of a patch tracker clicked in the first frame."""
    frames = iter(sequence)
    tracker = PatchTracker(next(frames), click, **options)
    features = [tracker.update(frame) for frame in frames]
    errors = [np.hypot(*(f.uv - sequence.truth(click, k))) for k, f in enumerate(features, 1)]
    return np.array(errors), np.array([f.ok for f in features])


def rest_then(speed, rest=4):
    """Nothing moves for `rest` frames, as at a click; then a circle."""
    return lambda k: circle(speed)(max(0, k - rest))


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_a_click_on_a_corner_goes_with_the_card_and_not_with_the_background(speed):
    """Three quarters of the region stand still and fit perfectly: it learns better, or it is lost."""
    right = []
    for corner in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        click = np.array([160.0, 120.0]) + 49.0 * np.array(corner)
        for seed in (0, 1):
            errors, ok = follow(Sequence(rest_then(speed), frames=34, seed=seed), click, size_px=41)
            assert (ok & (errors > 5.0)).sum() <= 3
            right.append((ok & (errors < 1.0)).mean())
    assert np.median(right) > 0.6


@pytest.mark.parametrize("size_px", [31, 61])
def test_a_static_look_alike_beside_the_target_does_not_take_over(size_px):
    """A copy of the target stands still 70 px away; the target is covered for a while and comes back."""
    reach = size_px // 2 + 2

    def sequence():
        return Sequence(
            rest_then(2.0), frames=44, seed=3, cover=lambda k: (95, 60, 215, 185) if 14 <= k < 28 else None
        )

    frames = []
    copy = None
    for frame in sequence():
        if copy is None:
            u, v = np.rint(CLICK).astype(int)
            copy = frame[v - reach : v + reach + 1, u - reach : u + reach + 1].copy()
        changed = frame.copy()
        changed[120 - reach : 121 + reach, 268 - reach : 269 + reach] = copy
        frames.append(changed)
    tracker = PatchTracker(frames[0], CLICK, size_px=size_px)
    features = [tracker.update(frame) for frame in frames[1:]]
    errors = np.array([np.hypot(*(f.uv - sequence().truth(CLICK, k))) for k, f in enumerate(features, 1)])
    ok = np.array([f.ok for f in features])
    assert not (ok & (errors > 5.0)).any()
    assert ok[:13].all() and not ok[16:27].any() and ok[31:].all()


def test_what_replaces_the_target_in_its_place_is_not_the_target():
    """Another picture in the same spot, of the same contrast, is a loss within three frames."""
    for seed in range(6):
        frames = list(Sequence(circle(0.0), frames=4, seed=seed))
        tracker = PatchTracker(frames[0], CLICK, size_px=41)
        for frame in frames[1:]:
            assert tracker.update(frame).ok
        others = list(Sequence(circle(0.0), frames=9, seed=seed + 50))
        assert not any(tracker.update(other).ok for other in others[2:])


def partly_covered(covered):
    """Statuses while three fifths of the moving target are covered in the frames that `covered` names."""
    sequence = Sequence(circle(2.0), frames=22, seed=2)
    other = next(iter(Sequence(circle(0.0), frames=1, seed=92)))
    frames = list(sequence)
    tracker = PatchTracker(frames[0], CLICK, size_px=41)
    ok = []
    for k in range(1, 22):
        frame = frames[k].copy()
        if covered(k):
            edge = int(sequence.truth(CLICK, k)[0]) - 3
            frame[:, edge:] = other[:, edge:]
        ok.append(tracker.update(frame).ok)
    return ok


def test_a_fair_fit_is_taken_for_a_few_frames_only():
    """Too little of the target is seen to be sure of it for long."""
    ok = partly_covered(lambda k: k > 4)
    assert all(ok[:4]) and not any(ok[7:10])


def fine_grained(shift):
    """A texture with detail of one pixel, moved to the right by `shift` eighths of a pixel."""
    noise = np.random.default_rng(3).normal(128, 40, (160, 200)).astype(np.float32)
    big = cv2.resize(noise, None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC)
    moved = np.roll(big, shift, axis=1)
    return np.clip(cv2.resize(moved, (200, 160), interpolation=cv2.INTER_AREA), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("size_px", [31, 61, 99])
def test_a_texture_finer_than_the_grid_is_blurred_before_it_is_sampled(size_px):
    """Without blur, sampling every second pixel would see something else each time."""
    click = np.array([100.0, 80.0])
    tracker = PatchTracker(fine_grained(0), click, size_px=size_px)
    errors = []
    for shift in range(1, 17):
        feature = tracker.update(fine_grained(shift))
        assert feature.ok
        errors.append(np.hypot(*(feature.uv - click - (shift / 8, 0))))
    assert max(errors) < 0.03


def test_a_turned_target_is_found_again():
    """While it is covered it moves and turns by 20 degrees."""

    def motion(k):
        return similarity(12.0, -9.0, turn=0.35) if k >= 14 else np.eye(3)

    for seed in (1, 2, 3):
        sequence = Sequence(
            motion, frames=40, seed=seed, cover=lambda k: (80, 40, 250, 200) if 10 <= k < 22 else None
        )
        errors, ok = follow(sequence, CLICK, size_px=45)
        assert not ok[12:21].any()
        assert ok[-8:].all() and (errors[-8:] < 1.0).all()


def plain_with(draw):
    frame = np.full((240, 320), 90.0)
    draw(frame)
    noise = np.random.default_rng(0).normal(0, 2.0, frame.shape)
    return np.repeat(np.clip(np.rint(frame + noise), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


def test_the_refusal_names_the_reason():
    def edge(frame):
        frame[:, 160:] = 170

    with pytest.raises(Untrackable, match="blank"):
        make_tracker("patch", plain_with(lambda frame: None), [100.0, 100.0])
    with pytest.raises(Untrackable, match="slides along; a line tracker would hold it"):
        make_tracker("patch", plain_with(edge), [160.0, 120.0])


def test_a_weak_patch_says_so_and_a_good_one_does_not():
    def faint(frame):
        frame[60:180, 100:220] += 0.4 * (texture(5, 120) - 128)

    weak = PatchTracker(plain_with(faint), [160.0, 120.0], size_px=31)
    assert "weak" in weak.update(plain_with(faint)).detail
    frame = next(iter(Sequence(circle(0.0), frames=1)))
    assert "weak" not in PatchTracker(frame, CLICK, size_px=41).update(frame).detail
