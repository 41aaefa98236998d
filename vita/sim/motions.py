"""How things of the scene move: from one placement to another, or carried on and on. Poses as functions of
time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vita.types import Array

START_S = 1.0
"""Time in which what is carried gets up to speed, and comes to rest at the end [s]."""
TURN_DEG = 20.0
"""How far it turns to each side [deg]."""
TURN_AXIS = np.array([1.0, 2.0, 1.0]) / np.sqrt(6.0)
"""The axis in the object's frame about which it turns: on a plate mostly the upright one, with a share of
the others."""


@dataclass(frozen=True, eq=False)
class Motion:
    """A smooth way from one placement to another, turning the short way round; at rest at both ends."""

    start: Array
    """(4, 4) pose at `begin_s`."""
    end: Array
    """(4, 4) pose from `begin_s + over_s` on."""
    begin_s: float
    over_s: float

    def at(self, now: float) -> Array:
        """(4, 4) pose at `now` [s] along a minimum-jerk profile."""
        x = 1.0 if self.over_s <= 0 else float(np.clip((now - self.begin_s) / self.over_s, 0.0, 1.0))
        if x >= 1.0:
            return self.end.copy()
        share = x**3 * (10 - 15 * x + 6 * x * x)
        T = self.start.copy()
        T[:3, 3] += share * (self.end[:3, 3] - self.start[:3, 3])
        if not np.array_equal(self.start[:3, :3], self.end[:3, :3]):
            turn = Rotation.from_matrix(self.start[:3, :3].T @ self.end[:3, :3]).as_rotvec()
            T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(share * turn).as_matrix()
        return T


@dataclass(frozen=True, eq=False)
class Carry:
    """A way about `start` in the object's own xy plane, while it turns to and fro.

    All of it is an analytic function of one phase, whose speed rises from 0 to 1 and falls again.
    """

    start: Array
    """(4, 4) pose at `begin_s`, to which the way belongs."""
    path: str
    """`circle` of `radius_m` about the start, reached on a spiral; `line` of `length_m` along x, to and
    fro; `wave`, a lying eight of `length_m` by twice `radius_m`."""
    radius_m: float
    length_m: float
    speed_m_s: float
    """Speed on the circle; the highest speed on the others."""
    turn_deg_s: float
    """The highest speed of turning."""
    begin_s: float
    for_s: float

    def at(self, now: float) -> Array:
        """(4, 4) pose at `now` [s]."""
        phase = self._phase(now - self.begin_s)
        T = self.start.copy()
        T[:3, 3] += self.start[:3, :2] @ self._way(phase)
        if self.turn_deg_s > 0:
            angle = TURN_DEG * np.sin(self.turn_deg_s / TURN_DEG * phase)
            T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(np.radians(angle) * TURN_AXIS).as_matrix()
        return T

    def _phase(self, t: float) -> float:
        """Time at full speed that would lead as far as `t` [s] with a smooth start and end."""
        soft = min(START_S, 0.5 * self.for_s)
        if soft <= 0 or t <= 0:
            return 0.0
        if t > 0.5 * self.for_s:
            return self.for_s - soft - self._phase(self.for_s - t)
        x = min(t / soft, 1.0)
        return soft * (x**3 - 0.5 * x**4) + max(t - soft, 0.0)

    def _way(self, phase: float) -> Array:
        """(2,) place in the plane [m]."""
        half = 0.5 * self.length_m
        height = 0.0 if self.path == "line" else self.radius_m
        # The size that makes the highest speed that of the settings.
        size = self.radius_m if self.path == "circle" else float(np.hypot(half, 2 * height))
        if size == 0 or self.speed_m_s == 0:
            return np.zeros(2)
        angle = phase * self.speed_m_s / size
        if self.path != "circle":
            return np.array([half * np.sin(angle), height * np.sin(2 * angle)])
        # The spiral takes so long that it is nowhere faster than the circle.
        x = min(0.25 * angle, 1.0)
        return size * x**3 * (10 - 15 * x + 6 * x * x) * np.array([np.cos(angle), np.sin(angle)])
