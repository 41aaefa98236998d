"""What joint motion that the task leaves free is used for.

A task that holds fewer directions than the arm has joints leaves motions that do not change its
error. They serve a second objective: its gradient, projected onto the null space of the held
directions (Liegeois, IEEE Trans. SMC 7, 1977). The Jacobian is only an estimate, and its errors harm
such a projection more than the servo itself, which sees and mends what they do; the step is
therefore made so small that even with them the image hardly moves.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput, UnknownName
from vita.types import Array

RATE = 0.1
"""Share of the way to the objective that one period would like to go."""
MOST_STEP_RAD = 0.01
"""No joint moves more for a secondary objective in one control period [rad]."""
ZONE = 0.15
"""Share of a joint's range at either end in which `limits` acts."""
DISTURBANCE_PX = 0.15
"""No error row may be moved by more in one period, as far as is known [px]."""
SIGMAS = 3.0
"""So many standard deviations of the Jacobian are taken into account."""
CALM_PX, CALM_SIGMAS = 0.3, 1.5
"""At the goal the step is full while the error (root mean square) is below the larger of the two, and
nothing when it is twice that: what the Jacobian did not foresee is mended before more is risked."""

Mask = NDArray[np.bool_]


class Secondary(ABC):
    """A second objective: where the joints would like to go."""

    kind: ClassVar[str]
    title: ClassVar[str]
    doc: ClassVar[str]

    @abstractmethod
    def way(self, q: Array, lower: Array, upper: Array, posture: Array | None) -> Array:
        """(..., n) how far each joint is from where it would like to be, the negative gradient of the
        objective [rad]. `lower` and `upper` (n,) may be infinite."""


SECONDARIES: dict[str, type[Secondary]] = {}
"""Kind to secondary objective."""


def register(secondary: type[Secondary]) -> type[Secondary]:
    """Add a kind. Raises `ValueError` on a name that is taken."""
    if secondary.kind in SECONDARIES:
        raise ValueError(f"secondary objective {secondary.kind!r} is registered twice")
    SECONDARIES[secondary.kind] = secondary
    return secondary


def secondary_of(kind: str, path: str = "") -> type[Secondary]:
    """The secondary objective of a kind; raises `UnknownName` with the choices."""
    try:
        return SECONDARIES[kind]
    except KeyError:
        raise UnknownName("secondary objective", kind, SECONDARIES, path) from None


@register
class NoSecondary(Secondary):
    kind = "none"
    title = "Nothing"
    doc = "The smallest motion that does the task."

    def way(self, q: Array, lower: Array, upper: Array, posture: Array | None) -> Array:
        return np.zeros_like(q)


@register
class Centre(Secondary):
    """Objective |q - middle|^2 / 2 over the joints that have two limits."""

    kind = "centre"
    title = "Centre the joints"
    doc = "Keeps every joint near the middle of its range, as far as the task lets it."

    def way(self, q: Array, lower: Array, upper: Array, posture: Array | None) -> Array:
        bounded = np.isfinite(lower) & np.isfinite(upper)
        middle = np.where(bounded, 0.5 * (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)), 0.0)
        return np.where(bounded, middle - q, 0.0)


@register
class AwayFromLimits(Secondary):
    """Zero in the inner part of the range; near an end, the depth in the zone d pushes back with
    d^2 / zone, which sets in without a jump or a kink."""

    kind = "limits"
    title = "Stay off the limits"
    doc = "Moves joints back that are within 15 % of their range of a limit; acts nowhere else."

    def way(self, q: Array, lower: Array, upper: Array, posture: Array | None) -> Array:
        bounded = np.isfinite(lower) & np.isfinite(upper)
        zone = np.where(bounded, ZONE * np.where(bounded, upper - lower, 1.0), 1.0)
        too_high = np.where(bounded, np.maximum(q - (upper - zone), 0.0), 0.0)
        too_low = np.where(bounded, np.maximum((lower + zone) - q, 0.0), 0.0)
        return (too_low**2 - too_high**2) / zone


