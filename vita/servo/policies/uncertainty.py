"""The recommended policy: steps that are as long as what is known of the Jacobian allows.

Far from the goal the step is a damped Gauss-Newton step. What is not known of the Jacobian is its
damping, so that it goes where it knows its way; a trust radius follows the ratio of actual to
predicted progress, and no step may make things much worse even if the Jacobian is as wrong as it
may be. Near the goal, where the noise of the trackers matters more than the Jacobian's errors, each
measurement is taken as information on where the goal lies in joint space, and the information of
many periods is added up: the noise is averaged away and the arm comes to rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vita.servo.policies.base import (
    Mask,
    Proposal,
    Situation,
    StepPolicy,
    masked,
    register,
)
from vita.types import Array

RHO = 0.03
"""Damping by the Jacobian's covariance: rho m P is added to J'J."""
NEAR = 3.0
"""Near the goal: the full step's outcome is uncertain by less than so many times the noise variance."""
KEEP = 0.95
"""Share of the old information on the goal that each period near it keeps."""
MOVED_SIGMAS = 4.0
"""The goal itself has moved when new and old information disagree by more."""
WORSE_PX, WORSE_SIGMAS = 50.0, 2.0
"""No step may raise the sum of errors by more, should the Jacobian be wrong by so many deviations."""
FIRST_RADIUS, LEAST_RADIUS, MOST_RADIUS = 0.4, 0.02, 0.5
"""Trust radius [rad]."""
LEAST_GAIN, GAIN_RATE = 0.25, 1.6
GOOD, BAD = 0.75, 0.25
"""Ratios of actual to predicted decrease of |e|^2 above and below which the last step was trusted
too little and too much."""
SHRINK, SHRINKS = 0.6, 6
MEAN_ABS = 0.8
"""Mean absolute value of a normal variable of deviation one, sqrt(2 / pi)."""


@dataclass
class _Memory:
    """What is kept from one period to the next, for each run."""

    gain: Array
    radius: Array
    information: Array
    """(..., n, n) of where the goal is [1/rad^2]."""
    vector: Array
    """(..., n) the same times the goal position [1/rad]."""
    weight: Array
    """(...,) how many measurements are in the information."""
    free: Mask
    q: Array
    e: Array
    jacobian: Array
    whole: Mask
    """(...,) whether every error so far was a whole number of pixels."""


