"""A goal that moves by itself: how fast, and how the arm goes along with it.

The error changes for two reasons, the joints' motion and the goal's own,

    de = J dq + d dt,

with the drift d = de/dt at rest [px/s]. Without d the arm trails behind the goal, and an estimator
takes the goal's motion for the arm's: once the arm goes along with the goal, the error stands still
whatever the joints do, and J is learned to be zero. With the drift the control law is
dq = -J+ (lambda e + d dt), see Piepmeier, McMurray, Lipkin, "Uncalibrated dynamic visual servoing",
IEEE Transactions on Robotics and Automation 20(1), 2004.

What the joints do not explain may be either, an error of J or the goal's motion, and an arm that
follows its goal well sees nothing that would tell them apart. Learning them one after the other, each
from what the other leaves, lets both wander off together (the arm was thrown 474 px off in a trial).
Both are therefore one state: for each row its error x, its drift d and its row j of J, in a Kalman
filter whose covariance (shared by the rows) knows what belongs together,

    x' = x + j . dq + d dt,   measured: e = x' + noise,

with white acceleration of the goal, and with J wandering as the arm moves, as in `estimators.kalman`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vita.servo.estimators.base import CURVATURE, RIGID_RANK, Estimate, held
from vita.types import Array

MANOEUVRE = 300.0
"""Density of the goal's white acceleration, in noise variances [1/s^3]: it may change its speed by 17
sigma/s within a second."""
FIRST_SPEED = 100.0
"""Deviation of the drift before anything is known, in noise deviations [1/s]."""
WILD_SIGMAS = 5.0
"""A measurement farther from the expected one is taken for a wild one, the second in a row for a jump
of the goal."""
BELIEF = 3.0
"""Drift counts as far as it is larger than so many of its deviations."""
DAMPING = 0.03
"""Damping by the Jacobian's covariance when drift is turned into joint motion, as in the policy."""
LONGEST_S = 0.5
"""After a longer pause between measurements everything but J is forgotten [s]."""
_X, _D, _J = 0, 1, slice(2, None)
"""Places of error, drift and Jacobian in the covariance."""


