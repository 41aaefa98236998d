"""Laws of the step policies, on linear systems with known answers and on the thesis' simulated scene."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from vita.experiments.arms import ARMS
from vita.experiments.cameras import READINGS, Cameras, facing
from vita.experiments.trial import Method, World, run
from vita.servo.estimators import Estimate, first_estimate
from vita.servo.policies import POLICIES, Adaptive, Damped, Fixed, Situation, StepPolicy, TrustRegion
from vita.types import Array

Mask = NDArray[np.bool_]
DELTA = np.radians(4.0)
KINDS = sorted(POLICIES)
every_policy = pytest.mark.parametrize("kind", KINDS)


def jacobian_of(seed: int, *shape: int) -> Array:
    """(..., m, n) well-conditioned Jacobians of a usual size [px/rad]."""
    u, _, vt = np.linalg.svd(np.random.default_rng(seed).standard_normal(shape), full_matrices=False)
    return u @ (np.linspace(900.0, 300.0, min(shape[-2:]))[:, None] * vt)


def estimate_of(jacobian: Array, sigma: float = 0.1) -> Estimate:
    return first_estimate(jacobian, DELTA, sigma)


def situation(
    jacobian: Array,
    e: Array,
    *,
    gain: float = 0.3,
    damping: float = 0.0,
    q: Array | None = None,
    free: Mask | None = None,
) -> Situation:
    q = np.zeros((*e.shape[:-1], jacobian.shape[-1])) if q is None else q
    free = np.ones(q.shape, bool) if free is None else free
    return Situation(q, e, estimate_of(jacobian), free, gain, damping)


def servo(
    policy: StepPolicy, jacobian: Array, goal: Array, steps: int, gain: float = 0.3
) -> tuple[Array, Array]:
    """Joints (steps + 1, ..., n) and errors (steps, ..., m) of the linear system e = J (q - goal)."""
    q = np.zeros(goal.shape)
    joints, errors, known = [q], [], estimate_of(jacobian)
    for _ in range(steps):
        e = (jacobian @ (q - goal)[..., None])[..., 0]
        q = q + policy.step(Situation(q, e, known, np.ones(q.shape, bool), gain, 0.0)).dq
        joints.append(q)
        errors.append(e)
    return np.array(joints), np.array(errors)


# ---- what holds for all ------------------------------------------------------------------------


@every_policy
def test_a_policy_says_what_it_is_in_words(kind: str) -> None:
    policy = POLICIES[kind]
    assert policy.kind == kind and policy.title and policy.doc.endswith(".")


@every_policy
def test_without_an_error_there_is_no_step(kind: str) -> None:
    e = np.array([3.0, -2.0, 1.0, 2.5, -1.5, 0.5]) * 1e-9
    proposal = POLICIES[kind]().step(situation(jacobian_of(1, 6, 4), e))
    assert np.abs(proposal.dq).max() < 1e-10
    assert proposal.near


@every_policy
def test_joints_that_are_not_free_do_not_move_at_all(kind: str) -> None:
    free = np.array([True, False, True, False, True])
    policy, e = POLICIES[kind](), np.random.default_rng(2).uniform(-80, 80, 6)
    for _ in range(3):
        dq = policy.step(situation(jacobian_of(2, 6, 5), e, free=free)).dq
        assert (dq[~free] == 0.0).all()
        assert np.abs(dq[free]).min() > 1e-5


@every_policy
def test_joints_left_out_are_as_if_the_arm_had_none(kind: str) -> None:
    jacobian, e = jacobian_of(3, 6, 5), np.random.default_rng(3).uniform(-80, 80, 6)
    free = np.array([True, False, True, True, False])
    # The size of an entry tells curvature its scale, so that it is kept the same for both.
    whole = situation(jacobian, e, free=free)
    small = estimate_of(jacobian[:, free])
    same = Estimate(
        small.jacobian, whole.estimate.covariance[:3, :3], small.sigma, whole.estimate.scale2, small.rank
    )
    part = Situation(np.zeros(3), e, same, np.ones(3, bool), 0.3, 0.0)
    dq = POLICIES[kind]().step(whole).dq[free]
    alone = POLICIES[kind]().step(part).dq
    assert np.abs(dq - alone).max() <= 1e-9 * np.abs(alone).max()


@every_policy
def test_three_runs_at_once_are_three_runs_alone(kind: str) -> None:
    jacobian, random = jacobian_of(4, 3, 6, 4), np.random.default_rng(4)
    goal = random.uniform(-0.4, 0.4, (3, 4))
    wrong = jacobian * random.uniform(0.6, 1.4, jacobian.shape)

    def steps(index: slice | int) -> Array:
        policy, q, out = POLICIES[kind](), np.zeros(goal[index].shape), []
        known = estimate_of(wrong[index])
        for _ in range(12):
            e = (jacobian[index] @ (q - goal[index])[..., None])[..., 0]
            q = q + policy.step(Situation(q, e, known, np.ones(q.shape, bool), 0.5, 0.01)).dq
            out.append(q)
        return np.array(out)

    together = steps(slice(None))
    for i in range(3):
        assert np.abs(together[:, i] - steps(i)).max() < 1e-9


@every_policy
def test_a_linear_system_with_a_known_jacobian_converges(kind: str) -> None:
    jacobian = jacobian_of(5, 10, 8, 6)
    goal = np.random.default_rng(5).uniform(-0.4, 0.4, (10, 6))
    _, errors = servo(POLICIES[kind](), jacobian, goal, 60)
    size = np.linalg.norm(errors, axis=-1)
    assert (size[-1] < 1e-3 * size[0]).all()
    assert (np.diff(size, axis=0) < 1e-9).all()  # and nearer with every step


@every_policy
def test_after_a_restart_a_policy_is_as_new(kind: str) -> None:
    jacobian, goal = jacobian_of(6, 6, 4), np.array([0.3, -0.2, 0.1, 0.4])
    policy = POLICIES[kind]()
    first, _ = servo(policy, jacobian, goal, 8)
    policy.restart()
    again, _ = servo(policy, jacobian, goal, 8)
    assert np.abs(first - again).max() < 1e-12


# ---- fixed: thesis eq. 2.15 --------------------------------------------------------------------


def test_fixed_is_the_pseudo_inverse_of_the_thesis() -> None:
    jacobian, e = jacobian_of(7, 5, 8, 6), np.random.default_rng(7).uniform(-50, 50, (5, 8))
    dq = Fixed().step(situation(jacobian, e, gain=0.4)).dq
    assert np.allclose(dq, -0.4 * (np.linalg.pinv(jacobian) @ e[..., None])[..., 0], rtol=1e-10, atol=0)


def test_fixed_inverts_at_most_six_directions() -> None:
    rigid = jacobian_of(8, 12, 7)
    u, s, vt = np.linalg.svd(rigid, full_matrices=False)
    s[6] = 0.5  # what noise leaves of a seventh direction
    e = np.random.default_rng(8).uniform(-50, 50, 12)
    proposal = Fixed().step(situation((u * s) @ vt, e, gain=1.0))
    six = -(vt[:6].T / s[:6]) @ (u[:, :6].T @ e)
    assert np.allclose(proposal.dq, six, rtol=1e-10, atol=1e-12)
    assert proposal.rank == 6


def test_damping_of_the_fixed_law_is_levenbergs() -> None:
    jacobian, e = jacobian_of(9, 8, 5), np.random.default_rng(9).uniform(-50, 50, 8)
    proposal = Fixed().step(situation(jacobian, e, gain=1.0, damping=0.5))
    mu2 = (0.5 * np.linalg.norm(jacobian, 2)) ** 2
    expected = -np.linalg.solve(jacobian.T @ jacobian + mu2 * np.eye(5), jacobian.T @ e)
    assert np.allclose(proposal.dq, expected, rtol=1e-10, atol=0)
    s = np.linalg.svd(jacobian, compute_uv=False)
    assert proposal.rank == np.count_nonzero(s > 0.5 * s[0]) < 5


# ---- adaptive ----------------------------------------------------------------------------------


def gain_at(size_px: float, gain: float) -> float:
    """The share of the error that the adaptive law's step removes."""
    e = np.array([1.0, -0.5, 0.25]) * size_px
    return -float((Adaptive().step(situation(np.eye(3) * 500.0, e, gain=gain)).dq * 500.0 / e)[0])


