"""The recommended policy: steps that are as long as what is known of the Jacobian allows.

Far from the goal the step is a damped Gauss-Newton step. What is not known of the Jacobian is its
damping, so that it goes where it knows its way; a trust radius follows the ratio of actual to
predicted progress, and no step may make things much worse even if the Jacobian is as wrong as it
may be. Near the goal, where the noise of the trackers matters more than the Jacobian's errors, each
measurement says where the goal lies in joint space, and the measurements of many periods are
averaged: the noise goes away and the arm comes to rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.servo.estimators.base import UNBELIEVABLE, Estimate
from vita.servo.policies.base import Mask, Proposal, Situation, StepPolicy, masked, register
from vita.servo.policies.directions import Directions
from vita.servo.small import all_of, some, whitening
from vita.types import Array

NEAR = 3.0
"""Near the goal: the full step's outcome is uncertain by less than so many times the noise variance."""
KEEP = 0.97
"""Share of the weight of older measurements that each period near the goal leaves them."""
MOVED_SIGMAS = 4.0
"""The goal itself has moved when new and old measurements disagree by more."""
WORSE_PX, WORSE_SIGMAS = 50.0, 2.5
"""No step may raise the sum of errors by more, should the Jacobian be wrong by so many deviations."""
TRIED_WORSE_PX = 20.0
"""The same for motions along directions that are hardly known [px]."""
FIRST_RADIUS, LEAST_RADIUS, MOST_RADIUS = 0.35, 0.02, 0.35
"""Trust radius [rad]."""
LEAST_GAIN, GAIN_RATE = 0.25, 1.6
GOOD, BAD = 0.75, 0.25
"""Ratios of actual to predicted decrease of |e|^2 above and below which the last step was trusted
too little and too much."""
SHRINK, SHRINKS = 0.6, 6
DITHER_PX, DITHER_FADING = 4.0, 40.0
"""Dither for whole pixels: its first size [px], and that times the square of how often it was done."""
MEAN_ABS = 0.8
"""Mean absolute value of a normal variable of deviation one, sqrt(2 / pi)."""


@dataclass
class _Memory:
    """What is kept from one period to the next, for each run."""

    first: Array
    """(...,) the setting lambda, from which the gain starts."""
    gain: Array
    radius: Array
    q: Array
    e: Array
    jacobian: Array
    whole: Mask
    """(...,) whether every error so far was a whole number of pixels."""
    mean_q: Array
    """(..., n) joints, averaged over the measurements near the goal [rad]."""
    mean_e: Array
    """(..., m) error, averaged likewise [px]."""
    count: Array
    """(...,) how many measurements are in the averages; 1 far from the goal."""


@dataclass(frozen=True)
class _View:
    """What this period's measurement says."""

    ways: Directions
    near: Mask
    slope: Array
    """(..., n) -J'e, near the goal of the averaged error [px^2/rad]."""
    direction: Array
    """(..., n) the full step over the joints that are `free` [rad]."""
    free: Mask