@register
class UncertaintyDamped(StepPolicy):
    kind = "uncertainty"
    title = "Uncertainty-damped"
    doc = "Goes only as far as the Jacobian is known, and averages the noise away near the goal."

    def __init__(self) -> None:
        self._memory: _Memory | None = None
        self._count = 0

    def restart(self) -> None:
        self._memory = None

    def step(self, now: Situation) -> Proposal:
        jacobian = masked(now.estimate.jacobian, now.free)
        memory = self._remembered(now, jacobian)
        rows, n = jacobian.shape[-2:]
        sigma2 = now.estimate.sigma**2
        whiten = _whitening(now.estimate.covariance, now.free)
        normal = jacobian.swapaxes(-1, -2) @ jacobian
        slope = _times(jacobian.swapaxes(-1, -2), now.e)

        rank = np.minimum(now.estimate.rank, rows)
        full = _solve(normal, -slope, whiten, rows, rank)
        variance = sigma2 + now.estimate.spread2(full)
        near = variance < NEAR * sigma2
        direction = full
        fresh = _times(normal, now.q) - slope
        if near.any():
            keep = np.where(near, KEEP, 0.0)
            info = keep[..., None, None] * memory.information + normal / variance[..., None, None]
            vector = keep[..., None] * memory.vector + fresh / variance[..., None]
            weight = keep * memory.weight + 1.0
            share = variance / weight
            averaged = _solve(
                info * share[..., None, None], (vector - _times(info, now.q)) * share[..., None],
                whiten, rows, rank,
            )
            apart = _times(jacobian, averaged - full)
            moved = np.mean(apart**2, axis=-1) > MOVED_SIGMAS**2 * variance
            use = near & ~moved
            direction = np.where(use[..., None], averaged, full)
        else:
            use, info, vector, weight = near, normal, fresh, np.ones_like(variance)
        stale = ~use
        if stale.any():
            info = np.where(stale[..., None, None], normal / variance[..., None, None], info)
            vector = np.where(stale[..., None], fresh / variance[..., None], vector)
            weight = np.where(stale, 1.0, weight)
        memory.information, memory.vector, memory.weight = info, vector, weight

        length = np.maximum(np.linalg.norm(direction, axis=-1), 1e-12)
        share = np.minimum(np.where(near, 1.0, memory.gain), memory.radius / length)
        dq = share[..., None] * direction
        dq = self._not_much_worse(now, jacobian, dq, ~near)
        dq = self._dithered(dq, near & memory.whole, normal, jacobian, whiten, rank)
        memory.q, memory.e, memory.jacobian, memory.free = now.q, now.e, jacobian, now.free
        return Proposal(np.where(now.free, dq, 0.0), rank, near)

    def _remembered(self, now: Situation, jacobian: Array) -> _Memory:
        """The memory, brought up to date with how the last step turned out."""
        memory, runs, n = self._memory, now.q.shape[:-1], now.q.shape[-1]
        whole = np.all(now.e == np.rint(now.e), axis=-1)
        first = np.broadcast_to(np.asarray(now.gain, float), runs)
        if memory is None or memory.e.shape != now.e.shape or not np.array_equal(memory.free, now.free):
            gain = first.copy() if memory is None else memory.gain
            radius = np.full(runs, FIRST_RADIUS) if memory is None else memory.radius
            memory = _Memory(
                gain, radius, np.zeros((*runs, n, n)), np.zeros((*runs, n)), np.zeros(runs),
                now.free, now.q, now.e, jacobian, whole,
            )
            self._memory = memory
            return memory
        memory.whole = memory.whole & whole
        moved = now.q - memory.q
        change = _times(memory.jacobian, moved)
        before = np.sum(memory.e**2, axis=-1)
        predicted = before - np.sum((memory.e + change) ** 2, axis=-1)
        actual = before - np.sum(now.e**2, axis=-1)
        # Inside the noise the ratio says nothing.
        judged = (np.sum(change**2, axis=-1) > 25.0 * now.estimate.sigma**2) & (predicted > 0.0)
        good, bad = judged & (actual > GOOD * predicted), judged & (actual < BAD * predicted)
        length = np.linalg.norm(moved, axis=-1)
        least = np.minimum(first, LEAST_GAIN)
        memory.gain = np.where(good, np.minimum(memory.gain * GAIN_RATE, np.maximum(first, 1.0)), memory.gain)
        memory.gain = np.where(bad, np.maximum(memory.gain / GAIN_RATE, least), memory.gain)
        memory.radius = np.where(good, np.minimum(2.0 * memory.radius, MOST_RADIUS), memory.radius)
        shorter = np.maximum(0.5 * np.minimum(memory.radius, length), LEAST_RADIUS)
        memory.radius = np.where(bad, shorter, memory.radius)
        return memory

    def _not_much_worse(self, now: Situation, jacobian: Array, dq: Array, far: Mask) -> Array:
        """`dq` shortened until even a wrong Jacobian could not raise the error by much."""
        bound = np.sum(np.abs(now.e), axis=-1) + WORSE_PX
        rows = now.e.shape[-1]
        for _ in range(SHRINKS):
            expected = np.sum(np.abs(now.e + _times(jacobian, dq)), axis=-1)
            margin = MEAN_ABS * WORSE_SIGMAS * rows * np.sqrt(now.estimate.spread2(dq))
            worse = far & (expected + margin > bound)
            if not worse.any():
                break
            dq = np.where(worse[..., None], SHRINK * dq, dq)
        return dq

    def _dithered(
        self, dq: Array, where: Mask, normal: Array, jacobian: Array, whiten: Array, rank: NDArray[np.int_]
    ) -> Array:
        """Half a pixel's worth of change added for trackers that report whole pixels: at rest their
        rounding errors would never change and could not be averaged away."""
        if not where.any():
            return dq
        self._count += 1
        rows = jacobian.shape[-2]
        # Multiples of irrational numbers fill the cube evenly, and are the same in every run.
        pattern = np.modf(self._count * np.sqrt(np.arange(2, 2 + rows) + 0.5))[0] - 0.5
        slope = _times(jacobian.swapaxes(-1, -2), np.broadcast_to(pattern, (*dq.shape[:-1], rows)))
        extra = _solve(normal, slope, whiten, rows, rank)
        return np.where(where[..., None], dq + extra, dq)


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]


def _whitening(covariance: Array, free: Mask) -> Array:
    """(..., n, n) W with W P W' = I over the free joints; the others stand for themselves."""
    both = free[..., :, None] & free[..., None, :]
    eye = np.eye(free.shape[-1])
    return np.linalg.inv(np.linalg.cholesky(np.where(both, covariance, 0.0) + np.where(both, 0.0, eye)))


def _solve(normal: Array, right: Array, whiten: Array, rows: int, rank: NDArray[np.int_]) -> Array:
    """(J'J + rho m P)^-1 right, over the `rank` (...,) best known directions of motion.

    What is best known is judged in coordinates in which every Jacobian entry has noise of variance one.
    """
    turned = whiten.swapaxes(-1, -2)
    strength, axes = np.linalg.eigh(whiten @ normal @ turned)
    n = strength.shape[-1]
    used = np.arange(n) >= n - rank[..., None]  # in ascending order, the best last
    factor = used / (np.maximum(strength, 0.0) + RHO * rows)
    return _times(turned, _times(axes, factor * _times(axes.swapaxes(-1, -2), _times(whiten, right))))
