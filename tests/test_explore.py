"""Laws of the exploratory motions, and of the noise that chooses their size."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fake_robot import planar_arm_pixels
from hypothesis import given, settings
from hypothesis import strategies as st

from vita.errors import BadInput
from vita.servo.estimators.base import CURVATURE
from vita.servo.explore import LARGEST_RAD, JointStuck, Sample, explore, sizes_of
from vita.servo.noise import LEAST_PX, ROUNDING_PX, explore_size, measured_sigma
from vita.types import Array, Joint

START = np.array([0.3, 0.5, -0.4])
JOINTS = [Joint(f"j{i}", -3.0, 3.0, 3.0) for i in range(3)]


def carried_out(
    delta: float | list[float] = 0.01,
    *,
    start: Array = START,
    joints: list[Joint] = JOINTS,
    use: tuple[int, ...] = (0, 1, 2),
    pixels: Callable[[Array], Array] = planar_arm_pixels,
    share: float = 1.0,
    **options: Any,
) -> tuple[Array, list[Array]]:
    """The Jacobian that an arm finds, and all positions that it has been at. The arm carries out
    `share` of what is left in each period."""
    q, been = start.copy(), [start.copy()]
    exploration = explore(Sample(q, pixels(q)), joints, use, delta, **options)
    request = next(exploration)
    while True:
        q = q + share * (request.target - q)
        been.append(q)
        try:
            request = exploration.send(Sample(q.copy(), pixels(q)))
        except StopIteration as end:
            return end.value, been


def true_jacobian(q: Array, pixels: Callable[[Array], Array] = planar_arm_pixels) -> Array:
    step = 1e-6
    columns = [(pixels(q + step * axis) - pixels(q - step * axis)) / (2 * step) for axis in np.eye(q.size)]
    return np.stack(columns, axis=1)


def column_errors(jacobian: Array, truth: Array) -> Array:
    """(n,) relative error of each column."""
    return np.linalg.norm(jacobian - truth, axis=0) / np.linalg.norm(truth, axis=0)


# ---- by joint motion (thesis eq. 2.17, row E6) ---------------------------------------------------


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), st.sampled_from([1.0, 0.5]))
def test_a_hundredth_of_a_radian_finds_each_column_within_two_percent(q: list[float], share: float) -> None:
    start = np.array(q) + [0.0, 1.5, 0.0]  # Away from the stretched arm, where a column may vanish.
    jacobian, been = carried_out(0.01, start=start, share=share)
    assert column_errors(jacobian, true_jacobian(start)).max() < 0.02
    np.testing.assert_allclose(been[-1], start, atol=1e-6)


def test_differences_to_both_sides_are_exact_to_second_order() -> None:
    for delta in (0.02, 0.08):
        one, both = (carried_out(delta, central=c)[0] for c in (False, True))
        truth = true_jacobian(START)
        assert column_errors(both, truth).max() < 0.2 * column_errors(one, truth).max()
    errors = [np.abs(carried_out(d, central=True)[0] - true_jacobian(START)).max() for d in (0.04, 0.08)]
    assert errors[1] / errors[0] == pytest.approx(4.0, rel=0.1)


def test_each_joint_may_have_its_own_size() -> None:
    log: list[Sample] = []
    carried_out([0.01, 0.05, 0.03], log=log)
    np.testing.assert_allclose(sizes_of(log, 3), [0.01, 0.05, 0.03], atol=1e-9)


def test_joints_that_are_not_used_stay_and_have_no_column() -> None:
    jacobian, been = carried_out(0.05, use=(2, 0), central=True)
    assert np.ptp(np.array(been)[:, 1]) == 0.0
    assert not jacobian[:, 1].any() and jacobian[:, [0, 2]].any(axis=0).all()


def test_the_log_holds_the_start_and_every_place_that_was_arrived_at() -> None:
    for central, places in ((False, 2), (True, 3)):
        log: list[Sample] = []
        carried_out(0.05, share=0.5, log=log, central=central)
        assert len(log) == 1 + places * 3
        np.testing.assert_array_equal(log[0].q, START)
        for sample in log:
            np.testing.assert_array_equal(sample.e, planar_arm_pixels(sample.q))
            assert np.count_nonzero(np.abs(sample.q - START) > 1e-5) <= 1


def test_a_joint_near_its_limits_stays_within_them() -> None:
    """One has room below only, one above only, one on neither side for the whole motion."""
    joints = [Joint("up", -3.0, 0.31, 1.0), Joint("down", 0.49, 3.0, 1.0), Joint("tight", -0.45, -0.35, 1.0)]
    low, high = np.array([[j.lower, j.upper] for j in joints]).T
    for want, central in ((0.0, False), (0.0, True), (80.0, False), (80.0, True)):
        jacobian, been = carried_out(0.04, joints=joints, want_px=want, central=central)
        assert (np.array(been) >= low - 1e-12).all() and (np.array(been) <= high + 1e-12).all()
        assert column_errors(jacobian, true_jacobian(START)).max() < 0.2
    log: list[Sample] = []
    carried_out(0.04, joints=joints, log=log)
    turned = np.array([s.q - START for s in log])
    assert turned[:, 0].min() == pytest.approx(-0.04) and turned[:, 1].max() == pytest.approx(0.04)


@pytest.mark.parametrize("options", [{}, {"central": True}, {"want_px": 20.0}])
def test_a_joint_that_does_not_move_is_named(options: dict) -> None:
    q = START.copy()
    exploration = explore(Sample(q, planar_arm_pixels(q)), JOINTS, (0, 1, 2), 0.05, **options)
    request = next(exploration)
    with pytest.raises(JointStuck) as stuck:
        for _ in range(200):
            q = q + (request.target - q) * [1.0, 0.0, 1.0]
            request = exploration.send(Sample(q.copy(), planar_arm_pixels(q)))
    assert stuck.value.joint == 1


def test_an_arm_that_does_not_do_small_motions_is_not_taken_for_stuck() -> None:
    """The last try by feature motion may differ from the one before by less than the dead band."""
    q, log = START.copy(), []
    exploration = explore(Sample(q, planar_arm_pixels(q)), JOINTS, (0, 1, 2), 0.05, want_px=12.0, log=log)
    request = next(exploration)
    with pytest.raises(StopIteration) as end:
        for _ in range(500):
            dq = request.target - q
            q = np.where(np.abs(dq) > np.radians(0.4), q + dq, q)
            request = exploration.send(Sample(q.copy(), planar_arm_pixels(q)))
    assert column_errors(end.value.value, true_jacobian(START)).max() < 0.2


# ---- by feature motion (row C11) -----------------------------------------------------------------


def image_motion(log: list[Sample], joint: int) -> float:
    """Largest change of a row at the last place that `joint` was moved to [px]."""
    away = [s for s in log if abs(s.q[joint] - log[0].q[joint]) > 1e-5]
    return float(np.abs(away[-1].e - log[0].e).max())


@settings(max_examples=40, deadline=None)
@given(
    want=st.floats(3.0, 60.0),
    q=st.lists(st.floats(-0.8, 0.8), min_size=3, max_size=3),
    noise=st.sampled_from([0.0, 0.2]),
)
def test_each_joint_moves_the_features_by_what_is_wanted(want: float, q: list[float], noise: float) -> None:
    start, random = np.array(q) + [0.0, 1.2, 0.0], np.random.default_rng(1)

    def pixels(joints: Array) -> Array:
        return planar_arm_pixels(joints) + noise * random.standard_normal(4)

    log: list[Sample] = []
    jacobian, been = carried_out(start=start, pixels=pixels, want_px=want, log=log)
    for k in range(3):
        reached = sizes_of(log, 3)[k] > LARGEST_RAD - 1e-6
        # The start was read anew since; two readings of a row differ by so much at most.
        assert reached or abs(image_motion(log, k) - want) <= 0.2 * want + 6.0 * noise
    np.testing.assert_allclose(been[-1], start, atol=1e-6)
    if not noise and want < 20.0:
        # Half of what a column turns by along its motion, the wrist's by the whole angle.
        bound = 0.05 + 0.6 * sizes_of(log, 3)
        assert (column_errors(jacobian, true_jacobian(start)) < bound).all()


def test_a_joint_that_hardly_moves_the_image_is_not_swung_round() -> None:
    log: list[Sample] = []
    lever = np.array([[500.0, 0.0, 5.0], [0.0, 400.0, 0.0]])
    _, been = carried_out(pixels=lambda q: lever @ q, want_px=30.0, log=log)
    farthest = np.abs(np.array(been) - START).max(axis=0)
    assert farthest[2] == pytest.approx(LARGEST_RAD) and farthest.max() <= LARGEST_RAD + 1e-9
    assert farthest[0] == pytest.approx(30.0 / 500.0, rel=0.2)


def test_a_row_that_is_not_seen_does_not_hide_what_the_others_do() -> None:
    def pixels(q: Array) -> Array:
        return np.append(planar_arm_pixels(q), np.nan)

    log: list[Sample] = []
    jacobian, _ = carried_out(pixels=pixels, want_px=10.0, log=log)
    assert np.isnan(jacobian[4]).all() and np.isfinite(jacobian[:4]).all()
    seen = [Sample(s.q, s.e[:4]) for s in log]
    assert all(8.0 <= image_motion(seen, k) <= 12.0 for k in range(3))


# ---- noise ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.03, 0.2, 0.43, 2.0])
def test_the_noise_of_an_arm_at_rest_is_measured_within_a_few_percent(sigma: float) -> None:
    random = np.random.default_rng(2)
    samples = random.uniform(-200, 200, 12) + sigma * random.standard_normal((300, 12))
    assert measured_sigma(samples) == pytest.approx(sigma, rel=0.04)


def test_one_wild_reading_changes_the_measured_noise_by_little() -> None:
    random = np.random.default_rng(3)
    samples = 30.0 + 0.2 * random.standard_normal((20, 4))
    clean = measured_sigma(samples)
    samples[7, 2] += 50.0
    assert measured_sigma(samples) == pytest.approx(clean, rel=0.1)


def test_rows_of_which_some_are_noisier_are_not_taken_for_wild() -> None:
    random = np.random.default_rng(4)
    each = np.array([0.05, 0.05, 0.05, 0.8])
    samples = each * random.standard_normal((400, 4))
    assert measured_sigma(np.array(samples)) == pytest.approx(float(np.sqrt(np.mean(each**2))), rel=0.05)


@given(st.integers(2, 20), st.integers(1, 6))
def test_whole_pixels_at_rest_have_the_noise_of_rounding_twice(t: int, m: int) -> None:
    samples = np.tile(np.arange(m) * 7.0 - 3.0, (t, 1))
    assert measured_sigma(np.array(samples, float)) == ROUNDING_PX
    moving = np.random.default_rng(5).uniform(0, 50, (2, 20_000))
    assert np.std(np.rint(moving[0]) - np.rint(moving[1]) - (moving[0] - moving[1])) == pytest.approx(
        ROUNDING_PX, rel=0.02
    )


def test_whole_pixels_that_shake_have_at_least_the_noise_that_is_seen() -> None:
    samples = np.rint(2.0 * np.random.default_rng(6).standard_normal((500, 4)))
    assert measured_sigma(samples) == pytest.approx(2.0, rel=0.06)


def test_no_tracker_is_taken_to_be_perfect_and_rows_that_are_not_seen_do_not_count() -> None:
    assert measured_sigma(np.full((10, 4), 12.3)) == LEAST_PX
    random = np.random.default_rng(7)
    samples = 0.3 * random.standard_normal((200, 4))
    samples[:, 1] = np.nan
    samples[::3, 2] = np.nan
    assert measured_sigma(samples) == pytest.approx(0.3, rel=0.08)


@pytest.mark.parametrize(
    "samples", [np.zeros((1, 4)), np.zeros(5), np.full((9, 2), np.nan), np.zeros((0, 3))]
)
def test_too_few_readings_are_refused(samples: Array) -> None:
    with pytest.raises(BadInput, match="two readings"):
        measured_sigma(samples)


# ---- size ----------------------------------------------------------------------------------------


@given(st.floats(0.02, 2.0), st.floats(50.0, 2000.0))
def test_the_chosen_size_has_the_least_variance_of_all_that_are_allowed(sigma: float, scale: float) -> None:
    allowed = np.linspace(np.radians(1.0), np.radians(10.0), 4001)
    variance = 2 * sigma**2 / allowed**2 + (0.5 * CURVATURE * allowed * scale) ** 2
    assert float(explore_size(sigma, scale)) == pytest.approx(allowed[variance.argmin()], abs=1e-4)


def test_a_size_is_found_for_each_joint_and_noisier_trackers_need_larger_ones() -> None:
    scales = np.array([100.0, 400.0, 1600.0])
    sizes = explore_size(0.3, scales)
    assert sizes.shape == (3,) and (np.diff(sizes) < 0).all()
    assert explore_size(0.3) > explore_size(0.1)
    assert explore_size(100.0) == pytest.approx(np.radians(10.0))
    assert explore_size(1e-6) == pytest.approx(np.radians(1.0))
    assert explore_size(0.3, 0.0) == pytest.approx(np.radians(10.0))


@pytest.mark.parametrize("sigma", [0.0, -1.0, np.nan])
def test_a_noise_that_is_none_is_refused(sigma: float) -> None:
    with pytest.raises(BadInput, match="noise"):
        explore_size(sigma)


def test_the_chosen_size_finds_a_better_jacobian_than_half_or_twice_of_it() -> None:
    """On features that bend as much as is assumed: e = s (q + kappa q^2 / 2)."""
    random, scale, sigma = np.random.default_rng(8), 400.0, 0.3

    def rms(delta: float) -> float:
        bent = scale * (delta + 0.5 * CURVATURE * delta**2)
        noise = sigma * (random.standard_normal(20_000) - random.standard_normal(20_000))
        return float(np.sqrt(np.mean(((bent + noise) / delta - scale) ** 2)))

    best = float(explore_size(sigma, scale))
    assert rms(best) < 0.9 * rms(0.5 * best) and rms(best) < 0.9 * rms(2.0 * best)
