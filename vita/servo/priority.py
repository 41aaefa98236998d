"""Priorities between constraints: a lower one acts only where the higher ones leave the arm free.

With classical task priority (Siciliano and Slotine, ICAR 1991) the rows of level k get

    dq_k = (J_k N)^+ (e_k + J_k x) ,   x the step of the levels above, N the projector on their null space.

The same comes out of one ordinary step on rows that have been transformed: J_k' = J_k N and
e_k' = e_k + J_k x have the null space built in, and since the levels' row spaces are then at right
angles, the pseudo-inverse of the stack is that of the levels side by side. Any policy therefore works
on top, with its memory: e' changes by about J' dq, as e changes by J dq.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.servo.estimators.base import CURVATURE, held
from vita.servo.policies.base import Proposal, Situation, masked
from vita.types import Array

LEAST = 0.1
"""A direction that the levels above leave to a lower one must be so many times as strong as noise alone
would be."""


@dataclass(frozen=True, eq=False)
class Level:
    """The rows of one priority, in what the higher ones leave free."""

    rows: NDArray[np.int_]
    """(k,) indices of the rows."""
    jacobian: Array
    """(..., k, n) J_k N [px/rad]."""
    e: Array
    """(..., k) what these rows will be when the levels above are done, without what cannot be mended [px]."""
    rank: NDArray[np.int_]
    """(...,) how many directions of motion they hold there."""


def split(jacobian: Array, e: Array, priorities: NDArray[np.int_], covariance: Array) -> tuple[Level, ...]:
    """The levels, most important (lowest number) first.

    `jacobian` (..., m, n), `e` (..., m), `priorities` (m,), and `covariance` (..., n, n) of each row
    of the Jacobian, by which it is judged what a level holds.
    """
    if np.shape(priorities) != e.shape[-1:]:
        raise BadInput(f"{np.shape(priorities)} priorities for {e.shape[-1]} error rows", "priorities")
    n = jacobian.shape[-1]
    levels: list[Level] = []
    size = np.sqrt(np.mean(np.sum(jacobian**2, axis=-1), axis=-1))[..., None]
    free = np.broadcast_to(np.eye(n), (*jacobian.shape[:-2], n, n))
    done = np.zeros((*jacobian.shape[:-2], n))
    for priority in np.unique(priorities):
        rows = np.flatnonzero(np.asarray(priorities) == priority)
        j, left = jacobian[..., rows, :] @ free, e[..., rows] + _times(jacobian[..., rows, :], done)
        u, s, vt = np.linalg.svd(j, full_matrices=False)
        number = np.arange(s.shape[-1])
        if levels:
            # What is left of a direction that the levels above hold is as strong as the Jacobian's errors,
            # and dividing by it would throw the arm about. Of such a direction only as much is asked for
            # as is signal, and the less the farther it would lead on a Jacobian that bends.
            noise = len(rows) * _variance(vt, covariance)
            bend = CURVATURE * size * np.linalg.norm(left, axis=-1)[..., None]
            mine = (s**2 > LEAST * noise) & (s > 1e-6 * s.max(-1, keepdims=True, initial=0.0))
            part = s**2 / np.maximum(s**2 + noise + bend, 1e-300)
            share = np.where(mine, part * _times(u.swapaxes(-1, -2), left), 0.0)
            left, j = _times(u, share), (u * np.where(mine, s, 0.0)[..., None, :]) @ vt
        else:
            mine = number < held(j, covariance)[..., None]
            share = np.where(mine, _times(u.swapaxes(-1, -2), left), 0.0)
        levels.append(Level(rows, j, left, np.count_nonzero(mine, axis=-1)))
        axes = np.where(mine[..., None], vt, 0.0)
        free = free - axes.swapaxes(-1, -2) @ axes
        done = done - _times(axes.swapaxes(-1, -2), share / np.where(mine, s, 1.0))
    return tuple(levels)


def prioritised(
    policy_step: Callable[[Situation], Proposal], now: Situation, priorities: NDArray[np.int_]
) -> Proposal:
    """The step of `policy_step` under `priorities` (m,), 1 the most important.

    With equal priorities it is the policy's normal step.
    """
    priorities = np.asarray(priorities)
    if np.unique(priorities).size <= 1:
        return policy_step(now)
    estimate = now.estimate
    jacobian, e = masked(estimate.jacobian, now.free), now.e.copy()
    levels = split(jacobian, e, priorities, estimate.covariance)
    jacobian = jacobian.copy()
    for level in levels:
        jacobian[..., level.rows, :], e[..., level.rows] = level.jacobian, level.e
    rank = np.minimum(estimate.rank, np.sum([level.rank for level in levels], axis=0))
    return policy_step(replace(now, e=e, estimate=replace(estimate, jacobian=jacobian, rank=rank)))


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]


def _variance(vt: Array, covariance: Array) -> Array:
    """(..., k) variance of the Jacobian along each of the k directions in the rows of `vt`."""
    return np.einsum("...ki,...ij,...kj->...k", vt, covariance, vt)
