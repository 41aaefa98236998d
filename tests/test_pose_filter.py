"""The pose filter: its slopes, its honesty, and how much better it is than holding the last measurement."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from vita.errors import BadInput
from vita.stereo.base import Lens, MarkerCorners, PoseSight, StereoRig, marker_square
from vita.stereo.corner_update import Evidence, corrected
from vita.stereo.filter_model import CornerModel, FilterSettings, MotionState, noise, predict
from vita.stereo.pose_filter import PoseFilter
from vita.stereo.projection import project
from vita.stereo.rotations import rigid, rotation_exp, rotation_log

SIZE, SIGMA, FRAME = 0.08, 0.3, 0.03
T_RIGHT_LEFT = rigid(rotation_exp(np.array([0.01, -0.03, 0.005])), np.array([-0.2, 0.002, -0.004]))
RIG = StereoRig(Lens(800, 810, 320, 240), Lens(790, 800, 330, 235), T_RIGHT_LEFT)
MODEL = CornerModel(RIG, SIZE)
FACING = np.diag([1.0, -1, -1]) @ rotation_exp(np.array([0.3, -0.25, 0.1]))
PLACE = np.array([0.1, 0.0, 1.0])
Motion = Callable[[float], tuple[np.ndarray, np.ndarray]]


def state(
    p: np.ndarray, R: np.ndarray, v: np.ndarray | None = None, w: np.ndarray | None = None
) -> MotionState:
    zero = np.zeros(3)
    return MotionState(p, R, zero if v is None else v, zero if w is None else w, 1e-4 * np.eye(12))


def at_rest(t: float) -> tuple[np.ndarray, np.ndarray]:
    return PLACE, FACING


def circle(speed: float) -> Motion:
    """A circle of 10 cm radius, tilted in depth, while the marker swings at up to 20 degrees a second."""
    rate, swing = speed / 0.1, np.radians(30)

    def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
        c, s = np.cos(rate * t), np.sin(rate * t)
        turn = np.array([swing * np.sin(np.radians(20) / swing * t), 0, 0])
        return PLACE + 0.1 * np.array([c, 0.8 * s, 0.6 * s]), rotation_exp(turn) @ FACING

    return motion


def turn_back(t: float) -> tuple[np.ndarray, np.ndarray]:
    """To and fro at 0.15 m/s along a slant, turned back within a tenth of a second or so."""
    phase = 2 * np.pi * t / 2.4
    way = 0.15 * 2.4 / 4 * 2 / np.pi * np.arcsin(0.98 * np.sin(phase))
    return PLACE + way * np.array([0.6, 0.5, 0.62]), rotation_exp(np.array([2.0 * way, 0, 0])) @ FACING


def pixels(motion: Motion, t: float, draw: np.random.Generator, sigma: float = SIGMA) -> np.ndarray:
    """(2, 8) what the cameras see."""
    return MODEL.expected(state(*motion(t)))[0] + sigma * draw.standard_normal((2, 8))


def corners(z: np.ndarray, left: bool = True, right: bool = True) -> MarkerCorners:
    return MarkerCorners(z[0].reshape(4, 2) if left else None, z[1].reshape(4, 2) if right else None, SIGMA)


def sight(z: np.ndarray, near: tuple[np.ndarray, np.ndarray]) -> PoseSight:
    """The pose that fits these corners best, by Newton steps from one that is near."""
    s = state(*near)
    for _ in range(4):
        h, H = MODEL.expected(s)
        A = H.reshape(-1, 6)
        step = np.asarray(np.linalg.lstsq(A, (z - h).ravel(), rcond=None)[0], dtype=float)
        s = s.shifted(np.concatenate([step, np.zeros(6)]), s.covariance)
    return PoseSight(rigid(s.R, s.p), np.asarray(SIGMA**2 * np.linalg.inv(A.T @ A), dtype=float), 0.0)


def apart(truth: tuple[np.ndarray, np.ndarray], T: np.ndarray) -> np.ndarray:
    """(6,) truth minus `T`: position [m] and small rotation [rad]."""
    return np.concatenate([truth[0] - T[:3, 3], rotation_log(truth[1] @ T[:3, :3].T)])


class Trial:
    """One filter on one motion; errors of the filter and of holding the last measurement."""

    def __init__(
        self,
        motion: Motion,
        seed: int = 0,
        span: float = 4.0,
        wild: float = 0.0,
        hidden: Callable[[float], bool] = lambda t: False,
    ) -> None:
        draw = np.random.default_rng(seed)
        self.filter, self.held = PoseFilter(RIG, SIZE), None
        self.errors, self.holding, self.nees, self.bridged = [], [], [], []
        for k in range(round(span / FRAME)):
            t = k * FRAME
            if not hidden(t):
                z = pixels(motion, t, draw)
                held = sight(z, motion(t))
                for corner in np.flatnonzero(draw.random(8) < wild):
                    z.reshape(8, 2)[corner] += draw.choice([-1, 1], 2) * draw.uniform(4, 60, 2)
                self.filter.update(t, corners(z), held if k == 0 else sight(z, motion(t)))
            for after in (0.01, 0.02, 0.03) if t > 1.0 else ():
                found = self.filter.at(t + after)
                assert found is not None
                truth = motion(t + after)
                error = apart(truth, found.T_left_marker)
                nees = error @ np.linalg.solve(found.covariance[:6, :6], error) / 6
                if hidden(t):
                    self.bridged.append((np.linalg.norm(error[:3]), nees))
                    continue
                self.errors.append(error)
                self.holding.append(apart(truth, held.T_left_marker))
                self.nees.append(nees)

    @property
    def millimetres(self) -> float:
        return 1e3 * rms(np.array(self.errors)[:, :3])

    @property
    def ratio(self) -> float:
        """Error in position over that of holding the last measurement."""
        return rms(np.array(self.errors)[:, :3]) / rms(np.array(self.holding)[:, :3])


def rms(x: np.ndarray) -> float:
    return float(np.sqrt((x**2).sum(axis=1).mean()))


# ---- the models ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_corner_slopes_match_finite_differences(seed: int) -> None:
    draw = np.random.default_rng(seed)
    s = state(PLACE + draw.uniform(-0.2, 0.2, 3), rotation_exp(0.4 * draw.standard_normal(3)) @ FACING)
    h, H = MODEL.expected(s)
    points = s.p + marker_square(SIZE) @ s.R.T
    assert np.allclose(h[0].reshape(4, 2), project(RIG.left, points), atol=1e-9)
    there = points @ T_RIGHT_LEFT[:3, :3].T + T_RIGHT_LEFT[:3, 3]
    assert np.allclose(h[1].reshape(4, 2), project(RIG.right, there), atol=1e-9)
    for i, d in enumerate(1e-6 * np.eye(12)[:6]):
        slope = (
            MODEL.expected(s.shifted(d, s.covariance))[0] - MODEL.expected(s.shifted(-d, s.covariance))[0]
        ) / 2e-6
        assert np.allclose(H[:, :, i], slope, atol=1e-3, rtol=1e-5)


@pytest.mark.parametrize("dt", [1e-3, 0.03, 0.2, -0.02])
def test_motion_slope_matches_finite_differences(dt: float) -> None:
    """The covariance of a prediction is F P F' with F the slope of the predicted error."""
    draw = np.random.default_rng(5)
    settings = FilterSettings()
    s = state(PLACE, FACING, draw.standard_normal(3), 2.0 * draw.standard_normal(3))

    def after(error: np.ndarray) -> np.ndarray:
        moved, plain = predict(s.shifted(error, s.covariance), dt, settings), predict(s, dt, settings)
        turn = rotation_log(moved.R @ plain.R.T)
        return np.concatenate([moved.p - plain.p, turn, moved.v - plain.v, moved.w - plain.w])

    F = np.column_stack([(after(d) - after(-d)) / 2e-5 for d in 1e-5 * np.eye(12)])
    root = draw.standard_normal((12, 12))
    given = MotionState(s.p, s.R, s.v, s.w, root @ root.T)
    assert np.allclose(predict(given, dt, settings).covariance, F @ root @ root.T @ F.T, atol=1e-5)


