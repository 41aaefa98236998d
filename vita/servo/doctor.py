"""The constraint doctor: what a Jacobian says about a task, before the arm goes anywhere.

Everything here is linear algebra on the weighted Jacobian J (m, n) [px/rad] of the joints in use:
which joint motions the task holds, which it leaves free, which constraints are needed, which add
nothing, and which contradict each other. `vita.servo.task_check` finds what can be told from the
drawing alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vita.servo.diagnosis import Diagnosis
from vita.servo.estimators.base import CURVATURE, RIGID_RANK, Mask, held, whitened
from vita.servo.insight import combination
from vita.types import Array, RowLabel, frozen

__all__ = ["Diagnosis", "diagnose", "readable"]

HALF_INFORMATION = 0.999 / np.sqrt(2.0)
"""A copy of a constraint halves at most the information in any direction when it is taken away, so that
no singular value falls below 1 / sqrt(2) of what it was (and a hair for rounding)."""
CONFLICT_SIGMAS = 4.0
"""What no motion can remove must be so many deviations from zero before a contradiction is claimed."""
GONE = 0.05
"""A direction that keeps less than this share of its singular value (or of the strength that noise alone
gives it) is taken to be gone: what is left is noise."""
BLAME = 0.5
"""A constraint is part of a contradiction when without it no more than this share is left of what (squared)
cannot be removed."""


def diagnose(
    jacobian: Array,
    covariance: Array | float,
    labels: Sequence[RowLabel],
    error: Array,
    names: Sequence[str],
    sigma: float,
    rank: int | None = None,
) -> Diagnosis:
    """Examine the weighted `jacobian` (m, n) of the joints `names` and the weighted `error` (m,) [px].

    `covariance` (n, n) is that of each row [px^2/rad^2] (a number stands for that times the identity)
    and decides, as in the servo, which directions stand out of the noise; `rank` overrules it.
    `sigma` is the tracker noise [px]. Rows that are not seen (NaN) are left out.
    """
    seen = np.isfinite(error) & np.isfinite(jacobian).all(axis=1)
    jacobian, error = jacobian[seen], error[seen]
    labels = [label for label, there in zip(labels, seen.tolist(), strict=True) if there]
    n = jacobian.shape[1]
    if np.ndim(covariance) == 0:
        covariance = float(covariance) * np.eye(n)
    count = _rank(jacobian, np.asarray(covariance)) if rank is None else min(rank, *jacobian.shape)
    values, held_axes, free_axes = _axes(jacobian, np.asarray(covariance), count)
    needed, redundant = _importance(jacobian, np.asarray(covariance), labels, count, values, rank)
    conflict_px, conflicting = _conflict(jacobian, np.asarray(covariance), labels, error, sigma, count)
    weakest = float(values[-1]) if count else 0.0
    free = readable(free_axes)
    return Diagnosis(
        held=count,
        joints=n,
        rows=len(labels),
        free=tuple(combination(motion, names) for motion in free),
        free_motions=frozen(free),
        needed=needed,
        redundant=redundant,
        conflicting=conflicting,
        conflict_px=conflict_px,
        condition=float(values[0] / weakest) if weakest > 0.0 else float("inf"),
        weakest=weakest,
        weakest_motion=combination(held_axes[-1], names) if count else "",
    )


def _rank(jacobian: Array, covariance: Array) -> int:
    return int(min(int(held(jacobian, covariance)), *jacobian.shape)) if jacobian.size else 0


def _axes(jacobian: Array, covariance: Array, count: int) -> tuple[Array, Array, Array]:
    """Singular values (count,) [px/rad], the held directions (count, n), the free ones (n - count, n).

    Which directions are free is decided in whitened coordinates, where all entries of J are known
    equally well; those that are held are then ordered by how far they move the image.
    """
    n = jacobian.shape[1]
    if not count:
        return np.zeros(0), np.zeros((0, n)), np.eye(n)
    _, turned = np.linalg.eigh(whitened(jacobian, covariance))
    # Back to joint motions: what the whitening stretches is turned back by its transpose.
    back = np.linalg.inv(np.linalg.cholesky(covariance)).T
    free, _ = np.linalg.qr(back @ turned[:, : n - count])
    _, values, axes = np.linalg.svd(jacobian - jacobian @ free @ free.T)
    return values[:count], axes[:count], free.T


def readable(motions: Array) -> Array:
    """(k, n) unit vectors that span the same space as `motions` (k, n), each of few joints.

    Row reduction with the largest entry as the pivot: the k pivot joints appear in one motion each,
    so that a joint that is free alone is said to be free alone.
    """
    rows = np.array(motions, float)
    for i in range(rows.shape[0]):
        left = rows[i:]
        r, c = np.unravel_index(int(np.argmax(np.abs(left))), left.shape)
        rows[[i, i + int(r)]] = rows[[i + int(r), i]]
        rows[i] /= rows[i, c]
        others = np.arange(rows.shape[0]) != i
        rows[others] -= rows[others, c : c + 1] * rows[i]
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)


def _rows_of(labels: Sequence[RowLabel]) -> dict[str, Mask]:
    """Constraint to (m,) bool of its rows, in order of appearance."""
    names = np.array([label.constraint for label in labels])
    return {name: names == name for name in dict.fromkeys(names.tolist())}


def _importance(
    jacobian: Array,
    covariance: Array,
    labels: Sequence[RowLabel],
    count: int,
    values: Array,
    rank: int | None,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The constraints that are needed, and those that add nothing, each judged by leaving it out."""
    needed, redundant = [], []
    for name, rows in _rows_of(labels).items():
        rest = jacobian[~rows]
        left = min(_rank(rest, covariance), count) if rank is None else _plain_rank(rest, values)
        if left < count:
            needed.append(name)
        elif not np.abs(jacobian[rows]).max(initial=0.0) or (
            np.linalg.svd(rest, compute_uv=False)[count - 1] >= HALF_INFORMATION * values[-1]
        ):
            redundant.append(name)
    return tuple(needed), tuple(redundant)


