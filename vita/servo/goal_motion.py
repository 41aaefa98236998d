"""A goal that moves by itself: how fast, and how the arm goes along with it.

The error changes for two reasons, the joints' motion and the goal's own,

    de = J dq + d dt,

with the drift d = de/dt at rest [px/s]. Without d the arm trails behind the goal, and the estimator
takes the goal's motion for the arm's: it learns a wrong Jacobian. The control law with the drift in it
is dq = -J+ (lambda e + d dt), see Piepmeier, McMurray, Lipkin, "Uncalibrated dynamic visual servoing",
IEEE Transactions on Robotics and Automation 20(1), 2004.

What the joints do not explain may also be an error of J. Such an error comes with the arm's motion and
goes with it; the goal's motion lasts. So every row has a small filter for its error and drift (constant
velocity, white acceleration) in which motion of the arm counts as disturbance as far as J is unknown.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vita.servo.estimators.base import Estimate
from vita.types import Array

MANOEUVRE = 300.0
"""Density of the goal's white acceleration, in noise variances [1/s^3]: it may change its speed by 17
sigma/s within a second."""
FIRST_SPEED = 100.0
"""Deviation of the drift before anything is known, in noise deviations [1/s]."""
COHERENT = 10.0
"""An error of J repeats itself from step to step while the arm keeps its direction, and so adds up to
more than independent errors would, by this in variance."""
WILD_SIGMAS = 5.0
"""A measurement farther from the expected one is taken for a wild one, the second in a row for a jump
of the goal."""
BELIEF = 3.0
"""Drift counts as far as it is larger than so many of its deviations."""
DAMPING = 0.03
"""Damping by the Jacobian's covariance when drift is turned into joint motion, as in the policy."""
LONGEST_S = 0.5
"""After a longer pause between measurements everything is forgotten [s]."""


