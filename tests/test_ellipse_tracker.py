"""Laws of the ellipse tracker on ellipses whose place and shape are known exactly."""

import numpy as np
import pytest
from sequences import texture
from shapes import SIZE, along, ellipse, frame

from vita.errors import BadInput, Untrackable
from vita.vision.ellipse import EllipseTracker

HOME = np.array([160.3, 120.7])
SCENE = texture(5, 400)[: SIZE[1], : SIZE[0]].astype(float)
EVEN = np.full(SIZE[::-1], 80.0)


def follow(motion, frames=24, picture=ellipse, noise=2.0, click=(1.0, -1.0), seed=0):
    """(k,) errors of the centre [px], of the longest diameter [px], and features of a tracked ellipse.

    `motion(k)` gives the centre, the half axes and the angle of frame `k`.
    """
    rng = np.random.default_rng(seed)
    tracker, off, size, features = None, [], [], []
    for k in range(frames):
        center, axes, angle = motion(k)
        seen = picture(center, axes, angle) if picture is ellipse else picture(k, center, axes, angle)
        seen = frame(seen, rng, noise)
        if tracker is None:
            tracker = EllipseTracker(seen, center + click)
            continue
        feature = tracker.update(seen)
        features.append(feature)
        off.append(np.hypot(*(feature.uv - center)))
        outline = np.array(feature.outline)
        across = outline - outline.mean(axis=0)
        size.append(2 * np.hypot(*across.T).max() - 2 * max(axes))
        assert 0 <= feature.score <= 1 and feature.detail and outline.shape == (32, 2)
        assert feature.corners is None and feature.segment is None
    return np.array(off), np.abs(size), features


def ok(features):
    return np.array([f.ok for f in features])


def moving(diameter, step, aspect=0.85):
    """Back and forth with sudden turns at `step` [px/frame]."""
    radius = diameter / 2
    return lambda k: (HOME + [step * (2 - abs(k % 8 - 4)), 0.2 * step], (radius, aspect * radius), 0.4)


@pytest.mark.parametrize("step", [0.3, 3.0, 12.0])
@pytest.mark.parametrize("diameter", [8, 12, 24, 60, 150])
def test_the_centre_is_sub_pixel_from_dots_to_discs(diameter, step):
    """Within 0.1 px at every frame under noise of 2 grey levels, without a false loss."""
    off, size, features = follow(moving(diameter, step))
    assert ok(features).all()
    assert off.max() < 0.1 and np.median(off) < 0.04
    assert size.max() < 1.0 if diameter < 20 else size.max() < 0.4


def test_a_disc_that_fills_the_view_is_tracked():
    """220 px in a view of 240."""
    off, _, features = follow(lambda k: (HOME + [0.5 * k, 0], (110, 108), 0.4), frames=8)
    assert ok(features).all() and off.max() < 0.05


def test_shape_size_and_light_may_change():
    def motion(k):
        return HOME + [20 * np.sin(k / 5), 10 * np.cos(k / 7)], (30 + 9 * np.sin(k / 9), 24), 0.4 + k / 20

    def lit(k, *shape):
        return ellipse(*shape) * (1 + 0.25 * np.sin(k / 5))

    off, size, features = follow(motion, frames=40, picture=lit)
    assert ok(features).all() and off.max() < 0.1 and size.max() < 0.4
    assert features[5].detail == "ellipse 71 x 48 px"


@pytest.mark.parametrize("diameter", [24, 60])
def test_background_may_be_anything(diameter):
    def before_scene(k, *shape):
        return ellipse(*shape, inside=225.0, outside=SCENE)

    off, _, features = follow(moving(diameter, 4.0), picture=before_scene)
    assert ok(features).all()
    assert off.max() < 0.7 and np.median(off) < 0.25


@pytest.mark.parametrize(("diameter", "bound"), [(24, 1.5), (60, 0.5), (150, 0.2)])
def test_a_quarter_may_be_covered(diameter, bound):
    """A textured thing in front of a quarter of the outline neither drags the ellipse nor loses it."""

    def covered(k, center, axes, angle):
        picture = ellipse(center, axes, angle)
        if k > 3:
            edge = max(0, round(center[0] - 0.7 * axes[0]))
            picture[:, :edge] = SCENE[:, :edge] * 1.2
        return picture

    off, _, features = follow(moving(diameter, 2.0, aspect=1.0), picture=covered, frames=30)
    assert ok(features).all()
    assert off.max() < bound


