"""Laws of the line tracker on edges whose place is known exactly."""

import numpy as np
import pytest
from sequences import texture
from shapes import SIZE, U, V, across, along, edge, frame

from vita.errors import BadInput, Untrackable
from vita.vision.edges import Look
from vita.vision.line import LineTracker

HOME = np.array([160.0, 120.0])
SCENE = texture(5, 400)[: SIZE[1], : SIZE[0]].astype(float)


def follow(motion, frames=30, length=100.0, picture=edge, noise=2.0, click=(2.0, -1.5), seed=0):
    """(k,) normal distance of the worse end [px], (k,) angle error [deg] and features of a tracked edge.

    `motion(k)` gives the middle and the angle of frame `k`; the two clicks are off by `click` [px].
    """
    rng = np.random.default_rng(seed)
    tracker, off, turned, features = None, [], [], []
    for k in range(frames):
        middle, angle = motion(k)
        seen = frame(picture(middle, angle) if picture is edge else picture(k, middle, angle), rng, noise)
        if tracker is None:
            reach = along(angle) * length / 2
            start, end = middle - reach + click[0] * across(angle), middle + reach + click[1] * across(angle)
            tracker = LineTracker(seen, start, end)
            continue
        feature = tracker.update(seen)
        features.append(feature)
        off.append(np.abs((ends(feature) - middle) @ across(angle)).max())
        rise = ends(feature)[1] - ends(feature)[0]
        turned.append(np.degrees(np.arctan2(rise @ across(angle), rise @ along(angle))))
        assert 0 <= feature.score <= 1 and feature.detail and np.isfinite(ends(feature)).all()
        assert feature.uv == pytest.approx(ends(feature).mean(axis=0))
        assert feature.corners is None and feature.outline is None
    return np.array(off), np.abs(turned), features


def ends(feature) -> np.ndarray:
    """(2, 2) the ends of a line feature."""
    assert feature.segment is not None
    return feature.segment


def ok(features):
    return np.array([f.ok for f in features])


def back_and_forth(speed):
    """Sudden turns on the spot: the prediction is as wrong as it can be."""
    return lambda k: (HOME + [0, speed * (4 - abs(k % 16 - 8))], 0.1)


MOTIONS = {
    "slow": lambda k: (HOME + [0.1 * k, 0.3 * k], 0.3 + 0.001 * k),
    "12 px a frame": back_and_forth(12.0),
    "5 deg a frame": lambda k: (HOME, np.radians(5) * k),
    "swinging": lambda k: (HOME + [0, 20 * np.sin(k / 4)], 0.3 * np.sin(k / 5)),
}


@pytest.mark.parametrize("length", [40.0, 100.0, 200.0])
@pytest.mark.parametrize("name", MOTIONS)
def test_the_line_sticks_to_its_edge(name, length):
    """Below 0.1 px across and 0.1 deg of turn (short ones 0.2) at noise 2, without a false loss."""
    off, turned, features = follow(MOTIONS[name], length=length)
    assert ok(features).all()
    assert off.max() < 0.1
    assert turned.max() < (0.1 if length >= 100 else 0.2)


def test_light_may_change_by_thirty_percent():
    def lit(k, middle, angle):
        return edge(middle, angle) * (1 + 0.3 * np.sin(k / 5))

    off, turned, features = follow(MOTIONS["swinging"], picture=lit, frames=40)
    assert ok(features).all() and off.max() < 0.1 and turned.max() < 0.1


def test_background_on_one_side_may_be_anything():
    def before_scene(k, middle, angle):
        return edge(middle, angle, dark=SCENE, bright=225.0)

    off, _, features = follow(MOTIONS["swinging"], picture=before_scene)
    assert ok(features).all()
    assert np.median(off) < 0.15 and off.max() < 0.6


@pytest.mark.parametrize("side", [-1, 1])
def test_two_fifths_may_be_covered(side):
    """What covers one end neither drags the line nor loses it."""

    def covered(k, middle, angle):
        picture = edge(middle, angle)
        t = (np.stack([U, V], axis=-1) - middle) @ along(angle) * side
        return np.where((t > 50 - 40 * min(1, max(0, k - 3) / 5)) & (k > 3), SCENE * 1.3, picture)

    off, turned, features = follow(MOTIONS["swinging"], picture=covered, frames=40)
    assert ok(features).all()
    assert off.max() < 0.2 and turned.max() < 0.2


@pytest.mark.parametrize("seed", [5, 6])
def test_covered_is_lost_within_three_frames_and_found_again(seed):
    """While lost the last good line stays."""
    thing = texture(seed, 400)[: SIZE[1], : SIZE[0]] * 1.2

    def covered(k, middle, angle):
        return thing if 10 <= k < 25 else edge(middle, angle)

    def motion(k):
        return HOME + [0, 0.7 * k], 0.2 + 0.004 * k

    off, _, features = follow(motion, picture=covered, frames=40)
    seen = ok(features)
    assert seen[:9].all()
    assert not seen[9 + 3 : 24].any()
    assert all(np.array_equal(ends(f), ends(features[12])) for f in features[12:24])
    assert seen[24 + 5 :].all() and off[24 + 5 :].max() < 0.1


def test_gone_is_lost_within_three_frames():
    """The thing is taken away and its background stays: even, or textured."""
    for left_over in (np.full(SIZE[::-1], 80.0), SCENE):

        def gone(k, middle, angle, left_over=left_over):
            return left_over if k >= 8 else edge(middle, angle)

        _, _, features = follow(MOTIONS["slow"], picture=gone, frames=24)
        assert ok(features)[:7].all() and not ok(features)[7 + 3 :].any()


