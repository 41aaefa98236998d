"""The thesis' estimator, and the same update with what it lacks: a gate against the noise."""

from __future__ import annotations

import numpy as np

from vita.servo.estimators.base import CURVATURE, Estimate, JacobianEstimator, Mask, register
from vita.types import Array

WORST = 100.0
"""A Jacobian's variance is not told as more than so many times its mean squared entry: the policies
factorise it, and a number that says "nothing is known" serves them as well as infinity."""


def broyden_update(jacobian: Array, dq: Array, de: Array, alpha: float) -> Array:
    """Thesis eq. 2.18: the smallest change of `jacobian` (..., m, n) [px/rad] that explains a share
    `alpha` of the motion `de` (..., m) [px] seen while the joints really moved by `dq` (..., n) [rad].

    With alpha = 1 the secant equation J dq = de holds exactly; with 0 nothing changes, and neither
    does it where the joints did not move.
    """
    length2 = np.einsum("...i,...i->...", dq, dq)
    gain = alpha * dq / np.where(length2 > 0.0, length2, np.inf)[..., None]
    surprise = de - np.einsum("...ij,...j->...i", jacobian, dq)
    return jacobian + surprise[..., :, None] * gain[..., None, :]


def covariance_after(old: Estimate, dq: Array, gain: Array) -> Array:
    """(..., n, n) covariance of a row after J += (de - J s) k' with s = `dq` and any `gain` k (..., n).

    The error of J goes over into (I - k s') times itself, plus k times the noise of two measurements,
    plus what J changes along the step, half before and half after. This holds for every gain,
    however it was chosen (the Joseph form of the Kalman filter's covariance), so that the policies
    hear the truth about estimators that keep no covariance of their own.
    """
    eye = np.eye(dq.shape[-1])
    length2 = np.einsum("...i,...i->...", dq, dq)
    drift = (0.5 * CURVATURE**2 * old.scale2 * length2)[..., None, None] * eye
    keep = eye - gain[..., :, None] * dq[..., None, :]
    # Of a step so small that the noise drowns it, no more than "nothing is known" is learned.
    largest = np.maximum(np.abs(gain).max(-1), 1e-300)
    with np.errstate(over="ignore"):
        variance = np.minimum(2.0 * old.sigma**2 * largest**2, WORST * old.scale2)
    along = gain / largest[..., None]
    noise = along[..., :, None] * along[..., None, :]
    after = keep @ (old.covariance + drift) @ keep.swapaxes(-1, -2) + variance[..., None, None] * noise
    return _bounded(after + drift, WORST * old.scale2)


def _bounded(covariance: Array, most: Array) -> Array:
    """`covariance` (..., n, n), scaled down where its largest variance is above `most` (...,)."""
    largest = np.einsum("...ii->...i", covariance).max(-1)
    return covariance * np.minimum(1.0, most / largest)[..., None, None]


@register
class Broyden(JacobianEstimator):
    """Broyden's update over secants that stand out of the noise."""

    kind = "broyden"
    title = "Broyden, gated"
    doc = "Thesis update, but only from motions that stand out of the tracker noise. Simple and cheap."

    def _learned(self, dq: Array, de: Array, seen: Mask, learn: Mask) -> Estimate:
        old, alpha = self._estimate, self.tuning.alpha
        jacobian = broyden_update(old.jacobian, dq, np.where(seen, de, 0.0), alpha)
        length2 = np.einsum("...i,...i->...", dq, dq)
        gain = alpha * dq / np.where(length2 > 0.0, length2, np.inf)[..., None]
        return self._put(jacobian, covariance_after(old, dq, gain), seen, learn)


@register
class Thesis(Broyden):
    """Fixed Jacobian (alpha = 0) or Broyden's update at every step, whatever the noise (thesis 2.3.3).

    Kept as it is for comparison: a step inside the noise does spoil the estimate.
    """

    kind = "thesis"
    title = "Thesis (fixed or Broyden)"
    doc = "Exactly the thesis: alpha 0 keeps the first Jacobian, else every step is learned, noise or not."

    def observe(self, q: Array, e: Array) -> Mask:
        before, error = self._q, self._e
        self._q, self._e = q.copy(), e.copy()
        if before is None or error is None:
            return np.zeros(q.shape[:-1], bool)
        dq, de = q - before, e - error
        learn = np.asarray(np.einsum("...i,...i->...", dq, dq) > 0.0)
        if learn.any():
            self._estimate = self._with_rank(self._learned(dq, de, np.isfinite(de), learn))
        return learn
