"""Laws of the re-detecting tracker: as precise as the patch tracker, and found again anywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sequences import SIZE, Sequence, circle, similarity, swing

from vita.errors import BadInput, Untrackable
from vita.types import Feature
from vita.vision.patch import PatchTracker
from vita.vision.redetect import EVERY, RedetectTracker

CLICK = np.array([168.0, 124.0])
EVERYTHING = (0.0, 0.0, float(SIZE[0]), float(SIZE[1]))
GONE, BACK = 6, 14


def gone(k: int) -> tuple[float, float, float, float] | None:
    return EVERYTHING if GONE <= k < BACK else None


def returning(du: float, dv: float, turn: float, scale: float, seed: int = 3, frames: int = 28) -> Sequence:
    """Still, then hidden, then back at another place, turned and scaled, and moving slowly."""

    def motion(k: float) -> np.ndarray:
        return np.eye(3) if k < BACK else similarity(du + 0.5 * (k - BACK), dv, turn, scale)

    return Sequence(motion, frames=frames, seed=seed, cover=gone)


def follow(sequence: Sequence, kind: type = RedetectTracker, **options: float):
    """Per frame the feature and how far it is from the truth [px]."""
    tracker, out = None, []
    for k, frame in enumerate(sequence):
        tracker = tracker or kind(frame, CLICK, **options)
        feature = tracker.update(frame)
        out.append((feature, float(np.linalg.norm(feature.uv - sequence.truth(CLICK, k)))))
    return out


@pytest.mark.parametrize(
    ("du", "dv", "turn", "scale"),
    [
        (-50, 30, 0.0, 1.0),
        (40, -25, 1.4, 1.0),
        (-45, -30, 3.1, 1.0),
        (30, 20, -2.0, 1.35),
        (-40, 25, 0.7, 0.7),
    ],
)
@pytest.mark.parametrize("seed", [3, 8])
def test_it_is_found_anywhere_turned_and_scaled_within_5_frames_and_to_sub_pixel(du, dv, turn, scale, seed):
    found = follow(returning(du, dv, turn, scale, seed))
    assert all(f.ok and off < 0.2 for f, off in found[:GONE])
    assert not any(f.ok for f, _ in found[GONE + 2 : BACK]), "while it is hidden it says so"
    back = [k for k, (f, _) in enumerate(found) if k >= BACK and f.ok]
    assert back and back[0] < BACK + 5
    assert all(found[k][0].ok and found[k][1] < 0.3 for k in range(back[0], len(found)))


def test_the_patch_tracker_alone_would_not_find_it():
    """What the memory is for; else it could be left out."""
    assert not any(f.ok for f, _ in follow(returning(-45, -30, 3.1, 1.0), PatchTracker, size_px=71)[BACK:])


def test_while_it_is_seen_it_is_the_patch_tracker():
    sequence = Sequence(swing(speed=4.0, tilt=0.0008), frames=30, seed=5)
    ours = follow(sequence)
    theirs = follow(sequence, PatchTracker, size_px=71)
    for (a, _), (b, _) in zip(ours, theirs, strict=True):
        assert a.ok and np.array_equal(a.uv, b.uv) and a.score == b.score
        assert "re-detecting" in a.detail


def test_another_picture_in_its_place_is_not_taken_for_it():
    """The card is exchanged: in 30 frames nothing is found."""
    first = Sequence(circle(0.5), frames=3, seed=3)
    other = Sequence(swing(speed=2.0), frames=30, seed=40)
    frames = list(first)
    tracker = RedetectTracker(frames[0], CLICK)
    last = [tracker.update(f) for f in frames][-1]
    seen = [tracker.update(f) for f in other]
    assert last.ok and not any(f.ok for f in seen[2:])
    assert np.abs(seen[-1].uv - last.uv).max() < 8.0


def test_a_look_alike_that_the_patch_takes_is_overruled_by_the_features(monkeypatch):
    """The patch tracker is made to report a wrong place when the card comes back."""
    sequence = returning(-45, -30, 3.1, 1.0, frames=BACK + 1)
    frames = list(sequence)
    tracker = RedetectTracker(frames[0], CLICK)
    for frame in frames[:BACK]:
        tracker.update(frame)
    patch = tracker._patch
    real, answers = patch.update, [Feature(np.array([45.0, 45.0]), "ok", 0.9)]
    monkeypatch.setattr(patch, "update", lambda f: answers.pop() if answers else real(f))
    feature = tracker.update(frames[BACK])
    assert feature.ok and np.linalg.norm(feature.uv - sequence.truth(CLICK, BACK)) < 0.3


def test_only_every_second_lost_frame_is_looked_at(monkeypatch):
    frames = list(Sequence(circle(0.0), frames=1, seed=3))
    tracker = RedetectTracker(frames[0], CLICK)
    looks = []
    monkeypatch.setattr(tracker._memory, "poses", lambda frame, look: looks.append(look) or [])
    for _ in range(5):
        assert tracker.update(frames[0]).ok
    assert looks == []
    blank = np.full_like(frames[0], 90)
    for _ in range(EVERY * 8):
        assert not tracker.update(blank).ok
    assert looks == list(range(8))


@pytest.mark.parametrize("look", range(8))
def test_every_look_covers_its_part_of_the_frame(look):
    """Even looks see the whole frame, odd ones a quarter: the four together miss nothing."""
    places = {(-60, -40): 0, (60, -40): 1, (-60, 40): 2, (60, 40): 3}
    frames = list(Sequence(lambda k: np.eye(3), frames=1, seed=3))
    memory = RedetectTracker(frames[0], CLICK)._memory
    for (du, dv), quarter in places.items():
        motion = lambda k, du=du, dv=dv: similarity(du, dv, 0.4)  # noqa: E731
        sequence = Sequence(motion, frames=1, seed=3)
        (frame,) = sequence
        if look % 2 and look // 2 % 4 != quarter:
            continue
        poses = memory.poses(frame, look)
        middle = similarity(du, dv, 0.4) @ np.array([*(CLICK - (160, 120)), 1.0])
        assert poses and np.linalg.norm(poses[0][:2, 2] - (middle[:2] + (160, 120))) < 3.0


def test_too_few_features_are_refused_with_a_place_that_works():
    (frame,) = Sequence(circle(0.0), frames=1, seed=3)
    frame = frame.copy()
    frame[:, 180:] = 120
    with pytest.raises(Untrackable) as caught:
        RedetectTracker(frame, (270, 120))
    assert caught.value.suggestion is not None and caught.value.suggestion[0] < 180
    assert RedetectTracker(frame, caught.value.suggestion).update(frame).ok
    with pytest.raises(Untrackable) as nothing:
        RedetectTracker(np.full((240, 320, 3), 90, np.uint8), (100, 100))
    assert nothing.value.suggestion is None


def test_a_small_region_is_learned_too():
    found = follow(replace(returning(-40, 20, 1.0, 1.0)), size_px=40)
    assert all(off < 0.3 for f, off in found if f.ok) and found[-1][0].ok


def test_bad_input_is_refused_and_bad_frames_are_losses():
    (frame,) = Sequence(circle(0.0), frames=1, seed=3)
    for uv, size in (((400, 10), None), (CLICK, 5), (CLICK, 1000), (CLICK, float("nan"))):
        with pytest.raises(BadInput):
            RedetectTracker(frame, uv, size_px=size)
    tracker = RedetectTracker(frame, CLICK)
    for bad in (None, frame[:100], frame.astype(np.float32), np.zeros((0, 0, 3), np.uint8)):
        assert not tracker.update(bad).ok  # type: ignore[arg-type]
    assert tracker.update(frame).ok
    gray = np.ascontiguousarray(frame[:, :, 0])
    assert RedetectTracker(gray, CLICK).update(gray).ok


def test_two_runs_are_identical():
    sequence = returning(30, 20, -2.0, 1.2, frames=20)
    for (a, _), (b, _) in zip(follow(sequence), follow(sequence), strict=True):
        assert a.status == b.status and np.array_equal(a.uv, b.uv) and a.score == b.score
