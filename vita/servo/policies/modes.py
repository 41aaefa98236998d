"""The Jacobian taken apart into directions of motion, from which the classical steps are built.

With J = U S V' (singular values s, largest first), moving by one radian along the joint direction
v_i moves the error by s_i along u_i, and every damped or truncated inverse of the Jacobian is a
choice of how much of each direction to take.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.servo.estimators.base import RIGID_RANK
from vita.servo.policies.base import Mask, Situation, masked
from vita.types import Array

NOTHING = 1e-9
"""Singular values below this share of the largest are rounding."""
NEAR = 3.0
"""Near the goal: the full step's outcome is uncertain by less than so many times the noise variance."""
WEAK_SIGMAS, WEAK_STEP = 3.0, 0.3
"""A direction that is hardly known is tried when this many deviations of error call for it and a step
of no more than this [rad] would do."""


@dataclass(frozen=True, eq=False)
class Modes:
    """The directions of joint motion that a step may use, k = min(m, n) of them."""

    strength: Array
    """(..., k) singular values of the Jacobian over the free joints, largest first [px/rad]."""
    share: Array
    """(..., k) error along each direction, U'e [px]."""
    axes: Array
    """(..., n, k) V: directions of joint motion, in columns."""
    used: Mask
    """(..., k) whether the step may use it."""

    @property
    def largest(self) -> Array:
        """(...,) the largest singular value [px/rad]."""
        return self.strength.max(axis=-1, initial=0.0)

    def step(self, damping2: Array | float) -> Array:
        """(..., n) the step -(J'J + damping2 I)^-1 J'e over the used directions [rad].

        `damping2` (...,) is mu^2 [px^2/rad^2]; with 0 it is the pseudo-inverse's step.
        """
        mu2 = np.asarray(damping2, float)[..., None]
        bottom = np.where(self.used, self.strength**2 + mu2, 1.0)
        along = np.where(self.used, self.strength * self.share, 0.0) / bottom
        return -(self.axes @ along[..., None])[..., 0]


def modes_of(now: Situation, known: bool = False) -> Modes:
    """The directions of motion of the present Jacobian over the free joints.

    At most six are used: a rigid hand has no more, and what is left is noise. With `known`, only as
    many as the estimate is sure that the rows hold, and others if the error clearly asks for them: only
    moving tells whether the task holds a direction that hardly shows.
    """
    u, s, vt = np.linalg.svd(masked(now.estimate.jacobian, now.free), full_matrices=False)
    number, largest = np.arange(s.shape[-1]), s.max(axis=-1, initial=0.0)
    used = (number < RIGID_RANK) & (s > NOTHING * largest[..., None])
    share = (u.swapaxes(-1, -2) @ now.e[..., None])[..., 0]
    if known:
        asked = (np.abs(share) > WEAK_SIGMAS * now.estimate.sigma) & (np.abs(share) < WEAK_STEP * s)
        used &= asked | (number < np.asarray(now.estimate.rank)[..., None])
    return Modes(s, share, vt.swapaxes(-1, -2), used)


def near(now: Situation, full: Array) -> Mask:
    """(...,) whether noise matters more than the Jacobian's errors for the undamped step `full`."""
    return now.estimate.spread2(full) < (NEAR - 1.0) * now.estimate.sigma**2