def _plain_rank(jacobian: Array, values: Array) -> int:
    """Rank of a part where the caller knows that of the whole, `values` (rank,) [px/rad]."""
    if not jacobian.size or not values.size:
        return 0
    return int(np.count_nonzero(np.linalg.svd(jacobian, compute_uv=False) > GONE * values[-1]))


def _conflict(
    jacobian: Array, covariance: Array, labels: Sequence[RowLabel], error: Array, sigma: float, count: int
) -> tuple[float, tuple[str, ...]]:
    """Length [px] of the error's part that no joint motion removes, and the constraints behind it.

    First order only: far from the goal J itself changes on the way by about kappa |dq|, so that what
    is left must stand out of that, of the noise, and of what is not known of J.
    """
    m = jacobian.shape[0]
    if m <= count or not jacobian.size:
        return 0.0, ()
    # A direction too weak to count as held may still remove error, so that only what is nothing but
    # noise is left out.
    faint = np.linalg.eigvalsh(whitened(jacobian, covariance)) > GONE * m
    count = max(count, min(int(np.count_nonzero(faint)), RIGID_RANK, *jacobian.shape))
    if m <= count:
        return 0.0, ()
    left, values, right = np.linalg.svd(jacobian, full_matrices=False)
    base = left[:, :count]
    rest = error - base @ (base.T @ error)
    dq = right[:count].T @ ((base.T @ error) / np.maximum(values[:count], 1e-12)) if count else np.zeros(0)
    variance = sigma**2
    if count:
        length2 = float(dq @ dq)
        scale2 = float(np.mean(jacobian**2))
        variance += float(dq @ covariance @ dq) + 0.25 * CURVATURE**2 * scale2 * length2**2
    total = float(rest @ rest)
    if total <= CONFLICT_SIGMAS**2 * variance * (m - count):
        return 0.0, ()
    names = []
    for name, rows in _rows_of(labels).items():
        if _left_over(jacobian[~rows], error[~rows], values[count - 1] if count else 0.0) <= BLAME * total:
            names.append(name)
    if not names:
        # No single one: then those that carry the most of it.
        shares = {name: float(rest[rows] @ rest[rows]) for name, rows in _rows_of(labels).items()}
        names = [name for name, share in shares.items() if share >= 0.5 * max(shares.values())]
    return float(np.sqrt(total)), tuple(names)


def _left_over(jacobian: Array, error: Array, weakest: float) -> float:
    """Squared length of what of `error` (m,) no held motion removes [px^2]. Without some rows fewer
    directions may be held: those far below what was the `weakest` are noise and remove nothing."""
    if not error.size:
        return 0.0
    base, values, _ = np.linalg.svd(jacobian, full_matrices=False)
    base = base[:, values > GONE * weakest] if weakest > 0.0 else base[:, :0]
    rest = error - base @ (base.T @ error)
    return float(rest @ rest)
