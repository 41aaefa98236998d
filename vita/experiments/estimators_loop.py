"""Servo runs with joint limits as the product keeps them, and all that an observer sees of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vita.experiments.analytic import Ibvs, Pbvs
from vita.experiments.estimators_exact import exact_jacobian
from vita.experiments.starts import visible
from vita.experiments.trial import JUMP_PX, Method, World
from vita.servo.estimators import Estimate, Samples, estimator_of, first_estimate
from vita.servo.estimators.base import held
from vita.servo.policies import Situation, policy_of
from vita.types import Array

AT_LIMIT_RAD = np.radians(0.1)
"""Nearer to a limit than this a joint is at it."""
DONE_PX = 1.0
"""Converged: the largest true error component is below this at the end ..."""
LAST = 10
"""... in the median of so many last steps, so that one wild reading just then decides nothing."""
KNOWN = 1e-3
"""How well a Jacobian is known that is not learned, as a share of its size."""

Source = Ibvs | Pbvs | Literal["learned"]
"""Where the Jacobian, or the step, comes from."""


@dataclass(frozen=True, eq=False)
class Course:
    """What happened, one entry for each run; everything is judged on true values."""

    summed: Array
    """(runs, steps + 1) sum of absolute image errors [px]."""
    largest: Array
    """(runs, steps + 1) largest absolute component of the image error [px]."""
    distance: Array
    """(runs, steps + 1) 3D error, summed over the points' coordinates [m]."""
    off: Array
    """(runs, steps) |J - J_true|_F / |J_true|_F when each step was chosen; NaN where not compared."""
    outside: Array
    """(runs,) how far a joint ever was beyond its limit [rad]; negative if it kept away from it."""
    out_of_view: NDArray[np.bool_]
    """(runs,) whether a point ever was outside an image. The simulated trackers go on."""
    blocked: NDArray[np.int_]
    """(runs,) steps that ended with a joint at its limit."""
    rank: NDArray[np.int_]
    """(runs,) directions of motion in use in the last step."""
    q: Array
    """(runs, n) where it ended [rad]."""

    @property
    def converged(self) -> NDArray[np.bool_]:
        return np.median(self.largest[:, -LAST:], axis=-1) < DONE_PX

    @property
    def growth(self) -> Array:
        """(runs,) greatest growth of the summed error in one step [px]."""
        grown = np.diff(self.summed, axis=-1).max(-1)
        return np.where(np.isfinite(self.summed).all(-1), grown, np.inf)

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """(runs,) by the thesis' rule: +100 px in one step."""
        return self.growth > JUMP_PX

    def steps_to(self, bound_px: float) -> Array:
        """(runs,) first step at which every component is below `bound_px`; NaN for never."""
        below = self.largest < bound_px
        return np.where(below.any(-1), below.argmax(-1), np.nan)