def test_two_predictions_make_one() -> None:
    """Predicting 30 ms at once or by 1 ms steps is the same, in mean and covariance with its noise."""
    settings = FilterSettings(acceleration_density=1.0, turn_density=1.0)
    at_once = steps = state(PLACE, FACING, np.array([0.1, -0.2, 0.05]), np.array([0.03, 0.02, -0.04]))
    at_once = predict(at_once, 0.03, settings)
    total = at_once.covariance + noise(0.03, settings)
    for _ in range(30):
        s = predict(steps, 1e-3, settings)
        steps = MotionState(s.p, s.R, s.v, s.w, s.covariance + noise(1e-3, settings))
    assert np.allclose(steps.p, at_once.p, atol=1e-12) and np.allclose(steps.R, at_once.R, atol=1e-12)
    assert np.allclose(steps.covariance, total, atol=1e-6, rtol=1e-3)


def test_noise_is_that_of_white_acceleration() -> None:
    """Monte Carlo: many small random pushes."""
    settings, draw = FilterSettings(acceleration_density=0.5, turn_density=0.1), np.random.default_rng(6)
    steps = 200
    pushes = np.sqrt(0.5 * 0.2 / steps) * draw.standard_normal((20_000, steps))
    v = pushes.cumsum(axis=1)
    p = (0.2 / steps) * (v.sum(axis=1) - 0.5 * v[:, -1])
    Q = noise(0.2, settings)
    assert np.cov(p, v[:, -1]) == pytest.approx(Q[np.ix_([0, 6], [0, 6])], rel=0.05)
    assert Q[np.ix_([4, 10], [4, 10])] == pytest.approx(0.2 * Q[np.ix_([1, 7], [1, 7])])
    assert np.count_nonzero(Q) == 24 and np.allclose(Q, Q.T)