class GoalMotion:
    """Learns the drift of the error rows and the Jacobian from measurements; arrays may have leading
    axes `...`.

    In each control period: `update` with the measurement, instead of the estimator, whose place
    `estimate` takes; give the policy the joints q - `followed`, in which the goal stands still, and add
    `speed` times the period to its step.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything (a new run, other rows, a moved camera)."""
        self._stamp: float | None = None
        self._estimate: Estimate | None = None
        self._believed = self._speed = self._followed = np.zeros(0)

    # ---- what is known -------------------------------------------------------------------------

    @property
    def known(self) -> bool:
        """Whether there has been a measurement since the last reset."""
        return self._estimate is not None

    @property
    def estimate(self) -> Estimate:
        """The Jacobian, learned along with the drift. Only when `known`."""
        assert self._estimate is not None, "update first"
        return self._estimate

    @property
    def drift(self) -> Array:
        """(..., m) de/dt that the joints do not explain, as far as it stands out of the noise [px/s]."""
        return self._believed

    @property
    def deviation(self) -> Array:
        """(...,) standard deviation of a row's drift, the Jacobian's uncertainty included [px/s]."""
        return np.sqrt(self._cov[..., _D, _D]) if self.known else np.zeros(())

    @property
    def speed(self) -> Array:
        """(..., n) joint speed that goes along with the goal [rad/s]."""
        return self._speed

    @property
    def followed(self) -> Array:
        """(..., n) how far the goal has moved since the reset, in joint space [rad]: in q - followed it
        stands still."""
        return self._followed

    # ---- learning ------------------------------------------------------------------------------

    def update(self, stamp: float, q: Array, e: Array, start: Estimate) -> None:
        """Take the joints `q` (..., n) [rad] and errors `e` (..., m) [px], NaN in rows that are not seen,
        measured at time `stamp` [s]. `start` is the estimate to go out from at the first measurement
        after a reset, and what later ones know of noise, curvature and rank."""
        if self._estimate is None or self._estimate.jacobian.shape != start.jacobian.shape:
            self._begin(stamp, q, e, start, fresh=True)
        elif self._stamp is None or not 0.0 < stamp - self._stamp < LONGEST_S:
            self._begin(stamp, q, e, self._estimate, fresh=False)
        else:
            dt = stamp - self._stamp
            moved = q - self._q
            expected = self._predict(dt, moved)
            self._correct(dt, e, expected)
            self._stamp, self._q = stamp, q.copy()
            self._follow(dt, moved)

    def _begin(self, stamp: float, q: Array, e: Array, estimate: Estimate, *, fresh: bool) -> None:
        runs, n, sigma2 = q.shape[:-1], q.shape[-1], estimate.sigma**2
        self._estimate, self._stamp, self._q = estimate, stamp, q.copy()
        self._x, self._d = e.copy(), np.zeros(e.shape)
        self._cov = np.zeros((*runs, n + 2, n + 2))
        self._cov[..., _X, _X], self._cov[..., _D, _D] = sigma2, FIRST_SPEED**2 * sigma2
        self._cov[..., _J, _J] = estimate.covariance
        self._wild: NDArray[np.bool_] = np.zeros(e.shape, bool)
        self._before = e.copy()
        self._believed, self._speed = np.zeros(e.shape), np.zeros(q.shape)
        if fresh:
            self._followed = np.zeros(q.shape)

    def _predict(self, dt: float, moved: Array) -> Array:
        """Where the rows should be by now, moved by the arm and carried by the drift; returns (..., m)
        the arm's part [px]."""
        estimate = self.estimate
        expected = np.matvec(estimate.jacobian, moved)
        self._x = self._x + expected + self._d * dt
        # F P F' for F = identity but for its first row, (1, dt, moved).
        one = np.ones((*moved.shape[:-1], 1))
        row = np.concatenate([one, dt * one, moved], axis=-1)
        carried = np.vecmat(row, self._cov)
        cov = self._cov.copy()
        cov[..., _X, :] = cov[..., :, _X] = carried
        cov[..., _X, _X] = np.vecdot(carried, row)
        density, length2 = MANOEUVRE * estimate.sigma**2, np.vecdot(moved, moved)
        bend2 = CURVATURE**2 * estimate.scale2
        cov[..., _X, _X] += density * dt**3 / 3 + 0.25 * bend2 * length2**2
        cov[..., _X, _D] += density * dt**2 / 2
        cov[..., _D, _X] += density * dt**2 / 2
        cov[..., _D, _D] += density * dt
        cov[..., _J, _J] += (bend2 * length2)[..., None, None] * np.eye(moved.shape[-1])
        self._cov = cov
        return expected

    def _correct(self, dt: float, e: Array, expected: Array) -> None:
        """Weigh the measurement against the prediction."""
        estimate, sigma2 = self.estimate, self.estimate.sigma**2
        expected2 = self._cov[..., _X, _X] + sigma2
        gain = self._cov[..., _X, :] / expected2[..., None]
        surprise = e - self._x
        wild = surprise**2 > WILD_SIGMAS**2 * expected2[..., None]  # False where something is NaN
        jump = wild & self._wild & np.isfinite(self._before)
        fresh = np.isfinite(e) & np.isnan(self._x)
        take = np.isfinite(surprise) & ~wild
        believed = np.where(take, surprise, 0.0)
        self._x = self._x + gain[..., None, _X] * believed
        self._d = self._d + gain[..., None, _D] * believed
        jacobian = estimate.jacobian + believed[..., None] * gain[..., None, _J]
        learns = np.any(take, axis=-1, keepdims=True)[..., None]
        cov = self._cov - np.where(learns, gain[..., :, None] * self._cov[..., None, _X, :], 0.0)
        # The goal has jumped, or set off at once: the two last measurements say where it is, how fast.
        self._d = np.where(jump, (e - self._before - expected) / dt, self._d)
        self._x = np.where(jump | fresh, e, self._x)
        anew = np.any(jump, axis=-1, keepdims=True)[..., None]
        if np.any(anew):
            clean = cov.copy()
            clean[..., : _J.start, :] = clean[..., :, : _J.start] = 0.0
            clean[..., _X, _X], clean[..., _D, _D] = sigma2, 2 * sigma2 / dt**2
            clean[..., _X, _D] = clean[..., _D, _X] = sigma2 / dt
            cov = np.where(anew, clean, cov)
        self._cov = 0.5 * (cov + cov.mT)  # Rounding would make it lopsided in the long run.
        covariance = self._cov[..., _J, _J].copy()
        rank = estimate.rank
        if np.any(rank < min(*jacobian.shape[-2:], RIGID_RANK)):
            rank = np.maximum(rank, held(jacobian, covariance))
        self._estimate = replace(estimate, jacobian=jacobian, covariance=covariance, rank=rank)
        self._wild, self._before = wild & ~jump, e.copy()

    def _follow(self, dt: float, moved: Array) -> None:
        """Turn the drift that can be believed into joint motion, and add up what it did."""
        estimate = self.estimate
        # Of an arm that goes along, the sum of drift and own motion is known better than either.
        row = np.concatenate([np.ones((*moved.shape[:-1], 1)), moved / dt], axis=-1)
        along2 = np.vecdot(np.vecmat(row, self._cov[..., _D:, _D:]), row)
        noise2 = BELIEF**2 * np.minimum(self._cov[..., _D, _D], along2)[..., None]
        size2 = np.mean(self._d**2, axis=-1, keepdims=True)
        self._believed = self._d * np.maximum(1.0 - noise2 / np.maximum(size2, 1e-300), 0.0)
        rows = estimate.jacobian.shape[-2]
        normal = estimate.jacobian.mT @ estimate.jacobian + DAMPING * rows * estimate.covariance
        slope = np.vecmat(self._believed, estimate.jacobian)
        self._speed = -np.linalg.solve(normal, slope[..., None])[..., 0]
        self._followed = self._followed + self._speed * dt