@register
class UncertaintyDamped(StepPolicy):
    kind = "uncertainty"
    title = "Uncertainty-damped"
    doc = "Goes only as far as the Jacobian is known, and averages the noise away near the goal."

    def __init__(self) -> None:
        self._memory: _Memory | None = None
        self._view: _View | None = None
        self._kept: tuple[Estimate, Mask, Directions] | None = None
        self._count = 0

    def restart(self) -> None:
        self._memory = self._view = self._kept = None

    def _hear(self, now: Situation) -> None:
        memory = self._remembered(now)
        estimate, rows = now.estimate, now.e.shape[-1]
        jacobian = masked(estimate.jacobian, now.free)
        ways = self._ways(estimate, now.free, jacobian)
        slope = -np.vecmat(now.e, jacobian)
        sigma2 = estimate.sigma**2
        full = ways.solve(slope)
        variance = sigma2 + estimate.spread2(full)
        near = variance < NEAR * sigma2
        right, direction, count = slope, full, 0.0 * variance + 1.0
        mean_q, mean_e = now.q, now.e
        if some(near):
            counted = 1.0 + KEEP * near * memory.count
            new = (1.0 / counted)[..., None]
            around = memory.mean_q + new * (now.q - memory.mean_q)
            met = memory.mean_e + new * (now.e - memory.mean_e)
            # The averages belong together whatever has been learned of J since.
            toward = -np.vecmat(met + np.matvec(jacobian, now.q - around), jacobian)
            there = ways.solve(toward)
            apart = np.matvec(jacobian, there - full)
            # Else the goal has moved: what was averaged is of another one.
            same = near & (np.vecdot(apart, apart) <= (rows * MOVED_SIGMAS**2) * variance)
            if all_of(same):
                mean_q, mean_e, count, right, direction = around, met, counted, toward, there
            elif some(same):
                mean_q, mean_e = _where(same, around, mean_q), _where(same, met, mean_e)
                right, direction = _where(same, toward, right), _where(same, there, full)
                count = np.where(same, counted, count)
        memory.mean_q, memory.mean_e, memory.count = mean_q, mean_e, count
        memory.q, memory.e, memory.jacobian = now.q, now.e, jacobian
        self._count += 1
        self._view = _View(ways, near, right, direction, now.free)

    def _ways(self, estimate: Estimate, free: Mask, jacobian: Array) -> Directions:
        """The directions of the present estimate, kept for as long as nothing is learned."""
        kept = self._kept
        if kept is None or kept[0] is not estimate or not (kept[1] is free or np.array_equal(kept[1], free)):
            rows = jacobian.shape[-2]
            rank = np.minimum(estimate.rank, rows)
            found = Directions(jacobian.mT @ jacobian, whitening(estimate.covariance), rank, rows)
            self._kept = kept = (estimate, free, found)
        return kept[2]

    def _choose(self, now: Situation) -> Proposal:
        memory, view = self._memory, self._view
        assert memory is not None and view is not None  # `step` hears before it chooses.
        rows, jacobian, ways, direction = now.e.shape[-1], now.estimate.jacobian, view.ways, view.direction
        if now.free is not view.free or not all_of(now.free):
            both = now.free[..., :, None] & now.free[..., None, :]
            whiten = whitening(_only(now.estimate.covariance, both))
            ways = Directions(np.where(both, ways.normal, 0.0), whiten, ways.rank, rows)
            direction = ways.solve(np.where(now.free, view.slope, 0.0))
        length = np.maximum(np.sqrt(np.vecdot(direction, direction)), 1e-12)
        share = np.minimum(memory.gain + view.near * (1.0 - memory.gain), memory.radius / length)
        dq = share[..., None] * direction
        if not all_of(view.near):
            dq = self._not_much_worse(now, dq, ~view.near, WORSE_PX)
        if not all_of(ways.used[..., ways.first :]):
            attempt = ways.attempt(masked(jacobian, now.free), now.estimate, now.e, direction)
            tried = np.logical_or.reduce(attempt != 0.0, axis=-1)
            if some(tried):
                dq = self._not_much_worse(now, dq + attempt, tried, TRIED_WORSE_PX)
        dither = view.near & memory.whole
        if some(dither):
            slope = np.vecmat(self._pattern(memory.count, rows), jacobian)
            dq = _where(dither, dq + ways.solve(np.where(now.free, slope, 0.0)), dq)
        return Proposal(now.free * dq, ways.rank, view.near)

    def _remembered(self, now: Situation) -> _Memory:
        """The memory, brought up to date with how the last step turned out."""
        memory, runs = self._memory, now.q.shape[:-1]
        if memory is None or memory.e.shape != now.e.shape:
            whole = np.logical_and.reduce(now.e == np.rint(now.e), axis=-1)
            first = np.broadcast_to(np.asarray(now.gain, float), runs)
            self._memory = memory = _Memory(
                first, first, np.full(runs, FIRST_RADIUS), now.q, now.e, now.estimate.jacobian, whole,
                now.q, now.e, np.zeros(runs),
            )
            return memory
        if some(memory.whole):
            memory.whole = memory.whole & np.logical_and.reduce(now.e == np.rint(now.e), axis=-1)
        moved = now.q - memory.q
        change = np.matvec(memory.jacobian, moved)
        size2 = np.vecdot(change, change)
        first = np.broadcast_to(np.asarray(now.gain, float), runs)
        if some(first != memory.first):
            # A setting that people change is in force at once; from there the gain adapts again.
            memory.gain = np.where(first == memory.first, memory.gain, first)
            memory.first = first
        # Inside the noise the ratio of actual to predicted progress says nothing.
        if some(size2 > 25.0 * now.estimate.sigma**2):
            self._judge(memory, now, moved, change)
        return memory

    def _judge(self, memory: _Memory, now: Situation, moved: Array, change: Array) -> None:
        """Trust steps more or less, by what the last one did and what was expected of it."""
        after, before, size2 = memory.e + change, np.vecdot(memory.e, memory.e), np.vecdot(change, change)
        predicted = before - np.vecdot(after, after)
        actual = before - np.vecdot(now.e, now.e)
        judged = (size2 > 25.0 * now.estimate.sigma**2) & (predicted > 0.0)
        # A surprise that no error of the Jacobian explains is the goal's own motion: steps are not to blame.
        surprise = now.e - after
        expected2 = 2.0 * now.estimate.sigma**2 + now.estimate.spread2(moved)
        judged &= np.vecdot(surprise, surprise) < (UNBELIEVABLE**2 * after.shape[-1]) * expected2
        good, bad = judged & (actual > GOOD * predicted), judged & (actual < BAD * predicted)
        if some(good):
            gain = np.minimum(memory.gain * GAIN_RATE, np.maximum(now.gain, 1.0))
            memory.gain = np.where(good, gain, memory.gain)
            memory.radius = np.where(good, np.minimum(2.0 * memory.radius, MOST_RADIUS), memory.radius)
        if some(bad):
            length = np.sqrt(np.vecdot(moved, moved))
            shorter = np.maximum(0.5 * np.minimum(memory.radius, length), LEAST_RADIUS)
            gain = np.maximum(memory.gain / GAIN_RATE, np.minimum(now.gain, LEAST_GAIN))
            memory.gain = np.where(bad, gain, memory.gain)
            memory.radius = np.where(bad, shorter, memory.radius)

    def _not_much_worse(self, now: Situation, dq: Array, bold: Mask, worse_px: float) -> Array:
        """`dq` shortened until even a wrong Jacobian could not raise the error by much."""
        bound = np.add.reduce(np.abs(now.e), axis=-1) + worse_px
        rows = now.e.shape[-1]
        for _ in range(SHRINKS):
            expected = np.add.reduce(np.abs(now.e + np.matvec(now.estimate.jacobian, dq)), axis=-1)
            margin = (MEAN_ABS * WORSE_SIGMAS * rows) * np.sqrt(now.estimate.spread2(dq))
            worse = bold & (expected + margin > bound)
            if not some(worse):
                break
            dq = _where(worse, SHRINK * dq, dq)
        return dq

    def _pattern(self, count: Array, rows: int) -> Array:
        """(..., m) a change of the error for trackers that report whole pixels: at rest their rounding
        errors would never change, and could not be averaged away [px]. It fades as they are."""
        size = np.minimum(DITHER_PX, DITHER_FADING / count**2)
        # Multiples of irrational numbers fill the cube evenly, and are the same in every run.
        steps = np.sqrt(np.arange(2, 2 + rows) + 0.5)
        return size[..., None] * (np.modf(self._count * steps)[0] - 0.5)


def _where(runs: Mask, new: Array, old: Array) -> Array:
    """`new` in the `runs` (...,) and `old` in the others."""
    return np.where(runs.reshape(runs.shape + (1,) * (new.ndim - runs.ndim)), new, old)


def _only(covariance: Array, both: Mask) -> Array:
    """The covariance of the free joints; the others stand for themselves."""
    return np.where(both, covariance, 0.0) + np.where(both, 0.0, np.eye(covariance.shape[-1]))