def test_correction_is_that_of_the_textbook() -> None:
    """6 by 6 or 16 by 16, the Kalman correction and the innovation's distance are the same."""
    draw = np.random.default_rng(7)
    root, H, off = draw.standard_normal((12, 12)), draw.standard_normal((16, 6)), draw.standard_normal(16)
    P, Hx = root @ root.T, np.hstack([H, np.zeros((16, 6))])
    S = Hx @ P @ Hx.T + 0.3**2 * np.eye(16)
    K = P @ Hx.T @ np.linalg.inv(S)
    evidence = Evidence.of(off[:8], H[:8], 0.3) + Evidence.of(off[8:], H[8:], 0.3)
    error, after = corrected(P, evidence, np.zeros(6))
    assert np.allclose(error, K @ off, atol=1e-8) and np.allclose(after, P - K @ Hx @ P, atol=1e-8)
    distance, det = evidence.surprise(P[:6, :6])
    assert float(distance) == pytest.approx(off @ np.linalg.solve(S, off))
    assert evidence.distance2(P[:6, :6]) == pytest.approx(float(distance))
    assert float(det) == pytest.approx(np.linalg.slogdet(S / 0.3**2)[1])
    best = np.linalg.lstsq(H, off, rcond=None)
    assert evidence.unexplained() == (pytest.approx(float(best[1][0]) / 0.09), 10)
    # Linearised elsewhere, a linear measurement says the same.
    x = draw.standard_normal(6)
    moved = Evidence.of(off - H @ x, H, 0.3)
    assert np.allclose(corrected(P, moved, x)[0], K @ off, atol=1e-7)