@pytest.mark.parametrize(("diameter", "seed"), [(24, 5), (24, 9), (60, 6), (150, 7)])
def test_covered_is_lost_within_three_frames_and_found_again(diameter, seed):
    """While lost the last good centre stays."""

    thing = texture(seed, 400)[: SIZE[1], : SIZE[0]] * 1.2

    def covered(k, *shape):
        return thing if 8 <= k < 18 else ellipse(*shape)

    off, _, features = follow(moving(diameter, 0.7), picture=covered, frames=28)
    seen = ok(features)
    assert seen[:7].all() and not seen[7 + 3 : 17].any()
    assert all(np.array_equal(f.uv, features[10].uv) for f in features[10:17])
    assert seen[17 + 3 :].all() and off[17 + 3 :].max() < 0.1


def test_gone_or_out_of_the_view_is_lost():
    _, _, features = follow(moving(24, 1.0), picture=lambda k, *s: EVEN if k >= 6 else ellipse(*s), frames=14)
    assert ok(features)[:5].all() and not ok(features)[5 + 3 :].any()
    _, _, features = follow(lambda k: (HOME + [8.0 * k, 0], (15, 15), 0.0), frames=28)
    outside = np.array([HOME[0] + 8 * k > SIZE[0] for k in range(1, 28)])
    assert not ok(features)[np.argmax(outside) + 3 :].any() and ok(features)[:15].all()


def test_colour_alone_is_enough():
    """An orange ball as light as the wood behind it."""
    share = ellipse(HOME, (8, 8), 0.0, inside=1.0, outside=0.0)[:, :, None]
    rng = np.random.default_rng(0)
    orange, wood = np.array([235.0, 105.0, 40.0]), np.array([170.0, 130.0, 91.0])
    frames = []
    for _ in range(6):
        noisy = share * orange + (1 - share) * wood + rng.normal(0, 2, (*SIZE[::-1], 3))
        frames.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    tracker = EllipseTracker(frames[0], HOME)
    for seen in frames[1:]:
        feature = tracker.update(seen)
        assert feature.ok and np.hypot(*(feature.uv - HOME)) < 0.1


def test_a_click_anywhere_inside_finds_the_same_ellipse():
    seen = frame(ellipse(HOME, (40, 30), 0.4), np.random.default_rng(0))
    for way in np.linspace(0, 6, 7):
        feature = EllipseTracker(seen, HOME + 24 * along(way)).update(seen)
        assert feature.ok and np.hypot(*(feature.uv - HOME)) < 0.05


def test_no_ellipse_is_refused_with_the_nearest_one():
    seen = frame(ellipse(HOME, (14, 12), 0.4), np.random.default_rng(0))
    with pytest.raises(Untrackable, match="no ellipse") as refused:
        EllipseTracker(seen, HOME + (50, 20))
    assert refused.value.suggestion == pytest.approx(tuple(HOME), abs=0.3)
    with pytest.raises(Untrackable) as refused:
        EllipseTracker(frame(EVEN, np.random.default_rng(1)), HOME)
    assert refused.value.suggestion is None


def test_a_square_is_no_ellipse():
    picture = EVEN.copy()
    picture[90:150, 130:190] = 200.0
    with pytest.raises(Untrackable):
        EllipseTracker(frame(picture, np.random.default_rng(0)), HOME)


@pytest.mark.parametrize("uv", [(-3, 10), (400, 100), (np.nan, 1), "here"])
def test_bad_clicks_are_refused(uv):
    with pytest.raises(BadInput) as refused:
        EllipseTracker(frame(ellipse(HOME, (14, 12), 0.4), np.random.default_rng(0)), uv)
    assert not isinstance(refused.value, Untrackable)


def test_a_bad_frame_is_lost_and_the_next_good_one_is_found():
    seen = frame(ellipse(HOME, (14, 12), 0.4), np.random.default_rng(0))
    tracker = EllipseTracker(seen, HOME)
    before = tracker.update(seen)
    for bad in (None, seen[:100], seen.astype(float), "frame"):
        feature = tracker.update(bad)  # type: ignore[arg-type]
        assert not feature.ok and np.array_equal(feature.uv, before.uv)
    assert tracker.update(seen).ok


def test_two_runs_agree_to_the_bit_and_grey_frames_do_as_well():
    runs = [follow(moving(24, 3.0), frames=8)[2] for _ in range(2)]
    for a, b in zip(*runs, strict=True):
        assert np.array_equal(a.uv, b.uv) and a.score == b.score
        assert np.array_equal(np.array(a.outline), np.array(b.outline))
    grey = frame(ellipse(HOME, (14, 12), 0.4), np.random.default_rng(0))[:, :, 0]
    assert EllipseTracker(grey, HOME).update(grey).ok
