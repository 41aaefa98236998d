"""The thesis' control law: every step tries to remove the same share of the error."""

from __future__ import annotations

import numpy as np

from vita.servo.policies.base import Proposal, Situation, StepPolicy, register
from vita.servo.policies.modes import modes_of, near
from vita.types import Array


@register
class Fixed(StepPolicy):
    """dq = -lambda J+ e (thesis eq. 2.15), with the pseudo-inverse of eq. 2.4.

    Levenberg damping mu, relative to the largest singular value, may be added: s / (s^2 + mu^2) in
    place of 1 / s. Without it this is exactly what the thesis' experiments ran.
    """

    kind = "fixed"
    title = "Fixed gain"
    doc = "Removes the same share lambda of the error in every step, as in the thesis."

    def _choose(self, now: Situation) -> Proposal:
        modes = modes_of(now)
        mu = now.damping * modes.largest
        full = modes.step(mu**2)
        dq = self._gain(now)[..., None] * full
        rank = np.count_nonzero(modes.used & (modes.strength > mu[..., None]), axis=-1)
        return Proposal(np.where(now.free, dq, 0.0), rank, near(now, full))

    def _gain(self, now: Situation) -> Array:
        """Lambda, one for all runs or one for each (...,)."""
        return np.asarray(now.gain, float)
