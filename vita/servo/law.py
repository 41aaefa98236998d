"""The control law: from an error and a Jacobian to a joint step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vita.types import Array

RIGID_RANK = 6
"""A rigid hand has six degrees of freedom, so its Jacobian has no more: further singular values
are noise, and inverting them throws the arm about."""


@dataclass(frozen=True)
class Inverse:
    """A damped, rank-limited inverse and what it says of the task."""

    matrix: Array
    """(n, m) [rad/px]."""
    singular_values: Array
    """Of the weighted Jacobian, largest first [px/rad]."""
    rank: int
    """How many directions are above the damping."""


def damped_inverse(jacobian: Array, damping: float) -> Inverse:
    """J+ of thesis eq. 2.4 and 2.15 with Levenberg damping mu = damping x largest singular value:
    s / (s^2 + mu^2) in place of 1 / s, and at most six directions."""
    u, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    if s.size == 0 or s[0] <= 0.0:
        return Inverse(np.zeros((jacobian.shape[1], jacobian.shape[0])), s, 0)
    mu = damping * s[0]
    keep = min(RIGID_RANK, s.size)
    gains = np.zeros_like(s)
    gains[:keep] = s[:keep] / (s[:keep] ** 2 + mu**2)
    rank = int(np.count_nonzero(s[:keep] > max(mu, 1e-9 * s[0])))
    return Inverse((vt.T * gains) @ u.T, s, rank)


def control_step(
    jacobian: Array, error: Array, weights: Array, gain: float, damping: float, free: NDArray[np.bool_]
) -> tuple[Array, Inverse]:
    """dq = -lambda J+ e (thesis eq. 2.15) over the joints where the (n,) mask `free` is true.

    `jacobian` (m, n) [px/rad], `error` (m,) [px], `weights` (m,) >= 0. Returns the (n,) step [rad],
    zero for joints that are not free, and the inverse that made it.
    """
    inverse = damped_inverse(weights[:, None] * jacobian[:, free], damping)
    dq = np.zeros(jacobian.shape[1])
    dq[free] = -gain * (inverse.matrix @ (weights * error))
    return dq, inverse