@pytest.mark.parametrize(("gain", "near"), [(0.2, 0.4), (0.5, 1.0), (0.8, 1.0), (1.0, 1.0), (1.5, 1.5)])
def test_adaptive_gain_doubles_at_the_goal_and_never_overshoots_by_itself(gain: float, near: float) -> None:
    assert gain_at(1e-6, gain) == pytest.approx(near, rel=1e-6)
    assert gain_at(1000.0, gain) == pytest.approx(gain, rel=1e-6)


def test_adaptive_gain_grows_smoothly_on_the_way() -> None:
    gains = np.array([gain_at(x, 0.3) for x in np.linspace(60.0, 0.01, 400)])
    change = np.diff(gains)
    assert (change > 0.0).all() and change.max() < 0.006


# ---- damped least squares ----------------------------------------------------------------------


def test_damped_steps_are_shorter_than_undamped_ones_the_more_so_the_farther() -> None:
    jacobian, direction = jacobian_of(10, 8, 6), np.random.default_rng(10).standard_normal(8)
    shares = []
    for size in (0.01, 1.0, 10.0, 100.0, 1000.0):
        now = situation(jacobian, size * direction)
        shares.append(np.linalg.norm(Damped().step(now).dq) / np.linalg.norm(Fixed().step(now).dq))
    assert (np.diff(shares) < 0.0).all()
    assert shares[0] == pytest.approx(1.0, abs=1e-3)
    assert shares[-1] < 0.8


