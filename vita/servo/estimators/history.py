"""All measurements so far at once: a Gaussian process for the error over joint space."""

from __future__ import annotations

import numpy as np

from vita.servo.estimators.base import CURVATURE, Estimate, JacobianEstimator, Mask, Samples, Tuning, register
from vita.types import Array

KEEP = 60
"""Samples that are kept; the farthest from here makes room for a new one."""
LENGTH_RAD = 1.0 / CURVATURE
"""Length scale of the process [rad]: J changes by about its own size on the way."""
FIRM = 1e-10
"""Added to the kernel, relative to its size, so that it can be factorised."""


@register
class History(JacobianEstimator):
    """Each error row is a smooth random function of the joints around what the first Jacobian says,

        e(q) = e0 + J0 (q - q0) + g(q),   cov(g(q), g(p)) = s^2 (1 + exp(-|q - p|^2 / 2 l^2)),

    with l = 1 / kappa and s = l rms(J0), so that the gradient of g varies by rms(J0). It is known
    through noisy readings e(q_i), and through the first Jacobian: the gradient of g at q0 is zero, up
    to the covariance P0. The Jacobian here is J0 plus the expected gradient of g, and its covariance
    is that of the gradient (Rasmussen and Williams, Gaussian Processes for Machine Learning, 9.4).

    Unlike a filter it sees the curve behind the secants: that J changes along the way is no noise
    to it, and an old measurement counts again when the arm comes back. Rows share one kernel matrix.
    A reading that is missing is replaced by what was expected of it, which changes nothing.
    """

    kind = "history"
    title = "All history (Gaussian process)"
    doc = "Fits a smooth curve through all that was measured. Accurate, but slower the longer it runs."

    def __init__(self, start: Estimate, history: Samples | None = None, tuning: Tuning | None = None) -> None:
        super().__init__(start, history, tuning)
        *runs, m, n = start.jacobian.shape
        self._runs, self._m, self._n = tuple(runs), m, n
        self._begin(None)
        if history is not None and history.q.shape[-2]:
            self._seed(history)

    def _begin(self, home: Array | None) -> None:
        """Drop all samples; the present Jacobian, at `home` (..., n), is all that is known."""
        self._first = self._estimate
        self._home = home
        self._at = np.zeros((*self._runs, KEEP, self._n))
        self._read = np.zeros((*self._runs, KEEP, self._m))
        self._count = np.zeros(self._runs, int)

    def restart(self) -> None:
        """After a jump old readings do not fit new ones; what they taught is in the Jacobian."""
        if self._q is not None:
            self._begin(None)
        super().restart()

    def _seed(self, history: Samples) -> None:
        """The samples of the exploration. The first of them is where J0 was measured."""
        self._home = history.q[..., 0, :].copy()
        for q, e in zip(np.moveaxis(history.q, -2, 0), np.moveaxis(history.e, -2, 0), strict=True):
            self._keep(q, e, np.ones(self._runs, bool))

    def observe(self, q: Array, e: Array) -> Mask:
        first = self._q is None
        learned = super().observe(q, e)
        if first:
            if self._home is None:
                self._home = q.copy()
            self._keep(q, e, np.ones(self._runs, bool))
        return learned

    def _learned(self, dq: Array, de: Array, seen: Mask, learn: Mask) -> Estimate:
        assert self._q is not None and self._e is not None  # A secant has a beginning.
        q = self._q + dq
        self._keep(q, np.where(seen, self._e + de, np.nan), learn)
        _, jacobian, covariance = self._posterior(q)
        return self._put(jacobian, covariance, seen, learn)

    def _keep(self, q: Array, e: Array, where: Mask) -> None:
        """Add a sample to the runs `where` (...,)."""
        missing = ~np.isfinite(e)
        if missing.any():
            e = np.where(missing, self._posterior(q)[0], e)
        far = np.sum((self._at - q[..., None, :]) ** 2, axis=-1)
        slot = np.where(self._count < KEEP, self._count, far.argmax(-1))
        put = (np.arange(KEEP) == slot[..., None]) & where[..., None]
        self._at = np.where(put[..., None], q[..., None, :], self._at)
        self._read = np.where(put[..., None], e[..., None, :], self._read)
        self._count = np.minimum(self._count + where, KEEP)

    def _posterior(self, q: Array) -> tuple[Array, Array, Array]:
        """Expected error (..., m), Jacobian (..., m, n) and its covariance (..., n, n) at `q` (..., n)."""
        first, n = self._first, self._n
        assert self._home is not None  # Set with the first sample.
        used = max(int(self._count.max()), 1)
        kept = np.arange(used) < self._count[..., None]
        at = self._at[..., :used, :] - self._home[..., None, :]
        here = q - self._home
        # Units of s: the kernel is then of size one, and 1 / l^2 is the variance of a gradient.
        size2 = first.scale2 * LENGTH_RAD**2
        kernel = self._kernel(at, kept, first.sigma**2 / size2, first.covariance / size2[..., None, None])
        offset = self._read[..., :1, :]
        rest = self._read[..., :used, :] - offset - at @ first.jacobian.swapaxes(-1, -2)
        nothing = np.zeros((*self._runs, n, self._m))
        right = np.concatenate([np.where(kept[..., None], rest, 0.0), nothing], -2)

        apart = here[..., None, :] - at
        bell = np.where(kept, np.exp(-0.5 * np.sum(apart**2, axis=-1) / LENGTH_RAD**2), 0.0)
        value_value = bell + kept
        slope_value = -(bell[..., None] * apart / LENGTH_RAD**2).swapaxes(-1, -2)
        value_slope, slope_slope = self._to_home(here)
        value = np.concatenate([value_value, value_slope], -1)
        slope = np.concatenate([slope_value, slope_slope], -1)
        solved = np.linalg.solve(kernel, np.concatenate([right, slope.swapaxes(-1, -2)], -1))
        weights, taught = solved[..., : self._m], solved[..., self._m :]
        error = offset[..., 0, :] + (first.jacobian @ here[..., None])[..., 0]
        error = error + (value[..., None, :] @ weights)[..., 0, :]
        jacobian = first.jacobian + (slope @ weights).swapaxes(-1, -2)
        known = np.eye(n) / LENGTH_RAD**2 - slope @ taught
        known = 0.5 * (known + known.swapaxes(-1, -2)) + FIRM * np.eye(n)
        return error, jacobian, known * size2[..., None, None]

    def _kernel(self, at: Array, kept: Mask, noise: Array, start: Array) -> Array:
        """(..., t + n, t + n) covariance of the readings and the first Jacobian's gradient, in units of s."""
        used, n = at.shape[-2:]
        apart = at[..., :, None, :] - at[..., None, :, :]
        bell = 1.0 + np.exp(-0.5 * np.sum(apart**2, axis=-1) / LENGTH_RAD**2)
        both = kept[..., :, None] & kept[..., None, :]
        kernel = np.zeros((*self._runs, used + n, used + n))
        own = np.where(kept, noise[..., None] + FIRM, 1.0)
        kernel[..., :used, :used] = np.where(both, bell, 0.0) + own[..., None] * np.eye(used)
        cross = np.exp(-0.5 * np.sum(at**2, axis=-1) / LENGTH_RAD**2)[..., None] * at / LENGTH_RAD**2
        cross = np.where(kept[..., None], cross, 0.0)
        kernel[..., :used, used:] = cross
        kernel[..., used:, :used] = cross.swapaxes(-1, -2)
        kernel[..., used:, used:] = np.eye(n) / LENGTH_RAD**2 + start
        return kernel

    def _to_home(self, here: Array) -> tuple[Array, Array]:
        """Covariance of the value (..., n) and of the slope (..., n, n) here with the slope at home."""
        bell = np.exp(-0.5 * np.sum(here**2, axis=-1) / LENGTH_RAD**2)[..., None]
        outer = here[..., :, None] * here[..., None, :] / LENGTH_RAD**2
        slope = bell[..., None] * (np.eye(self._n) - outer) / LENGTH_RAD**2
        return bell * here / LENGTH_RAD**2, slope