def test_motion_across_the_edge_does_not_move_the_ends_along_it():
    angle = 0.4

    def motion(k):
        return HOME + across(angle) * 30 * np.sin(k / 5), angle

    _, _, features = follow(motion, frames=60)
    drift = [(f.uv - HOME) @ along(angle) for f in features]
    assert np.ptp(drift) < 0.1
    lengths = [np.hypot(*(ends(f)[1] - ends(f)[0])) for f in features]
    assert lengths == pytest.approx([lengths[0]] * 59)


def test_a_short_edge_that_moves_along_itself_keeps_its_segment_on_it():
    """Where the edge ends inside the segment and goes on beyond the other end, the segment slides.

    The edge travels by 58 px here, more than the whole segment; two samples of 4 px may hang over.
    """

    def short(k, middle, angle):
        t = (np.stack([U, V], axis=-1) - HOME) @ along(angle) - 2.0 * k
        return np.where(np.abs(t) < 40, edge(middle, angle), 80.0)

    off, _, features = follow(lambda k: (HOME, 0.2), picture=short, length=56.0, frames=30)
    assert ok(features).all() and off.max() < 0.15
    last = ends(features[-1]) - HOME
    assert np.abs(last @ along(0.2) - 2.0 * 29).max() < 40 + 8


def test_the_ends_come_in_the_order_of_the_clicks_and_either_order_will_do():
    rng = np.random.default_rng(0)
    seen = frame(edge(HOME, 0.3), rng)
    a, b = HOME - 40 * along(0.3), HOME + 40 * along(0.3)
    for start, end in ((a, b), (b, a)):
        feature = LineTracker(seen, start, end).update(seen)
        assert feature.ok
        assert ends(feature)[0] == pytest.approx(start, abs=0.3)
        assert ends(feature)[1] == pytest.approx(end, abs=0.3)
        with pytest.raises(ValueError):
            ends(feature)[0, 0] = 0.0


@pytest.mark.parametrize("away", [-5.0, 5.0])
def test_the_clicked_line_snaps_to_an_edge_nearby(away):
    """Already at the click, before any further frame."""
    seen = frame(edge(HOME, 0.3), np.random.default_rng(0))
    start, end = (HOME + s * 40 * along(0.3) + away * across(0.3) for s in (-1, 1))
    snapped = ends(LineTracker(seen, start, end).update(None))  # type: ignore[arg-type]
    assert np.abs((snapped - HOME) @ across(0.3)).max() < 0.1
    assert (snapped - HOME) @ along(0.3) == pytest.approx([-40, 40], abs=0.3)


@pytest.mark.parametrize("by", [-2, 0, 1])
def test_what_is_known_of_the_samples_slides_with_the_segment(by):
    look = Look(10.0, np.zeros(5), np.arange(12.0).reshape(2, 6)).slid(by)
    for k in range(6):
        expected = k + by if 0 <= k + by < 6 else np.nan
        assert look.sides[0, k] == pytest.approx(expected, nan_ok=True)


def test_no_edge_between_the_clicks_is_refused_with_the_nearest_edge_point():
    seen = frame(edge(HOME, 0.0), np.random.default_rng(0))
    with pytest.raises(Untrackable, match="no edge") as refused:
        LineTracker(seen, (120, 60), (200, 60))
    u, v = np.array(refused.value.suggestion)
    assert abs(v - 120) < 3 and abs(u - 160) < 45
    with pytest.raises(Untrackable) as refused:
        LineTracker(frame(np.full(SIZE[::-1], 90.0), np.random.default_rng(1)), (120, 60), (200, 60))
    assert refused.value.suggestion is None


def test_a_line_that_only_starts_on_an_edge_is_refused():
    with pytest.raises(Untrackable):
        LineTracker(frame(edge(HOME, 0.0), np.random.default_rng(0)), (100, 120), (160, 200))


@pytest.mark.parametrize("to", [(103, 104), (100, 100), (400, 100), "there"])
def test_bad_clicks_are_refused(to):
    with pytest.raises(BadInput) as refused:
        LineTracker(frame(edge(HOME, 0.0), np.random.default_rng(0)), (100, 100), to)
    assert not isinstance(refused.value, Untrackable)


def test_a_bad_frame_is_lost_and_the_next_good_one_is_found():
    seen = frame(edge(HOME, 0.3), np.random.default_rng(0))
    tracker = LineTracker(seen, HOME - 40 * along(0.3), HOME + 40 * along(0.3))
    before = tracker.update(seen)
    for bad in (None, seen[:100], seen.astype(float), "frame"):
        feature = tracker.update(bad)  # type: ignore[arg-type]
        assert not feature.ok and np.array_equal(ends(feature), ends(before))
    assert tracker.update(seen).ok


def test_an_edge_across_the_rim_of_the_frame_is_tracked_by_its_visible_part_until_it_leaves():
    off, _, features = follow(lambda k: (np.array([160.0, 120.0 + 6 * k]), 0.0), frames=26)
    inside = np.array([120 + 6 * k < SIZE[1] - 2 for k in range(1, 26)])
    assert ok(features)[inside].all() and off[inside].max() < 0.1
    assert not ok(features)[np.argmin(inside) + 3 :].any()


def test_two_runs_agree_to_the_bit_and_grey_frames_do_as_well():
    runs = [follow(MOTIONS["swinging"], frames=12)[2] for _ in range(2)]
    for a, b in zip(*runs, strict=True):
        assert np.array_equal(ends(a), ends(b)) and a.score == b.score
    rng = np.random.default_rng(0)
    grey = frame(edge(HOME, 0.3), rng)[:, :, 0]
    assert LineTracker(grey, HOME - 40 * along(0.3), HOME + 40 * along(0.3)).update(grey).ok