# ---- the filter ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [0.08, 0.15])
def test_error_is_half_of_holding_the_last_measurement(speed: float) -> None:
    """T13: vision each 30 ms, asked in between."""
    trial = Trial(circle(speed), span=6.0)
    assert trial.ratio < 0.5 and trial.millimetres < 1.4
    turned = np.array(trial.errors)[:, 3:], np.array(trial.holding)[:, 3:]
    assert rms(turned[0]) < 0.7 * rms(turned[1])
    assert np.mean(trial.nees) < 1.3


def test_a_hand_that_turns_back_is_followed_too() -> None:
    """The vigour adapts: a filter that is always calm overshoots and is refused its own measurements."""
    trial = Trial(turn_back, span=6.0)
    assert trial.ratio < 0.5 and np.linalg.norm(np.array(trial.errors)[:, :3], axis=1).max() < 0.01
    assert np.mean(trial.nees) < 1.6


def test_no_bias_at_rest_and_noise_averaged() -> None:
    trials = [Trial(at_rest, seed=k, span=2.2) for k in range(4)]
    errors = np.concatenate([np.array(trial.errors) for trial in trials])
    assert np.linalg.norm(errors[:, :3].mean(axis=0)) < 4e-4
    assert np.mean([trial.ratio for trial in trials]) < 0.85
    assert 0.4 < np.mean([nees for trial in trials for nees in trial.nees]) < 1.2


def test_consistent_when_the_world_is_as_the_filter_believes() -> None:
    """Motion drawn from the model itself: NEES and NIS have the mean of their chi-square."""
    settings = FilterSettings(vigour=(1.0,), acceleration_density=0.02, turn_density=0.05)
    nees, nis = [], []
    root = np.linalg.cholesky(noise(FRAME, settings))
    for seed in range(12):
        draw = np.random.default_rng(100 + seed)
        truth = state(PLACE, FACING, 0.05 * draw.standard_normal(3), 0.2 * draw.standard_normal(3))
        f = PoseFilter(RIG, SIZE, settings)
        for k in range(40):
            t = k * FRAME
            z = MODEL.expected(truth)[0] + SIGMA * draw.standard_normal((2, 8))
            assert f.update(t, corners(z), sight(z, (truth.p, truth.R)))
            found = f.at(t)
            assert found is not None
            if k >= 10 and f.nis is not None:
                T = found.T_left_marker
                error = np.concatenate(
                    [apart((truth.p, truth.R), T), truth.v - found.velocity, truth.w - found.turn_rate]
                )
                nees.append(error @ np.linalg.solve(found.covariance, error))
                nis.append(f.nis[0])
                assert f.nis[1] == 16
            truth = predict(truth, FRAME, settings).shifted(root @ draw.standard_normal(12), truth.covariance)
    # 360 pictures; neighbours' errors are alike, so the bounds on NEES are those of 60 independent ones.
    assert 10.5 < np.mean(nees) < 13.7
    assert 15.2 < np.mean(nis) < 16.8


@pytest.mark.parametrize(("motion", "bound"), [(at_rest, 8e-3), (circle(0.08), 0.011), (circle(0.15), 0.022)])
def test_occlusions_of_a_third_of_a_second_are_bridged(motion: Motion, bound: float) -> None:
    """Within the bound, and the covariance says how well."""
    trial = Trial(motion, span=6.5, hidden=lambda t: t > 1.2 and (t + 1e-9) % 1.5 < 0.3)
    worst, nees = np.array(trial.bridged).T
    assert len(worst) > 80 and worst.max() < bound and nees.mean() < 1.6
    assert trial.millimetres < 2.5