def test_damped_convergence_is_that_of_the_fixed_law_in_the_end() -> None:
    jacobian, goal = jacobian_of(11, 8, 6), np.full(6, 0.2)
    _, errors = servo(Damped(), jacobian, goal, 60, gain=0.3)
    size = np.linalg.norm(errors, axis=-1)
    assert size[1] / size[0] > 0.72
    assert size[-1] / size[-2] == pytest.approx(0.7, abs=0.001)


def test_near_a_singular_pose_the_damped_step_stays_moderate() -> None:
    u, s, vt = np.linalg.svd(jacobian_of(12, 6, 4), full_matrices=False)
    s[-1] = 5.0
    e = 60.0 * u[:, -1] + 60.0 * u[:, 0]  # asks for twelve radians along the weak direction
    now = situation((u * s) @ vt, e, gain=1.0)
    assert np.linalg.norm(Fixed().step(now).dq) > 10.0
    assert np.linalg.norm(Damped().step(now).dq) < 0.2


# ---- trust region ------------------------------------------------------------------------------


def test_a_trust_region_step_is_the_best_one_of_its_length() -> None:
    jacobian, random = jacobian_of(13, 8, 5), np.random.default_rng(13)
    e = random.uniform(-400, 400, 8)
    dq = TrustRegion().step(situation(jacobian, e, gain=0.5)).dq
    radius = np.linalg.norm(dq)
    full = 0.5 * np.linalg.pinv(jacobian) @ e
    assert radius < 0.5 * np.linalg.norm(full)  # the bound is active
    others = random.standard_normal((20_000, 5))
    others *= radius / np.linalg.norm(others, axis=1, keepdims=True)
    left = np.linalg.norm(0.5 * e + others @ jacobian.T, axis=1)
    ours = np.linalg.norm(0.5 * e + jacobian @ dq)
    assert ours <= left.min()
    assert left.min() - ours < 0.05 * ours  # and the samples come near it


def test_inside_the_trust_region_the_step_is_the_thesis_law() -> None:
    jacobian, e = jacobian_of(14, 8, 5), np.random.default_rng(14).uniform(-5, 5, 8)
    now = situation(jacobian, e, gain=0.5)
    assert np.allclose(TrustRegion().step(now).dq, Fixed().step(now).dq, rtol=1e-9, atol=0)


@pytest.mark.parametrize(("share", "change"), [(1.0, "more"), (0.5, "same"), (-0.5, "less"), (0.05, "less")])
def test_the_trust_radius_follows_actual_over_predicted_progress(share: float, change: str) -> None:
    """The system answers with `share` of the motion that the Jacobian promises."""
    jacobian, e = np.eye(4) * 600.0, np.array([300.0, -200.0, 250.0, 100.0])
    policy = TrustRegion()
    dq = policy.step(situation(jacobian, e)).dq
    before = float(np.linalg.norm(dq))
    after = e + share * jacobian @ dq
    now = situation(jacobian, after * 1.0, q=dq)
    size = float(np.linalg.norm(policy.step(now).dq))
    if change == "more":
        assert size > 1.2 * before
    elif change == "same":
        assert size == pytest.approx(before, rel=1e-6)
    else:
        assert size < 0.6 * before


