"""Least squares from many starts at once: Levenberg and Marquardt's method on arrays of runs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vita.types import Array

Residual = Callable[[Array], Array]
"""From states (..., *shape) to residuals (..., m)."""
Retract = Callable[[Array, Array], Array]
"""From states (..., *shape) and steps (..., k) to the states after the steps."""

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-12, 1e8
STEP = 1e-6
"""Length of the finite differences, in the units of a step."""


def fit(
    residual: Residual, retract: Retract, state: Array, size: int, rounds: int = 60
) -> tuple[Array, Array]:
    """Minimise |residual|^2 from each of the states (runs, *shape), with steps of `size` numbers.

    Returns the states and residuals (runs, m) at the end. The damping is scaled by the diagonal of
    J'J (Marquardt), so that the units of the steps do not matter; it is kept for each run on its own.
    """
    state, runs = state.copy(), state.shape[0]
    value = residual(state)
    cost = np.sum(value**2, axis=-1)
    damping = np.full(runs, FIRST_DAMPING)
    work = np.arange(runs)
    for _ in range(rounds):
        J = jacobian(residual, retract, state[work], size, value[work])
        normal = J.swapaxes(-1, -2) @ J
        slope = (J.swapaxes(-1, -2) @ value[work][..., None])[..., 0]
        diagonal = np.einsum("rii->ri", normal)
        # A direction that moves nothing still needs something to divide by.
        floor = 1e-9 * diagonal.max(axis=-1, keepdims=True) + 1e-300
        extra = damping[work][:, None] * np.maximum(diagonal, floor)
        step = np.linalg.solve(normal + extra[..., None] * np.eye(size), -slope[..., None])[..., 0]
        tried = retract(state[work], step)
        after = residual(tried)
        left = np.sum(after**2, axis=-1)
        better = left < cost[work]
        took = work[better]
        settled = np.zeros(work.size, bool)
        settled[better] = cost[took] - left[better] <= 1e-12 * cost[took] + 1e-24
        state[took], value[took], cost[took] = tried[better], after[better], left[better]
        damping[work] = np.where(better, damping[work] * 0.2, damping[work] * 6.0).clip(LEAST_DAMPING, None)
        work = work[~settled & (damping[work] < MOST_DAMPING)]
        if not work.size:
            break
    return state, value


def jacobian(
    residual: Residual, retract: Retract, state: Array, size: int, value: Array | None = None
) -> Array:
    """(runs, m, size) d residual / d step at states (runs, *shape); forward differences from `value`
    where it is given, else central ones."""
    away = STEP * np.eye(size)
    # Axes in front: one for each direction of the step.
    ahead = residual(retract(state, away[:, None, :]))
    behind = residual(retract(state, -away[:, None, :])) if value is None else value
    return np.moveaxis((ahead - behind) / (2 * STEP if value is None else STEP), 0, -1)
