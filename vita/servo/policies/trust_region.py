"""A trust region: steps as long as the last ones have shown the Jacobian to hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.servo.policies.base import Proposal, Situation, StepPolicy, register
from vita.servo.policies.modes import Modes, modes_of, near
from vita.types import Array

FIRST_RADIUS, LEAST_RADIUS, MOST_RADIUS = 0.15, 0.02, 0.2
"""Trust radius [rad]. A Jacobian changes by a tenth of itself over the largest. On the thesis' protocol
14 of 8,640 runs still jump by more than 100 px in a step; with at most 0.3 rad 52 of 720 do."""
LEAST_GAIN, GAIN_RATE = 0.25, 1.6
GOOD, BAD = 0.75, 0.25
"""Ratios of actual to predicted decrease of |e|^2 above and below which the Jacobian was trusted too
little and too much."""
ABOVE_NOISE = 5.0
"""A change of the error is judged when it is so many times the noise."""
ITERATIONS = 8
"""Newton steps for the damping; three or four are enough in nearly all cases."""


@dataclass
class _Memory:
    """What is kept from one period to the next, for each run."""

    radius: Array
    gain: Array
    q: Array
    e: Array
    jacobian: Array


@register
class TrustRegion(StepPolicy):
    """The step that minimises |lambda e + J dq| under |dq| <= radius (Levenberg-Marquardt, More 1978).

    The ratio of the actual to the predicted decrease of |e|^2 changes radius and gain after each step
    whose effect stands out of the noise (Nocedal and Wright, Numerical Optimization, algorithm 4.1;
    for uncalibrated servoing Jagersand, ICRA 1997, and Shademan and Jagersand, 2009). Near the goal,
    where full steps would only follow the noise, the gain is the user's again.
    """

    kind = "trust_region"
    title = "Trust region"
    doc = "Lengthens and shortens its steps by how well the last ones turned out as predicted."

    def __init__(self) -> None:
        self._memory: _Memory | None = None

    def restart(self) -> None:
        self._memory = None

    def _hear(self, now: Situation) -> None:
        """Change radius and gain by how the motion since the last call turned out."""
        memory, runs = self._memory, now.q.shape[:-1]
        first = np.broadcast_to(np.asarray(now.gain, float), runs)
        if memory is None or memory.e.shape != now.e.shape:
            radius, gain = np.full(runs, FIRST_RADIUS), first
        else:
            radius, gain = _judged(memory, now, first)
        self._memory = _Memory(radius, gain, now.q, now.e, now.estimate.jacobian)

    def _choose(self, now: Situation) -> Proposal:
        memory = self._memory
        assert memory is not None  # `step` hears before it chooses.
        modes = modes_of(now, known=True)
        floor = (now.damping * modes.largest) ** 2
        close = near(now, modes.step(floor))
        gain = np.where(close, np.minimum(now.gain, memory.gain), memory.gain)
        dq = gain[..., None] * _within(modes, floor, memory.radius / np.maximum(gain, 1e-9))
        return Proposal(np.where(now.free, dq, 0.0), np.count_nonzero(modes.used, axis=-1), close)


def _judged(memory: _Memory, now: Situation, first: Array) -> tuple[Array, Array]:
    """(...,) radius and gain after the step from `memory` to `now`; `first` is the user's gain."""
    moved = now.q - memory.q
    change = (memory.jacobian @ moved[..., None])[..., 0]
    before = np.sum(memory.e**2, axis=-1)
    predicted = before - np.sum((memory.e + change) ** 2, axis=-1)
    actual = before - np.sum(now.e**2, axis=-1)
    most = np.maximum(np.linalg.norm(change, axis=-1), np.linalg.norm(now.e - memory.e, axis=-1))
    judged = (most > ABOVE_NOISE * now.estimate.sigma) & (predicted > 0.0)
    good, bad = judged & (actual > GOOD * predicted), judged & (actual < BAD * predicted)
    length, radius, gain = np.linalg.norm(moved, axis=-1), memory.radius, memory.gain
    # A step that was much shorter than the radius has not put the radius to the test.
    tried = length > 0.5 * radius
    shorter = np.maximum(0.5 * np.minimum(radius, length), LEAST_RADIUS)
    radius = np.where(good & tried, np.minimum(2.0 * radius, MOST_RADIUS), radius)
    radius = np.where(bad, shorter, radius)
    gain = np.where(good, np.minimum(gain * GAIN_RATE, np.maximum(first, 1.0)), gain)
    gain = np.where(bad, np.maximum(gain / GAIN_RATE, np.minimum(first, LEAST_GAIN)), gain)
    return radius, gain


def _within(modes: Modes, floor: Array, radius: Array) -> Array:
    """(..., n) the damped step of length at most `radius` (...,) [rad], with damping at least `floor`.

    Its length falls as the damping mu^2 grows; 1 / length is nearly a straight line in mu^2, so that
    Newton's method on it converges in a few steps from below (More, 1978).
    """
    top = np.where(modes.used, modes.strength * modes.share, 0.0)
    mu2 = np.array(floor, float)
    for _ in range(ITERATIONS):
        bottom = np.where(modes.used, modes.strength**2 + mu2[..., None], 1.0)
        length = np.linalg.norm(top / bottom, axis=-1)
        over = length > 1.001 * radius
        if not over.any():
            break
        slope = np.sum(top**2 / bottom**3, axis=-1)
        more = (length / radius - 1.0) * length**2 / np.maximum(slope, 1e-300)
        mu2 = np.where(over, mu2 + more, mu2)
    step = modes.step(mu2)
    length = np.linalg.norm(step, axis=-1)
    return np.minimum(1.0, radius / np.maximum(length, 1e-300))[..., None] * step