def test_changes_inside_the_noise_change_no_trust() -> None:
    jacobian, policy, e = np.eye(4) * 600.0, TrustRegion(), np.full(4, 300.0)
    before = policy.step(situation(jacobian, e)).dq
    # Three sigma worse after a motion that should have helped by half a sigma.
    after = policy.step(situation(jacobian, e + np.array([0.2, 0.1, 0.2, 0.0]), q=np.full(4, -1e-4))).dq
    assert np.linalg.norm(after) == pytest.approx(float(np.linalg.norm(before)), rel=1e-6)


# ---- on simulated arms -------------------------------------------------------------------------


def thesis_scene(placements: int) -> World:
    """The camera-rotation experiment (thesis 5.2.1), the cameras at `placements` places of a circle."""
    arm, q0 = ARMS["puma560"], np.array([1.5708, 0.7854, 3.1416, 0.0, 0.7854, 0.0])
    goal = q0 + np.radians([0.33, 7.18, 23.24, -14.74, 40.27, -0.38])
    angle = np.linspace(0.0, 2 * np.pi, placements, endpoint=False)
    forward = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    side = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], -1)
    eyes = arm.pose(goal)[:3, 3] - forward[:, None] + np.array([[[-0.15]], [[0.15]]])[:, 0] * side[:, None]
    cameras = Cameras(facing(eyes, forward[:, None, :]), 1200.0)
    points = np.array([[0.0, 0.0, 0.1], [0.0, -0.1, -0.1], [0.0, 0.1, -0.1]])
    starts, goals = np.tile(q0, (placements, 1)), np.tile(goal, (placements, 1))
    return World(arm, cameras, points, starts, goals, READINGS["gaussian"])


@pytest.mark.parametrize(("kind", "gain"), [("damped", 1.0), ("trust_region", 1.0), ("trust_region", 0.25)])
def test_cautious_policies_do_not_diverge_where_the_fixed_law_does(kind: str, gain: float) -> None:
    world = thesis_scene(45)

    def runs(policy: str, gain: float):  # noqa: ANN202
        return run(world, Method(policy, policy=policy), gain=gain, delta=np.radians(6), steps=50, seed=1)

    assert runs("fixed", 1.0).diverged.sum() >= 5
    cautious = runs(kind, gain)
    assert cautious.diverged.sum() == 0
    assert np.isfinite(cautious.steps_to(10.0)).all()
    assert np.mean(cautious.steps_to(10.0)) < 11.0


def rest_in_dead_band(policy: Callable[[], StepPolicy], gain: float, tolerance: float) -> Array:
    """(runs,) largest joint error [rad] at which an arm comes to rest that stops as soon as it is within
    `tolerance` of where it is told to go."""
    random, runs = np.random.default_rng(15), 60
    jacobian = jacobian_of(15, runs, 8, 4)
    goal, q, law = random.uniform(-0.3, 0.3, (runs, 4)), np.zeros((runs, 4)), policy()
    known = estimate_of(jacobian, 1e-3)
    for _ in range(120):
        e = (jacobian @ (q - goal)[..., None])[..., 0]
        dq = law.step(Situation(q, e, known, np.ones(q.shape, bool), gain, 0.0)).dq
        q = q + np.sign(dq) * np.maximum(np.abs(dq) - tolerance, 0.0)
    return np.abs(q - goal).max(-1)


def test_in_a_dead_band_the_plain_law_rests_at_tolerance_over_lambda() -> None:
    """Thesis 5.1.3."""
    tolerance = np.radians(0.05)
    quarter, full = (rest_in_dead_band(Fixed, gain, tolerance) for gain in (0.25, 1.0))
    assert np.mean(quarter) / np.mean(full) == pytest.approx(4.0, rel=0.25)
    assert np.mean(full) == pytest.approx(tolerance, rel=0.25)


def test_the_adaptive_gain_halves_what_a_dead_band_leaves() -> None:
    """Thesis 5.2.3: some steps with a doubled lambda gained 0.1 to 0.2 mm."""
    tolerance = np.radians(0.02)
    fixed, adaptive = (rest_in_dead_band(policy, 0.25, tolerance) for policy in (Fixed, Adaptive))
    assert 0.5 * np.mean(fixed) <= np.mean(adaptive) < 0.65 * np.mean(fixed)
