"""A gain that grows as the goal comes near."""

from __future__ import annotations

import numpy as np

from vita.servo.policies.base import Situation, register
from vita.servo.policies.fixed import Fixed
from vita.types import Array

MORE_NEAR = 2.0
"""How many times larger the gain is at the goal than far from it, as in the thesis (section 5.2.3)."""
MOST_GAIN = 1.0
"""More than the whole error is never removed on account of being near."""
NEAR_PX = 10.0
"""The extra gain falls to 1/e of itself when the largest error component is so large [px]."""


@register
class Adaptive(Fixed):
    """lambda(x) = (l0 - linf) exp(-x / x0) + linf, x the largest error component [px].

    This is the adaptive gain of visual servoing practice (Chaumette and Marchand's ViSP,
    vpAdaptiveGain), whose slope at zero l0' is written as (l0 - linf) / x0. The gain far away, linf,
    is the user's lambda. The thesis (section 5.2.3) doubled lambda by hand for the last steps, because
    an arm with a dead band comes to rest where lambda J+ e is smaller than it: the larger the gain at
    the goal, the smaller the residual.
    """

    kind = "adaptive"
    title = "Adaptive gain"
    doc = "Fixed gain that doubles near the goal, for arms that do not carry out very small motions."

    def _gain(self, now: Situation) -> Array:
        far = np.asarray(now.gain, float)
        at_goal = np.maximum(far, np.minimum(MORE_NEAR * far, MOST_GAIN))
        x = np.abs(now.e).max(axis=-1, initial=0.0)
        return far + (at_goal - far) * np.exp(-x / NEAR_PX)
