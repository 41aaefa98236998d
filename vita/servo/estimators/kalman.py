"""The recommended estimator: a Kalman filter on the rows of the Jacobian, with one covariance."""

from __future__ import annotations

import numpy as np

from vita.servo.estimators.base import CURVATURE, UNBELIEVABLE, Estimate, JacobianEstimator, Mask, register
from vita.servo.small import all_of, identity
from vita.types import Array

BENT = 0.1
"""Share of the observed motion that is always allowed for as one deviation of a surprise."""


@register
class Kalman(JacobianEstimator):
    """Each row j of the Jacobian is a state that wanders as the arm moves; every secant measures it.

    All rows see the same joint motion s through the same noise, so that they share one covariance P
    (n, n), and a step costs what one row would. With the Jacobian's change over the step as process
    noise, half of it before and half after the measurement,

        P += q I,   K = P s / (s' P s + 2 sigma^2),   J += (de - J s) K',   P += q I - K s' P,
        q = kappa^2 mean(J0^2) |s|^2 / 2.

    It is a Broyden update (thesis eq. 2.18) whose rate and direction follow from what is known
    already: directions that were measured well are not spoilt by a new noisy step.
    """

    kind = "kalman"
    title = "Kalman filter"
    doc = "Weighs each measured motion against what is known already. The best choice for most tasks."

    def _learned(self, dq: Array, de: Array, seen: Mask, learn: Mask) -> Estimate:
        old = self._estimate
        drift = 0.5 * CURVATURE**2 * old.scale2 * np.vecdot(dq, dq)
        wander = drift[..., None, None] * identity(dq.shape[-1])
        prior = old.covariance + wander
        cross = np.matvec(prior, dq)
        expected2 = np.vecdot(dq, cross) + 2.0 * old.sigma**2
        gain = cross / np.maximum(expected2, 1e-300)[..., None]
        known = de if all_of(seen) else np.where(seen, de, 0.0)
        surprise = known - np.matvec(old.jacobian, dq)
        # The arm's own curve may exceed what `CURVATURE` allows by far, when cameras are close.
        bent2 = BENT**2 * np.vecdot(known, known) / known.shape[-1]
        trusted = self._trusted(surprise, expected2 + bent2)
        jacobian = old.jacobian + trusted[..., None] * gain[..., None, :]
        covariance = prior + wander - gain[..., :, None] * cross[..., None, :]
        return self._put(jacobian, covariance, seen, learn)

    def _trusted(self, surprise: Array, expected2: Array) -> Array:
        """(..., m) the part of the surprise that is believed [px]; its variance is `expected2`."""
        size2 = np.vecdot(surprise, surprise) / surprise.shape[-1]
        share = np.minimum(1.0, UNBELIEVABLE**2 * expected2 / np.maximum(size2, 1e-300))
        return share[..., None] * surprise