def test_hidden_for_long_the_motion_dies_away_and_the_covariance_grows() -> None:
    trial = Trial(circle(0.15), span=2.0)
    start = 66 * FRAME
    found = [trial.filter.at(start + age) for age in np.arange(0.0, 3.0, 0.05)]
    speeds = [np.linalg.norm(one.velocity) for one in found if one is not None]
    sizes = [np.trace(one.covariance[:3, :3]) for one in found if one is not None]
    assert speeds[0] == pytest.approx(0.15, rel=0.2) and speeds[-1] < 1e-4
    assert all(b > a for a, b in pairwise(sizes)) and found[-1] is not None
    assert found[-1].age_s == pytest.approx(2.95, abs=0.02)
    limit = trial.filter.settings.coast_s + trial.filter.settings.decay_s
    assert found[0] is not None
    went = np.linalg.norm(found[-1].T_left_marker[:3, 3] - found[0].T_left_marker[:3, 3])
    assert went == pytest.approx(speeds[0] * limit, rel=0.01)
    # Had it gone on, it would be further: after a second the covariance must cover that too.
    later = found[20]
    assert later is not None
    ahead = found[0].velocity - (later.T_left_marker - found[0].T_left_marker)[:3, 3]
    assert ahead @ np.linalg.solve(later.covariance[:3, :3], ahead) < 1.0


def test_two_wild_corners_in_a_hundred_do_no_harm() -> None:
    clean, wild = Trial(circle(0.15), span=5.0), Trial(circle(0.15), span=5.0, wild=0.02)
    assert wild.millimetres < 1.15 * clean.millimetres
    assert np.linalg.norm(np.array(wild.errors)[:, :3], axis=1).max() < 0.006


def test_one_camera_is_enough_for_a_while() -> None:
    """Left alone for a second while the marker goes on: across the ray as before, depth slowly worse."""
    motion, draw, f = circle(0.08), np.random.default_rng(8), PoseFilter(RIG, SIZE)
    for k in range(100):
        t = k * FRAME
        z = pixels(motion, t, draw)
        assert f.update(t, corners(z, right=t < 2.0), sight(z, motion(t)))
        assert k == 0 or (f.nis is not None and f.nis[1] == (16 if t < 2.0 else 8))
    found = f.at(t)
    assert found is not None
    error = apart(motion(t), found.T_left_marker)
    assert np.linalg.norm(error[:2]) < 2e-3 and abs(error[2]) < 0.012
    assert error @ np.linalg.solve(found.covariance[:6, :6], error) / 6 < 2.5


def test_one_camera_that_sees_something_else_is_left_out() -> None:
    draw, f = np.random.default_rng(9), PoseFilter(RIG, SIZE)
    for k in range(60):
        z = pixels(at_rest, 0.0, draw)
        if k > 20:
            z[1] += 40.0
        assert f.update(k * FRAME, corners(z), None if k else sight(z, (PLACE, FACING)))
    found = f.at(59 * FRAME)
    assert found is not None and np.linalg.norm(apart((PLACE, FACING), found.T_left_marker)[:3]) < 5e-3


def test_a_marker_that_jumps_is_refused_and_then_followed_anew() -> None:
    draw, f = np.random.default_rng(10), PoseFilter(RIG, SIZE)

    def moved(t: float) -> tuple[np.ndarray, np.ndarray]:
        return PLACE + (0.1, 0.05, -0.1), FACING

    taken = []
    for k in range(20):
        z = pixels(at_rest if k < 10 else moved, 0.0, draw)
        # Whether the caller need work out a pose from these pictures alone.
        wanted = f.wants_start(k * FRAME)
        taken.append(f.update(k * FRAME, corners(z), sight(z, moved(0)) if wanted else None))
        assert wanted == (k in (0, 12))
    assert taken == [True] * 10 + [False] * 2 + [True] * 8
    found = f.at(0.6)
    assert found is not None and np.linalg.norm(apart(moved(0), found.T_left_marker)[:3]) < 5e-3


