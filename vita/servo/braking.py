"""How fast one may be in order to come to rest in time, and straight ways on which all joints do.

Moving at v for one cycle and then losing a*dt in each, the path is dt*(v + (v - a*dt) + ...).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vita.types import Array

ARRIVED_RAD = 1e-12
"""Nearer to the target than this counts as there, or rounding would keep the arm twitching [rad]."""


def braking_speed(distance: Array, acceleration: float, dt: float) -> Array:
    """The highest speed from which one can still stop within `distance` [rad/s].

    With m terms the path fits into d exactly when v = d/(m*dt) + (m - 1)*a*dt/2, and m is the smallest
    whole number with m*(m + 1)/2*a*dt^2 >= d. (The usual closed form,
    a*dt*(sqrt(1/4 + 2(d - a*dt^2/8)/(a*dt^2)) - 1/2), is a lower bound of this that turns negative
    within a*dt^2/8 of the goal; the exact form comes to rest on it.)

    distance: (n,) at least 0 [rad].
    """
    m = np.maximum(np.ceil(np.sqrt(0.25 + distance * (2.0 / (acceleration * dt * dt))) - 0.5), 1.0)
    return distance / (m * dt) + (m - 1.0) * (0.5 * acceleration * dt)


def braking_path(speed: float, acceleration: float, dt: float) -> float:
    """The path on which one comes to rest from a speed above 0, the inverse of `braking_speed` [rad]."""
    m = math.ceil(speed / (acceleration * dt))
    return dt * (m * speed - 0.5 * m * (m - 1) * acceleration * dt)


def clip(values: Array, low: Array, high: Array) -> Array:
    """`numpy.clip`, which takes five times as long for a handful of joints."""
    return np.minimum(np.maximum(values, low), high)


class Motion(NamedTuple):
    """A straight motion from now on."""

    speed: Array
    """(n,) for this cycle [rad/s]."""
    saturated: NDArray[np.bool_]
    """(n,) joints that a limit keeps from going where they are wanted."""


class Bounds(NamedTuple):
    """What a motion has to keep."""

    low: Array
    """(n,) lowest position [rad]."""
    high: Array
    """(n,) highest position [rad]."""
    speed: Array
    """(n,) highest speed; a joint with 0 may not move and holds up no other [rad/s]."""
    scale: float
    """Share of `speed` that may be used."""
    acceleration: float
    """[rad/s^2]."""


def toward(target: Array, q: Array, v: Array, bounds: Bounds, left_s: float, dt: float) -> Motion:
    """Straight from q (n,), moving at v, to the target, all joints arriving together, and not before `left_s`
    has passed."""
    low, high, speed, scale, a = bounds
    # Aim for where the straight line leaves the limits. A joint that stands at its limit and is asked to go
    # on is left out, or it would hold all others for nothing.
    reachable = clip(target, np.minimum(low, q), np.maximum(high, q))
    saturated = np.abs(target - reachable) > 1e-9
    room = np.abs(reachable - q)
    way = np.where(room < ARRIVED_RAD, 0.0, target - q)
    if saturated.any():
        way *= np.divide(room, np.abs(way), out=np.ones(len(q)), where=way != 0.0).min()
    distance = np.abs(way)
    brake = braking_speed(distance, a, dt)
    # Joints that have arrived, or that may not move at all, do not set the pace of the others.
    paced = (distance > 0.0) & (speed > 0.0)
    top = np.minimum(brake, speed * scale)
    rates = np.divide(top, distance, out=np.full(len(q), 1.0 / dt), where=paced)
    change = way * min(float(rates.min()), 1.0 / max(left_s, dt)) - v
    # One common share of the wanted change keeps the path straight while speeding up, too.
    largest = float(np.abs(change).max())
    if largest > a * dt:
        change *= a * dt / largest
    # A joint still on its way from an older target must not overshoot the new one, and one that moves away
    # from it brakes as hard as it may.
    lowest = np.where(way < 0.0, -brake, 0.0)
    highest = np.where(way > 0.0, brake, 0.0)
    return Motion(clip(v + change, lowest, highest), saturated)
