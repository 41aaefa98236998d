"""Exploratory motions: how the servo learns its first Jacobian (thesis eq. 2.17).

Written as a generator, so that it reads like the thesis and yet runs one control period at a
time: it yields the joint position to go to and is sent the next measurement.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import NamedTuple

import numpy as np

from vita.types import Array, Joint

ARRIVED_RAD = 1e-6
"""Nearer than this to the target counts as there."""
STILL_RAD = 2e-5
STILL_PERIODS = 8
"""An arm that has not moved for so many periods will not come nearer (dead band, friction).
More than the delay of a live rig, so that an arm that is yet to start is not taken for stuck."""


class Sample(NamedTuple):
    """One measurement: joints (n,) [rad] and error (m,) [px]."""

    q: Array
    e: Array


class Exploring(NamedTuple):
    """What the generator asks for: go to `target` (n,) [rad]; `number` of `total` joints is at work."""

    target: Array
    joint: int
    number: int
    total: int


class JointStuck(Exception):
    """A joint did not carry out its exploratory move."""

    def __init__(self, joint: int, moved: float) -> None:
        super().__init__(f"joint {joint} moved by only {np.degrees(moved):.2f} deg")
        self.joint, self.moved = joint, moved


Exploration = Generator[Exploring, Sample, Array]


def explore(start: Sample, joints: Sequence[Joint], use: Sequence[int], delta: float) -> Exploration:
    """Move each joint of `use` by `delta` [rad] and back, and return the (m, n) Jacobian [px/rad].

    Columns of joints that are not used are zero. The divisor is the measured motion, not the
    commanded one. A joint that is near its upper limit is moved the other way. Raises `JointStuck`.
    """
    n = len(joints)
    home = start.q.copy()
    jacobian = np.zeros((start.e.size, n))
    here = start
    for number, k in enumerate(use):
        away = home.copy()
        away[k] += _direction(here.q[k], joints[k], delta) * delta
        there = yield from _go_to(Exploring(away, k, number, len(use)), here)
        moved = there.q[k] - here.q[k]
        if abs(moved) < 0.25 * delta:
            raise JointStuck(k, moved)
        jacobian[:, k] = (there.e - here.e) / moved
        here = yield from _go_to(Exploring(home, k, number, len(use)), there)
    return jacobian


def _direction(q: float, joint: Joint, delta: float) -> float:
    room_up, room_down = joint.upper - q, q - joint.lower
    return 1.0 if room_up >= 1.5 * delta or room_up >= room_down else -1.0


def _go_to(request: Exploring, sample: Sample) -> Generator[Exploring, Sample, Sample]:
    """Ask for the target until the arm is there, or until it has stopped moving."""
    still = 0
    while still < STILL_PERIODS:
        previous = sample
        sample = yield request
        step = float(np.abs(sample.q - previous.q).max())
        if np.abs(sample.q - request.target).max() < ARRIVED_RAD:
            return sample
        still = still + 1 if step < STILL_RAD else 0
    return sample
