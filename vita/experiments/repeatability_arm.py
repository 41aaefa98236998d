"""An arm that does not quite go where it is told, and how far off it must be.

What an arm gets wrong is put into four numbers. A commanded pose is missed by a constant `offset`
(the thesis: the dial's push, and a calibration that differs between commanded and reported poses)
and by a random stop error, new in every move. The stop error is smaller after small moves, or the
thesis could not have come from about 0.15 mm to 0.036 mm by one more small step. And a joint that
is asked for less than its dead band does not move at all (thesis 5.1.3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from vita.experiments.arms import Arm
from vita.types import Array

MOVE_RAD, MOVE_SPREAD_RAD = np.radians(3.0), np.radians(1.0)
"""The thesis' motions: 3 degrees, plus or minus 1, in every joint."""
SMALL_SHARE = 0.2
"""Stop error of a tiny move, as a share of that of a move of 3 degrees."""
DEAD_BAND_RAD = 1.5e-4
"""A joint that is asked for less stands still. At 0.7 m this is 0.1 mm, which gives the thesis'
observation that a doubled lambda brought the tool nearer by 0.1 to 0.2 mm."""


@dataclass(frozen=True)
class Joints:
    """How the joints of an arm carry out what they are told."""

    stop_rad: float = 0.0
    """Standard deviation of where a joint stops after a move of 3 degrees [rad]."""
    offset_rad: float = 0.0
    """By so much every joint is off a commanded pose, always the same [rad]."""
    dead_band_rad: float = DEAD_BAND_RAD

    def move(self, q: Array, dq: Array, random: np.random.Generator) -> Array:
        """Where joints `q` (..., n) are after a relative motion `dq` [rad]. The offset is one between
        absolute poses and cancels in a difference."""
        noise = random.standard_normal(dq.shape)
        moves = np.abs(dq) >= self.dead_band_rad
        return q + np.where(moves, dq + self._deviation(dq) * noise, 0.0)

    def go_to(self, target: Array, q: Array, random: np.random.Generator) -> Array:
        """Where the joints are after a commanded pose `target`, coming from `q` (..., n) [rad]."""
        noise = random.standard_normal(q.shape)
        return target + self.offset_rad * _pattern(q.shape[-1]) + self._deviation(target - q) * noise

    def _deviation(self, dq: Array) -> Array:
        """Standard deviation of the stop error, the shape of `dq` [rad]."""
        long = (dq / MOVE_RAD) ** 2
        return self.stop_rad * np.sqrt(SMALL_SHARE**2 + (1.0 - SMALL_SHARE**2) * long)


def _pattern(n: int) -> Array:
    """(n,) signs of the offset: neighbours differ, or all would push the same way."""
    return np.where(np.arange(n) % 2 == 0, 1.0, -1.0)


def away(goal: Array, trials: int, random: np.random.Generator) -> Array:
    """(trials, n) joints moved from `goal` (n,) or (trials, n) by 3 degrees, plus or minus 1 [rad]."""
    shape = (trials, goal.shape[-1])
    return goal + MOVE_RAD + MOVE_SPREAD_RAD * random.uniform(-1.0, 1.0, shape)


def tip_error(arm: Arm, q: Array, goal: Array, push: Array | float = 0.0) -> Array:
    """(...,) how far the tool is from where it is at `goal` as a dial tells, in one direction at a time
    (thesis 5.2.3): the mean over x, y, z of the arm's base of the absolute differences [m].

    For a lone joint it is the distance itself, since its dial stands along the only motion. A `push`
    (3,) [m] moves the tool away from where the joints put it.
    """
    apart = arm.pose(q)[..., :3, 3] + push - arm.pose(goal)[..., :3, 3]
    if arm.n == 1:
        return np.linalg.norm(apart, axis=-1)
    return np.abs(apart).mean(-1)


def reported(arm: Arm, joints: Joints, goal: Array, trials: int, seed: int) -> Array:
    """(trials,) miss after the arm was led to `goal` by hand, its encoders were read, and it was sent
    away and back to what they read [m]."""
    random = np.random.default_rng(seed)
    q = joints.go_to(goal, away(goal, trials, random), random)
    return tip_error(arm, q, goal)


def commanded(arm: Arm, joints: Joints, goal: Array, trials: int, seed: int) -> Array:
    """(trials,) miss after the arm was sent to `goal`, the dial was placed, and it was sent away and
    back to the same command: the offset is in both [m]."""
    random = np.random.default_rng(seed)
    first = joints.go_to(goal, away(goal, trials, random), random)
    second = joints.go_to(goal, away(goal, trials, random), random)
    return tip_error(arm, second, first)


def calibrated(arm: Arm, goal: Array, want_reported: float, want_commanded: float, seed: int) -> Joints:
    """The joints whose mean errors [m] under joint control are those of the thesis.

    The stop error alone decides the error to a commanded pose, nearly in proportion; the offset then
    decides that to a reported pose. Both are searched with the same random numbers at every try, so
    that the mean is a smooth function of them.
    """
    trials = 2000

    def off_commanded(stop: float) -> float:
        return commanded(arm, Joints(stop), goal, trials, seed).mean() - want_commanded

    joints = Joints(_root(off_commanded))

    def off_reported(offset: float) -> float:
        return reported(arm, replace(joints, offset_rad=offset), goal, trials, seed).mean() - want_reported

    return replace(joints, offset_rad=_root(off_reported))


def _root(function: Callable[[float], float]) -> float:
    """Where `function` of a joint error [rad] is zero; 10 mrad are more than any arm has."""
    return float(np.asarray(brentq(function, 0.0, 1e-2, xtol=1e-9)))