def test_understated_pixel_noise_is_noticed() -> None:
    """Corners said to be good to 0.3 px that are good to 0.9: the pictures go on being believed."""
    draw, f, nees, taken = np.random.default_rng(11), PoseFilter(RIG, SIZE), [], []
    for k in range(150):
        z = pixels(at_rest, 0.0, draw, sigma=0.9)
        taken.append(f.update(k * FRAME, corners(z), sight(z, (PLACE, FACING))))
        found = f.at(k * FRAME)
        assert found is not None
        error = apart((PLACE, FACING), found.T_left_marker)
        if k > 60:
            nees.append(error @ np.linalg.solve(found.covariance[:6, :6], error) / 6)
    assert 5.0 < f.noise_level < 11.0 and np.mean(taken[30:]) > 0.97 and np.mean(nees) < 1.6


def test_before_the_first_picture_and_with_unfit_ones() -> None:
    draw, f = np.random.default_rng(12), PoseFilter(RIG, SIZE)
    z = pixels(at_rest, 0.0, draw)
    assert f.at(0.0) is None and f.wants_start(0.0)
    assert not f.update(0.0, MarkerCorners(None, None), None) and not f.update(0.0, corners(z), None)
    assert f.update(1.0, corners(z), sight(z, (PLACE, FACING)))
    assert not f.update(0.9, corners(z), None)  # Late: newer ones have been taken.
    assert not f.update(1.1, corners(z * np.nan), None)
    with pytest.raises(BadInput, match="four corners"):
        f.update(1.1, MarkerCorners(np.zeros((3, 2)), None), None)
    assert not f.update(5.0, corners(z), None) and f.update(5.0, corners(z), sight(z, (PLACE, FACING)))
    found = f.at(5.0)
    assert found is not None and not found.velocity.any()
    f.restart()
    assert f.at(5.0) is None


def test_a_marker_behind_a_camera_is_not_expected_there() -> None:
    h, H = MODEL.expected(state(np.array([0.0, 0, -1.0]), FACING))
    assert np.isnan(h).all()
    near = StereoRig(RIG.left, RIG.right, rigid(np.eye(3), np.array([-0.2, 0, -1.5])))
    h, H = CornerModel(near, SIZE).expected(state(PLACE, FACING))
    assert np.isfinite(h[0]).all() and np.isfinite(H[0]).all() and np.isnan(h[1]).all()


@pytest.mark.parametrize(
    "wrong", [{"gate": 0.0}, {"decay_s": float("nan")}, {"memory": 1.0}, {"vigour": (1.0, -1.0)}]
)
def test_unfit_settings_are_refused_by_name(wrong: dict) -> None:
    with pytest.raises(BadInput, match=next(iter(wrong))):
        FilterSettings(**wrong)
    with pytest.raises(BadInput, match="size_m"):
        PoseFilter(RIG, 0.0)


def test_tool_and_target_that_move_alike_lag_alike() -> None:
    """The same settings: what the two filters get wrong together cancels in their difference."""
    draw = np.random.default_rng(13)
    shift, motion = np.array([-0.12, 0.05, 0.05]), circle(0.15)

    def other(t: float) -> tuple[np.ndarray, np.ndarray]:
        p, R = motion(t)
        return p + shift, R

    filters, own, gaps = (PoseFilter(RIG, SIZE), PoseFilter(RIG, SIZE)), [], []
    for k in range(120):
        t = k * FRAME
        for f, way in zip(filters, (motion, other), strict=True):
            z = pixels(way, t, draw, sigma=0.02)  # Almost no noise: what is left is the lag.
            f.update(t, corners(z), sight(z, way(t)))
        if t > 1.0:
            tool, target = (f.at(t + FRAME) for f in filters)
            assert tool is not None and target is not None
            own.append(apart(motion(t + FRAME), tool.T_left_marker)[:3])
            gaps.append(target.T_left_marker[:3, 3] - tool.T_left_marker[:3, 3] - shift)
    assert rms(np.array(gaps)) < 0.5 * rms(np.array(own))