@register
class Posture(Secondary):
    """Objective |q - posture|^2 / 2."""

    kind = "posture"
    title = "Keep a posture"
    doc = "Stays as near to a posture of the user's choice as the task lets it."

    def way(self, q: Array, lower: Array, upper: Array, posture: Array | None) -> Array:
        if posture is None or np.shape(posture)[-1:] != q.shape[-1:]:
            raise BadInput(f"give a position for each of the {q.shape[-1]} joints", "servo.posture_deg")
        return np.asarray(posture, float) - q


def secondary_step(
    kind: str,
    q: Array,
    lower: Array,
    upper: Array,
    posture: Array | None,
    jacobian: Array,
    rank: NDArray[np.int_] | int,
    covariance: Array,
    free: Mask,
    e: Array | None = None,
    sigma: float = 0.3,
    near: Mask | bool = True,
    most: float = MOST_STEP_RAD,
    budget_px: float = DISTURBANCE_PX,
) -> Array:
    """(..., n) joint step [rad] to add to the task's own; zero in joints that are not `free` (..., n).

    `jacobian` (..., m, n) [px/rad], its rows multiplied by their weights, `rank` (...,) directions of
    which are held by the task, and `covariance` (..., n, n) of each row. No joint moves by more than
    `most`, none leaves `lower` to `upper` (n,) because of it, and no row is expected to move by more
    than `budget_px`: |J dq| + 2 sqrt(dq' P dq) stays below. With the error `e` (..., m) [px] and its
    noise `sigma` [px], runs that are `near` (...,) the goal wait while it is disturbed; on the way
    there the task's own motion is much larger anyway.
    """
    way = secondary_of(kind)().way(q, np.asarray(lower, float), np.asarray(upper, float), posture)
    step, allowed = np.zeros_like(q), np.broadcast_to(free, q.shape)
    if not np.any(way):
        return step
    if e is not None:
        calm = np.maximum(CALM_PX, CALM_SIGMAS * sigma)
        disturbed = np.sqrt(np.mean(e**2, axis=-1)) / calm - 1.0
        budget = budget_px * np.where(near, np.clip(1.0 - disturbed, 0.0, 1.0), 1.0)
    else:
        budget = np.asarray(budget_px)
    for _ in range(q.shape[-1]):
        step = _projected(RATE * way, jacobian, rank, allowed)
        step = _small(step, jacobian, covariance, most, budget)
        leaving = ((q + step > upper) & (step > 0.0)) | ((q + step < lower) & (step < 0.0))
        if not leaving.any():
            return step
        # A joint that would leave its range stands still, and the others are asked again.
        allowed = allowed & ~leaving
    return np.zeros_like(q)


def _projected(wanted: Array, jacobian: Array, rank: NDArray[np.int_] | int, allowed: Mask) -> Array:
    """The part of `wanted` in the null space of the strongest `rank` directions of motion."""
    _, s, vt = np.linalg.svd(np.where(allowed[..., None, :], jacobian, 0.0), full_matrices=False)
    number = np.arange(s.shape[-1])
    held = (number < np.asarray(rank)[..., None]) & (s > 1e-9 * s.max(axis=-1, initial=0.0)[..., None])
    wanted = np.where(allowed, wanted, 0.0)
    along = np.where(held, (vt @ wanted[..., None])[..., 0], 0.0)
    free_part = wanted - (vt.swapaxes(-1, -2) @ along[..., None])[..., 0]
    return np.where(allowed, free_part, 0.0)


def _small(step: Array, jacobian: Array, covariance: Array, most: float, budget: Array) -> Array:
    """`step` scaled as a whole until no joint and no error row moves too much."""
    moved = np.abs(jacobian @ step[..., None])[..., 0].max(axis=-1, initial=0.0)
    unsure = np.sqrt(np.einsum("...i,...ij,...j->...", step, covariance, step))
    image = budget / np.maximum(moved + SIGMAS * unsure, 1e-300)
    joints = most / np.maximum(np.abs(step).max(axis=-1), 1e-300)
    return np.minimum(1.0, np.minimum(image, joints))[..., None] * step