class GoalMotion:
    """Learns the drift of the error rows from measurements; arrays may have leading axes `...`.

    In each control period: `update` with the measurement; give `still(e)` to the estimator, and to the
    policy the joints q - `followed`, in which the goal stands still; add `speed` times the period to the
    policy's step.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything (a new run, other rows, a moved camera). The estimator must restart too."""
        self._stamp: float | None = None
        self._drift: Array | None = None
        self._believed = np.zeros(0)
        self._speed = self._followed = self._carried = np.zeros(())

    # ---- what is known -------------------------------------------------------------------------

    @property
    def known(self) -> bool:
        """Whether there has been a measurement since the last reset."""
        return self._drift is not None

    @property
    def drift(self) -> Array:
        """(..., m) de/dt that the joints do not explain, as far as it stands out of the noise [px/s]."""
        return self._believed

    @property
    def deviation(self) -> Array:
        """(..., m) standard deviation of the drift [px/s]."""
        return np.sqrt(self._dd) if self.known else np.zeros(0)

    @property
    def speed(self) -> Array:
        """(..., n) joint speed that goes along with the goal [rad/s]."""
        return self._speed

    @property
    def followed(self) -> Array:
        """(..., n) how far the goal has moved since the reset, in joint space [rad]: in q - followed it
        stands still."""
        return self._followed

    def compensated(self, de: Array, dt: float | Array) -> Array:
        """(..., m) the change of error `de` over the last `dt` seconds without the goal's part [px]."""
        return de - self._believed * np.asarray(dt)[..., None] if self.known else de

    def still(self, e: Array) -> Array:
        """(..., m) the error `e` as it would be had the goal not moved since the reset [px]. An estimator
        that is given these learns from the arm's motion alone."""
        return e - self._carried if self.known else e

    # ---- learning ------------------------------------------------------------------------------

    def update(self, stamp: float, q: Array, e: Array, estimate: Estimate) -> None:
        """Take the joints `q` (..., n) [rad] and errors `e` (..., m) [px], NaN in rows that are not seen,
        measured at time `stamp` [s], and what is known of the Jacobian (..., m, n) at that time."""
        dt = None if self._stamp is None else stamp - self._stamp
        if self._drift is None or self._drift.shape != e.shape or dt is None or not 0.0 < dt < LONGEST_S:
            self._begin(stamp, q, e, estimate)
            return
        sigma2, moved = estimate.sigma**2, q - self._q
        expected = np.matvec(estimate.jacobian, moved)
        wander = COHERENT * estimate.spread2(moved)[..., None]
        self._predict(dt, expected, wander, MANOEUVRE * sigma2)
        self._correct(dt, e, expected, sigma2)
        self._stamp, self._q = stamp, q.copy()
        self._follow(dt, estimate)

    def _begin(self, stamp: float, q: Array, e: Array, estimate: Estimate) -> None:
        sigma2 = estimate.sigma**2
        self._stamp, self._q, self._x = stamp, q.copy(), e.copy()
        self._drift, self._believed = np.zeros(e.shape), np.zeros(e.shape)
        self._xx, self._xd = np.full(e.shape, sigma2), np.zeros(e.shape)
        self._dd = np.full(e.shape, FIRST_SPEED**2 * sigma2)
        self._wild: NDArray[np.bool_] = np.zeros(e.shape, bool)
        self._seen_wild = e.copy()
        self._speed, self._followed = np.zeros(q.shape), np.zeros(q.shape)
        self._carried = np.zeros(e.shape)

    def _predict(self, dt: float, expected: Array, wander: Array, density: float) -> None:
        """Where the rows should be by now: moved by the arm and carried by the drift."""
        assert self._drift is not None
        self._x = self._x + expected + self._drift * dt
        self._xx = self._xx + 2 * dt * self._xd + dt**2 * self._dd + wander + density * dt**3 / 3
        self._xd = self._xd + dt * self._dd + density * dt**2 / 2
        self._dd = self._dd + density * dt

    def _correct(self, dt: float, e: Array, expected: Array, sigma2: float) -> None:
        """Weigh the measurement against the prediction, each row for itself."""
        assert self._drift is not None
        surprise, expected2 = e - self._x, self._xx + sigma2
        seen, fresh = np.isfinite(e), np.isnan(self._x)
        wild = surprise**2 > WILD_SIGMAS**2 * expected2  # False where something is NaN
        jump = wild & self._wild & np.isfinite(self._seen_wild)
        take = seen & ~wild & ~fresh
        gain, rate = self._xx / expected2, self._xd / expected2
        self._x = np.where(take, self._x + gain * surprise, self._x)
        self._drift = np.where(take, self._drift + rate * surprise, self._drift)
        self._dd = np.where(take, self._dd - rate * self._xd, self._dd)
        self._xx = np.where(take, (1 - gain) * self._xx, self._xx)
        self._xd = np.where(take, (1 - gain) * self._xd, self._xd)
        # The goal has jumped, or set off: the two last measurements say where it is and how fast.
        pace = (e - self._seen_wild - expected) / dt
        self._drift = np.where(jump, pace, self._drift)
        self._x, self._xx = np.where(jump | fresh, e, self._x), np.where(jump | fresh, sigma2, self._xx)
        self._xd = np.where(jump, sigma2 / dt, np.where(fresh, 0.0, self._xd))
        self._dd = np.where(jump, 2 * sigma2 / dt**2, self._dd)
        self._wild, self._seen_wild = wild & ~jump, e.copy()

    def _follow(self, dt: float, estimate: Estimate) -> None:
        """Turn the drift that can be believed into joint motion, and add up what it did."""
        assert self._drift is not None
        size2 = np.mean(self._drift**2, axis=-1, keepdims=True)
        noise2 = BELIEF**2 * np.mean(self._dd, axis=-1, keepdims=True)
        self._believed = self._drift * np.maximum(1.0 - noise2 / np.maximum(size2, 1e-300), 0.0)
        rows = estimate.jacobian.shape[-2]
        normal = estimate.jacobian.mT @ estimate.jacobian + DAMPING * rows * estimate.covariance
        slope = np.vecmat(self._believed, estimate.jacobian)
        self._speed = -np.linalg.solve(normal, slope[..., None])[..., 0]
        self._followed = self._followed + self._speed * dt
        self._carried = self._carried + self._believed * dt
