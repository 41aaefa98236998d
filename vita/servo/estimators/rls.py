"""Recursive least squares with forgetting: all secants so far, the older the less."""

from __future__ import annotations

import numpy as np

from vita.servo.estimators.base import CURVATURE, Estimate, JacobianEstimator, Mask, Samples, Tuning, register
from vita.servo.estimators.broyden import covariance_after
from vita.types import Array

REACH_RAD = 0.35
"""How far from the first Jacobian it is still believed as much as what is measured later [rad]."""


@register
class RecursiveLeastSquares(JacobianEstimator):
    """The J that minimises the sum over all secants s of |de - J s|^2 / r, each multiplied by
    `forgetting` f to the power of its age, and of the squared distance from the first J by G,

        r = 2 sigma^2 + (kappa |s|^2 / 2)^2 mean(J0^2),
        k = G s / (f r + s' G s),   J += (de - J s) k',   G = (G - k s' G) / f.

    G (n, n) is shared by all rows. Two things keep it from freezing J, which plain least squares does
    after a few steps: a long secant is wrong by the curve that it cuts, so that r counts that as
    noise, and G begins with what J will have changed by on its way, (kappa REACH)^2 of its square.
    Of the further changes G knows nothing; the covariance for the policies comes from the gain k.
    """

    kind = "rls"
    title = "Recursive least squares"
    doc = "Fits all motions so far, older ones less. Steady where the Jacobian changes little."

    def __init__(self, start: Estimate, history: Samples | None = None, tuning: Tuning | None = None) -> None:
        super().__init__(start, history, tuning)
        changes = (CURVATURE * REACH_RAD) ** 2 * start.scale2
        self._spread = start.covariance + changes[..., None, None] * np.eye(start.jacobian.shape[-1])

    def _learned(self, dq: Array, de: Array, seen: Mask, learn: Mask) -> Estimate:
        old, forget = self._estimate, self.tuning.forgetting
        length2 = np.einsum("...i,...i->...", dq, dq)
        noise = 2.0 * old.sigma**2 + 0.25 * CURVATURE**2 * old.scale2 * length2**2
        cross = np.einsum("...ij,...j->...i", self._spread, dq)
        expected2 = np.einsum("...i,...i->...", dq, cross) + forget * noise
        gain = cross / np.maximum(expected2, 1e-300)[..., None]
        surprise = np.where(seen, de, 0.0) - np.einsum("...ij,...j->...i", old.jacobian, dq)
        jacobian = old.jacobian + surprise[..., :, None] * gain[..., None, :]
        spread = self._spread - gain[..., :, None] * cross[..., None, :]
        spread = self._forgotten(0.5 * (spread + spread.swapaxes(-1, -2)), forget)
        self._spread = np.where(learn[..., None, None], spread, self._spread)
        return self._put(jacobian, covariance_after(old, dq, gain), seen, learn)

    def _forgotten(self, spread: Array, forget: float) -> Array:
        """Directions in which the arm does not move are forgotten without end, which would let G grow
        beyond all bounds: no more is forgotten once a direction is known no better than not at all."""
        grown = spread / forget
        largest = np.einsum("...ii->...i", grown).max(-1)
        return np.where((largest <= self._estimate.scale2)[..., None, None], grown, spread)
