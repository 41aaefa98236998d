"""Estimator and step policy at work: from each measurement to the next joint step.

`Controller` decides whether the arm may move; this decides where to. It holds the pieces that people
may exchange while the arm moves, and carries what is known over from one to the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vita.servo.config import ServoConfig
from vita.servo.estimators import Estimate, JacobianEstimator, Samples, Tuning, estimator_of
from vita.servo.goal_motion import GoalMotion
from vita.servo.insight import Insight, insight
from vita.servo.policies import Proposal, Situation, StepPolicy, policy_of
from vita.servo.priority import prioritised
from vita.servo.secondary import secondary_step
from vita.types import Array, ErrorVector, Joint

AT_LIMIT_RAD = np.radians(0.1)
"""Nearer to its limit than this a joint is at it [rad]."""
REMEMBERED = 200
"""So many measurements are kept for an estimator that is chosen later."""
LONGEST_PERIOD_S = 0.2
"""A goal's motion is not predicted farther ahead [s]."""


@dataclass(frozen=True)
class Step:
    """What to do in the next period."""

    dq: Array
    """(n,) [rad]."""
    proposal: Proposal


class Steering:
    """Learns from measurements and chooses steps, by the settings in force.

    `used` are the indices of the joints that the servo may move.
    """

    def __init__(
        self, start: Estimate, samples: Samples, joints: Sequence[Joint], used: Sequence[int],
        config: ServoConfig,
    ) -> None:
        self.joints, self.config = tuple(joints), config
        self._used = tuple(used)
        self._q, self._e = list(samples.q), list(samples.e)
        self._estimator: JacobianEstimator = self._new_estimator(start)
        self._policy: StepPolicy = policy_of(config.policy)()
        self._motion = GoalMotion()
        self._rows: tuple[bool, ...] = ()
        self._stamp: float | None = None
        self._dt = 0.0
        self._believed = self._e[-1]
        self._posture = self._q[0]
        self._last: tuple[Array, Array] | None = None
        self._learned_from: tuple[Array, Array] | None = None
        self._insight: tuple[ErrorVector, Step] | None = None
        self._weighted: tuple[Estimate, bytes, Estimate] | None = None
        """What `weighted` made last, and of what: while nothing is learned the policy may rely on it."""

    @property
    def estimate(self) -> Estimate:
        """While a goal that moves is followed, its motion and the Jacobian are learned together."""
        return self._motion.estimate if self._follows else self._estimator.estimate

    def restart(self) -> None:
        """A new run begins with the Jacobian that is known."""
        self._estimator.restart()
        self._policy.restart()
        self._motion.reset()
        self._stamp = self._last = None

    def configure(self, config: ServoConfig) -> None:
        """Put settings in force; another estimator starts from what the old one knew."""
        if config.policy != self._policy.kind:
            self._policy = policy_of(config.policy)()
        changed = config.estimator != self._estimator.kind
        stands_still = self._follows and config.moving_goal == 0.0
        known, self.config = self.estimate, config
        if changed or stands_still:
            self._estimator = self._new_estimator(known)
        if stands_still:
            self._motion.reset()
        self._estimator.tuning = _tuning(config)

    def mistake(self, change: Callable[[Array], Array]) -> None:
        """Believe `change` of the Jacobian (m, n) from now on; a fault to be tried."""
        known = self.estimate
        self._estimator = self._new_estimator(replace(known, jacobian=change(known.jacobian)))
        self._motion.reset()
        self._weighted = None

    def _new_estimator(self, start: Estimate) -> JacobianEstimator:
        history = Samples(np.array(self._q), np.array(self._e))
        return estimator_of(self.config.estimator)(start, history, _tuning(self.config))

    # ---- one period ----------------------------------------------------------------------------

    def hear(self, stamp: float, q: Array, error: ErrorVector) -> None:
        """Learn from the joints `q` (n,) [rad] and the error measured at `stamp` [s]."""
        e = self._believed = error.values
        self._dt = min(stamp - self._stamp, LONGEST_PERIOD_S) if self._stamp is not None else 0.0
        self._stamp = stamp
        before = self.estimate
        if self.config.moving_goal > 0.0:
            self._motion.update(stamp, q, e, before)
        else:
            self._estimator.observe(q, e)
            self._believed = self._estimator.believed(e)
        learned = self.estimate is not before
        if learned and self._last is not None:
            q0, e0 = self._last
            self._learned_from = before.jacobian @ (q - q0), e - e0
            self._last = q, e
        elif self._last is None:
            self._last = q, e
        self._q = [*self._q[1 - REMEMBERED :], q]
        self._e = [*self._e[1 - REMEMBERED :], e]

    def step(self, q: Array, error: ErrorVector, gain: float) -> Step:
        """The step from `q`, on the rows that are seen and with weight. It is zero in joints not in use."""
        rows = _rows(error)
        if tuple(rows) != self._rows:
            self._policy.restart()  # Other rows are another error: what was added up does not fit.
            self._rows = tuple(rows)
        followed = self._motion.followed if self._follows else np.zeros_like(q)
        lower, upper = self.limits
        now = Situation(
            q - followed, error.weights[rows] * self._believed[rows], self.weighted(error), self.mask, gain,
            self.config.damping, lower - followed, upper - followed,
        )  # fmt: skip
        priorities = np.array([label.priority for label in error.labels])[rows]
        proposal = prioritised(self._policy.step, now, priorities)
        dq = proposal.dq
        if self._follows:
            ahead = self.config.moving_goal * self._dt * self._motion.speed
            dq = dq + np.where(self.mask & ~pushes(q, ahead, lower, upper), ahead, 0.0)
        if self.config.secondary != "none":
            dq = dq + self._secondary(q, now, bool(proposal.near))
        step = Step(dq, proposal)
        self._insight = error, step
        return step

    def blocked(self, q: Array, error: ErrorVector) -> list[int]:
        """The joints that a limit keeps from helping: those that the plain step would push out."""
        estimate, rows = self.weighted(error), _rows(error)
        jacobian = np.where(self.mask, estimate.jacobian, 0.0)
        e = error.weights[rows] * error.values[rows]
        full = -np.linalg.pinv(jacobian, rcond=max(self.config.damping, 1e-3)) @ e
        return [int(j) for j in np.flatnonzero(self.mask & pushes(q, full, *self.limits))]

    def insight(self) -> Insight | None:
        """What is known by now; None before the first step."""
        if self._insight is None or not np.isfinite(self.estimate.jacobian).all():
            return None
        error, step = self._insight
        rows = _rows(error)
        labels = [label for label, seen in zip(error.labels, rows, strict=True) if seen]
        predicted = observed = None
        if self._learned_from is not None and self._learned_from[0].size == rows.size:
            predicted, observed = (error.weights[rows] * change[rows] for change in self._learned_from)
        return insight(
            self.weighted(error), labels, self.joints, self._used, predicted, observed,
            step.dq, bool(step.proposal.near),
        )  # fmt: skip

    # ---- parts ---------------------------------------------------------------------------------

    @property
    def _follows(self) -> bool:
        return self.config.moving_goal > 0.0 and self._motion.known

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(n,) joints in use."""
        mask = np.zeros(len(self.joints), bool)
        mask[list(self._used)] = True
        return mask

    @property
    def limits(self) -> tuple[Array, Array]:
        """(n,) and (n,): where a joint counts as being at its limit [rad]."""
        lower = np.array([j.lower for j in self.joints]) + AT_LIMIT_RAD
        upper = np.array([j.upper for j in self.joints]) - AT_LIMIT_RAD
        return lower, upper

    def weighted(self, error: ErrorVector) -> Estimate:
        """The estimate of the rows that are seen, times their weights. Noise and covariance are those
        of a row of middling weight, as all rows share them."""
        rows, estimate = _rows(error), self.estimate
        key = rows.tobytes() + error.weights.tobytes()
        kept = self._weighted
        if kept is not None and kept[0] is estimate and kept[1] == key:
            return kept[2]
        weights = error.weights[rows]
        middle = float(np.sqrt(np.mean(weights**2))) if weights.size else 1.0
        made = replace(
            estimate,
            jacobian=weights[:, None] * estimate.jacobian[rows],
            covariance=middle**2 * estimate.covariance,
            sigma=middle * estimate.sigma,
            scale2=middle**2 * estimate.scale2,
        )
        self._weighted = estimate, key, made
        return made

    def _secondary(self, q: Array, now: Situation, near: bool) -> Array:
        wanted = self.config.posture_deg
        posture = self._posture if wanted is None else np.radians(wanted)
        estimate = now.estimate
        return secondary_step(
            self.config.secondary, q, *self.limits, posture, estimate.jacobian, estimate.rank,
            estimate.covariance, now.free, now.e, estimate.sigma, bool(near),
        )  # fmt: skip


def pushes(q: Array, dq: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
    """(n,) joints at a limit that `dq` would push beyond it."""
    return ((q >= upper) & (dq > 0)) | ((q <= lower) & (dq < 0))


def _rows(error: ErrorVector) -> NDArray[np.bool_]:
    """(m,) rows that are seen and count."""
    return np.isfinite(error.values) & (error.weights > 0.0)


def _tuning(config: ServoConfig) -> Tuning:
    return Tuning(config.alpha, config.forgetting)
