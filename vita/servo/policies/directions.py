"""Directions of joint motion, from the least to the best known, and steps along them."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from vita.servo.estimators.base import RIGID_RANK, Estimate
from vita.servo.small import eigh, identity
from vita.types import Array

RHO = 0.03
"""Damping by the Jacobian's covariance: rho m P is added to J'J."""
LEFT_SIGMAS, TRY_REACH, TRY_STEP = 1.5, 0.4, 0.1
"""When more error is left than so many deviations, directions that are hardly known are tried: those
that may explain it with a motion of up to TRY_REACH [rad], by TRY_STEP [rad] at a time."""


@cache
def _numbers(n: int) -> NDArray[np.int_]:
    return np.arange(n)


class Directions:
    """The directions of joint motion, from the least to the best known: the eigenvectors of J'J in
    coordinates in which every entry of J has noise of variance one."""

    def __init__(self, normal: Array, whiten: Array, rank: NDArray[np.int_], rows: int) -> None:
        self.normal, self.whiten, self.rank, self._rows = normal, whiten, rank, rows
        strength, axes = eigh(whiten @ normal @ whiten.mT)
        self.strength = np.maximum(strength, 0.0)
        """(..., n) squared image motion per unit of each; m when it is all noise."""
        self.motions = whiten.mT @ axes
        """(..., n, n) the joint motion of each, in its columns."""
        n = strength.shape[-1]
        self.used = _numbers(n) >= (n - rank)[..., None]
        self.first = max(0, n - min(RIGID_RANK, rows))
        """The first direction that a task can hold."""
        self._most_idle = n - int(np.min(rank))
        self._factor = self.used / (self.strength + RHO * rows)

    def solve(self, right: Array) -> Array:
        """(..., n) (J'J + rho m P)^-1 right over the directions in use."""
        step = np.matvec(self.motions, self._factor * np.vecmat(right, self.motions))
        return step if self._most_idle == 0 else step - self._idle(step)

    def _idle(self, step: Array) -> Array:
        """(..., n) the part of `step` along the directions that do nothing: without it, the step is the
        smallest joint motion with the same effect."""
        k = self._most_idle
        idle = self.motions[..., :k] * ~self.used[..., None, :k]
        among, along = idle.mT @ idle, np.vecmat(step, idle)
        if k > 1:
            shares = np.linalg.solve(among + self.used[..., None, :k] * identity(k), along[..., None])[..., 0]
        else:
            shares = along / (among[..., 0] + self.used[..., :1])
        return np.matvec(idle, shares)

    def attempt(self, jacobian: Array, estimate: Estimate, e: Array, step: Array) -> Array:
        """(..., n) a motion along directions that are hardly known, where `step` will leave an error.

        `jacobian` (..., m, n) over the joints that are free, `e` (..., m) the error now.

        Such a direction may be one that the task does hold but that showed little when exploring; only
        moving along it tells. Once it is known better, it is either counted as held, or can no longer
        explain what is left, which then is a contradiction in the task and no reason to move.
        """
        left = e + np.matvec(jacobian, step)
        size2 = np.vecdot(left, left)
        expected2 = self._rows * (estimate.sigma**2 + estimate.spread2(step))
        reach = np.linalg.norm(self.motions, axis=-2)
        possible = (np.sqrt(self.strength) + 2.0 * np.sqrt(self._rows)) * TRY_REACH / reach
        tried = ~self.used & (possible > np.sqrt(size2)[..., None])
        tried &= (size2 > LEFT_SIGMAS**2 * expected2)[..., None]
        tried[..., : self.first] = False
        slope = -np.vecmat(np.vecmat(left, jacobian), self.motions)
        along = np.clip(slope / (self.strength + RHO * self._rows), -TRY_STEP / reach, TRY_STEP / reach)
        return np.matvec(self.motions, np.where(tried, along, 0.0))