def servo(
    world: World,
    method: Method,
    *,
    gain: float,
    delta: float,
    steps: int,
    seed: int,
    compare_every: int = 0,
    source: Source = "learned",
    each: Callable[[int, Array, Estimate, Array], None] | None = None,
) -> Course:
    """Explore by `delta` [rad], then servo for `steps` steps with lambda = `gain`.

    compare_every: compare the Jacobian with the true one in every so many steps; 0 never does.
    source: "learned"; or a calibrated servo, whose Jacobian is then used at each step in place of the
        learned one (`Ibvs`) or which chooses the steps itself (`Pbvs`).
    each: called with the step's number, the joints, the estimate and the step.
    """
    random = np.random.default_rng(seed)
    limits, q = world.arm.limits, world.q0.copy()
    low, high = limits[:, 0] + AT_LIMIT_RAD, limits[:, 1] - AT_LIMIT_RAD
    ends = (low, high) if world.limited else (-np.inf, np.inf)
    goal, wanted = world.arm.points(world.goal, world.local), world.features(world.goal)
    jacobian, samples = explored(world, delta, random)
    start = first_estimate(jacobian, delta, method.sigma_px)
    estimator = estimator_of(method.estimator)(start, samples, method.tuning)
    policy, free = policy_of(method.policy)(), np.ones(q.shape, bool)
    errors, distance, off = [], [], np.full((len(q), steps), np.nan)
    outside, unseen = np.full(len(q), -np.inf), np.zeros(len(q), bool)
    blocked, rank = np.zeros(len(q), int), start.rank
    for number in range(steps + 1):
        points = world.arm.points(q, world.local)
        pixels = world.cameras.project(points).reshape(wanted.shape)
        errors.append(pixels - wanted)
        distance.append(np.abs(points - goal).sum((-1, -2)))
        unseen |= ~visible(world.cameras, points).all((-2, -1))
        outside = np.maximum(outside, np.maximum(limits[:, 0] - q, q - limits[:, 1]).max(-1))
        if number == steps:
            break
        e = world.reading.of(pixels, random) - world.reading.of(wanted, random)
        if isinstance(source, Ibvs):
            estimate = _known(start, source.jacobian(q, e + wanted, world))
        else:
            estimator.observe(q, e)
            e = estimator.believed(e)
            estimate = estimator.estimate
        if isinstance(source, Pbvs):
            dq = source(q, e, world)
            # It knows nothing of limits: joints at theirs stay there, and the others go on.
            dq = np.where(((q <= ends[0]) & (dq < 0)) | ((q >= ends[1]) & (dq > 0)), 0.0, dq)
        else:
            proposal = policy.step(Situation(q, e, estimate, free, gain, method.damping, *ends))
            dq, rank = proposal.dq, proposal.rank
            if compare_every and number % compare_every == 0:
                off[:, number] = _relative(estimate.jacobian, exact_jacobian(world, q))
        if each is not None:
            each(number, q, estimate, dq)
        q = inside(q, dq, limits) if world.limited else q + dq
        blocked += ((q <= low) | (q >= high)).any(-1)
    error = np.abs(np.stack(errors, axis=-2))
    moved = np.stack(distance, -1)
    return Course(error.sum(-1), error.max(-1), moved, off, outside, unseen, blocked, rank, q)


def explored(world: World, delta: float, random: np.random.Generator) -> tuple[Array, Samples]:
    """(runs, m, n) Jacobian by forward differences of `delta` [rad] (thesis eq. 2.17), and the readings
    that it was made of, the start first."""
    n = world.arm.n
    places = [world.q0, *(world.q0 + delta * np.eye(n)[i] for i in range(n))]
    readings = [world.measure(q, random) for q in places]
    columns = [(reading - readings[0]) / delta for reading in readings[1:]]
    return np.stack(columns, axis=-1), Samples(np.stack(places, axis=-2), np.stack(readings, axis=-2))


def _known(estimate: Estimate, exact: Array) -> Estimate:
    """`estimate` with a Jacobian that needs no learning."""
    variance = KNOWN**2 * np.mean(exact**2, axis=(-2, -1))
    covariance = variance[..., None, None] * np.eye(exact.shape[-1])
    return replace(estimate, jacobian=exact, covariance=covariance, rank=held(exact, covariance))


def _relative(jacobian: Array, exact: Array) -> Array:
    return np.linalg.norm(jacobian - exact, axis=(-2, -1)) / np.linalg.norm(exact, axis=(-2, -1))


def inside(q: Array, dq: Array, limits: Array) -> Array:
    """Where the step `dq` (..., n) leads, scaled as a whole so that no joint passes its limit [rad].

    Joints that are at their limit and pushed outward are none of its business: the policy leaves them
    out, or else scaling would stop the arm there for good.
    """
    room = np.maximum(np.where(dq > 0, limits[:, 1] - q, q - limits[:, 0]), 0.0)
    share = np.min(np.where(dq != 0.0, room / np.maximum(np.abs(dq), 1e-300), 1.0), axis=-1)
    scaled = np.minimum(share, 1.0)[..., None] * dq
    # The product's rounding must not end beyond the limit either.
    return np.clip(q + scaled, limits[:, 0], limits[:, 1])
