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
CARRIED_OUT = 0.25
"""Share of a motion below which the joint counts as stuck."""

PROBE_RAD = np.radians(0.5)
"""First motion of a joint whose effect on the image is not known yet."""
LARGEST_RAD = np.radians(15.0)
"""A joint is not moved farther to see the features move."""
NEAR_ENOUGH = 0.15
"""Feature motion may differ from what is wanted by this share."""
FASTER = 4.0
"""Each try may be so many times as large as the last: a probe inside the noise proves little."""
TRIES = 8
EFFECT_SIGMAS = 3.0
"""A joint that changes no error row by more than so many deviations has shown no effect."""
LARGER_TRIES = 3
"""So often is its motion doubled before it is given up."""


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
Move = Generator[Exploring, Sample, Sample]


def explore(
    start: Sample,
    joints: Sequence[Joint],
    use: Sequence[int],
    delta: float | Sequence[float] | Array,
    *,
    central: bool = False,
    want_px: float = 0.0,
    log: list[Sample] | None = None,
    sigma: float = 0.0,
    idle: list[int] | None = None,
) -> Exploration:
    """Move each joint of `use` by `delta` [rad] and back, and return the (m, n) Jacobian [px/rad].

    `delta` is one size for all joints or one for each of the n. With `want_px` > 0 each joint goes on
    instead until some error row has changed by about that much. `central` moves to both sides of the
    start, which makes the quotient exact to second order. Every sample that was arrived at is added to
    `log`, the start first.

    With the noise `sigma` [px] of an error row a joint that moves no row out of it is moved farther, to the
    other side where there is more room, before it is given up and added to `idle`.

    Columns of joints that are not used are zero. The divisor is the measured motion, not the
    commanded one. A joint that is near its upper limit is moved the other way. Raises `JointStuck`.
    """
    n = len(joints)
    log = [] if log is None else log
    log.append(start)
    home = start.q.copy()
    sizes = np.broadcast_to(np.asarray(delta, float), (n,))
    jacobian = np.zeros((start.e.size, n))
    here = start
    for number, k in enumerate(use):
        back = Exploring(home, k, number, len(use))
        if want_px > 0.0:
            there = yield from _until_seen(back, here, joints[k], want_px, log)
        else:
            by = _direction(here.q[k], joints[k], sizes[k]) * sizes[k]
            there = yield from _move(back, here, here, _inside(joints[k], home[k], by), log)
            if sigma > 0.0 and not _seen(there, here, sigma):
                there, seen = yield from _farther(back, there, here, joints[k], by, sigma, log)
                if not seen and idle is not None:
                    idle.append(k)
        last, other = there, here
        if central:
            by = _inside(joints[k], home[k], here.q[k] - there.q[k])
            if abs(by) >= CARRIED_OUT * abs(there.q[k] - here.q[k]):  # Else a limit is too near.
                last = other = yield from _move(back, there, here, by, log)
        jacobian[:, k] = (there.e - other.e) / (there.q[k] - other.q[k])
        here = yield from _go_to(back, last)
        log.append(here)
    return jacobian


def sizes_of(log: Sequence[Sample], n: int) -> Array:
    """(n,) how far each joint was moved from the first sample of an exploration's `log` [rad]."""
    away = np.abs(np.array([sample.q for sample in log]) - log[0].q)
    return away.max(axis=0) if len(log) else np.zeros(n)


def _move(back: Exploring, last: Sample, home: Sample, by: float, log: list[Sample]) -> Move:
    """Move the joint to `by` [rad] from home, coming from `last`; the other joints stay there."""
    away = back.target.copy()
    away[back.joint] += by
    there = yield from _go_to(back._replace(target=away), last)
    moved = there.q[back.joint] - home.q[back.joint]
    if abs(moved) < max(CARRIED_OUT * abs(by), ARRIVED_RAD):
        raise JointStuck(back.joint, moved)
    log.append(there)
    return there


def _seen(there: Sample, here: Sample, sigma: float) -> bool:
    """Whether some row changed by more than the noise of two readings can explain."""
    change = np.abs(there.e - here.e)
    return float(change[np.isfinite(change)].max(initial=0.0)) > EFFECT_SIGMAS * np.sqrt(2.0) * sigma


def _farther(
    back: Exploring, last: Sample, home: Sample, joint: Joint, by: float, sigma: float, log: list[Sample]
) -> Generator[Exploring, Sample, tuple[Sample, bool]]:
    """Twice as far, a few times over; the other way round where a limit comes first."""
    there, q = last, float(home.q[back.joint])
    for _ in range(LARGER_TRIES):
        by = float(np.clip(2.0 * by, -LARGEST_RAD, LARGEST_RAD))
        moved = max((_inside(joint, q, side * by) for side in (1.0, -1.0)), key=abs)
        if abs(moved) <= 1.1 * abs(there.q[back.joint] - q):
            break  # There is no more room.
        there = yield from _move(back, there, home, moved, log)
        if _seen(there, home, sigma):
            return there, True
    return there, False


def _until_seen(back: Exploring, home: Sample, joint: Joint, want_px: float, log: list[Sample]) -> Move:
    """Move the joint until the row that moves most has moved by `want_px`, or as far as it may.

    Each try takes the image motion to grow with the joint's, so that a few tries are enough.
    """
    side = _direction(home.q[back.joint], joint, LARGEST_RAD)
    most = abs(_inside(joint, home.q[back.joint], side * LARGEST_RAD))
    size, there = min(PROBE_RAD, most), home
    for _ in range(TRIES):
        there = yield from _move(back, there, home, side * size, log)
        moved_px = np.abs(there.e - home.e)
        seen_px = float(moved_px[np.isfinite(moved_px)].max(initial=0.0))
        at_most = size >= most and seen_px < want_px
        if at_most or abs(seen_px - want_px) < NEAR_ENOUGH * want_px:
            break
        size = min(size * min(want_px / max(seen_px, 1e-9), FASTER), most)
    return there


def _direction(q: float, joint: Joint, delta: float) -> float:
    room_up, room_down = joint.upper - q, q - joint.lower
    return 1.0 if room_up >= 1.5 * delta or room_up >= room_down else -1.0


def _inside(joint: Joint, q: float, by: float) -> float:
    """`by`, cut so that the joint stays within its limits."""
    return float(np.clip(q + by, min(joint.lower, q), max(joint.upper, q)) - q)


def _go_to(request: Exploring, sample: Sample) -> Move:
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
