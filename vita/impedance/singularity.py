"""How far the elbow is from straight, and which way leads back (TUM eq. 18 in a correct form).

The report measures from q3 = pi/2 in one place and calls q3 = 0 singular in another, and its force has no
threshold. Here the elbow's angle from straight is measured, whatever the drawing calls zero: the squared
distance from shoulder to wrist is exactly A + B cos(q_elbow - straight), so three samples give all of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.impedance.arm_model import ArmModel
from vita.types import Array

STEEPEST = np.sin(np.deg2rad(2.0))
"""Nearer to straight than this, the direction's gain grows no more: it is infinite at straight."""


@dataclass(frozen=True, eq=False)
class ElbowReach:
    """The stretch of one arm."""

    shoulder: int
    """Joint whose frame marks the shoulder."""
    elbow: int
    """The joint that bends."""
    wrist: int
    """Joint (n: the tool) whose frame marks the wrist: a point that moves rigidly with the tool."""
    straight: float
    """Elbow position at which the arm is longest [rad]."""
    swing: float
    """B above [m^2]."""
    longest: float
    """Largest distance from shoulder to wrist [m]."""

    @classmethod
    def of(cls, arm: ArmModel) -> ElbowReach | None:
        """None for an arm whose drawing names no elbow."""
        if arm.landmarks is None:
            return None
        shoulder, elbow, wrist = arm.landmarks
        q, squares = np.zeros(arm.n), []
        for angle in (0.0, np.pi / 2, np.pi):
            q[elbow] = angle
            frames = arm.frames(q)
            squares.append(float(np.sum((frames[wrist, :3, 3] - frames[shoulder, :3, 3]) ** 2)))
        mean = (squares[0] + squares[2]) / 2
        c, s = squares[0] - mean, squares[1] - mean
        swing = float(np.hypot(c, s))
        return cls(shoulder, elbow, wrist, float(np.arctan2(s, c)), swing, float(np.sqrt(mean + swing)))

    def angle(self, q: Array) -> float:
        """How far the elbow is from straight, 0 to pi [rad]."""
        off = (q[self.elbow] - self.straight + np.pi) % (2 * np.pi) - np.pi
        return float(abs(off))

    def shortening(self, onset: float) -> float:
        """Metres by which the reach shrinks per radian of bending, at an elbow bent by `onset` [m/rad]."""
        reach = np.sqrt(self.longest**2 - self.swing * (1 - np.cos(onset)))
        return float(self.swing * np.sin(onset) / (2 * reach))

    def bending(self, frames: Array, angle: float, inverse: Array, axes: Array) -> Array:
        """(6,) or (3,) d angle / d tool pose [rad/m, rad/rad]: against the unit vector from shoulder to
        wrist, at the wrist, in the tool's translation and rotation; less what the shoulder itself goes along
        where it stands off the axes before it. `inverse` (n, 6) or (n, 3) is the tool's Jacobian's, `axes`
        (3, n) the joints'."""
        shoulder, wrist = frames[self.shoulder, :3, 3], frames[self.wrist, :3, 3]
        out = wrist - shoulder
        reach = float(np.sqrt(out @ out))
        gain = -2.0 * reach / (self.swing * max(float(np.sin(angle)), STEEPEST))
        push = gain * out / reach
        x, y, z = wrist - frames[-1, :3, 3]
        a, b, c = push
        slope = np.array([a, b, c, y * c - z * b, z * a - x * c, x * b - y * a])[: inverse.shape[1]]
        first = slice(0, self.shoulder)
        return slope - lever(axes[:, first], shoulder, frames[first, :3, 3], push) @ inverse[first]


def lever(axes: Array, point: Array, origins: Array, direction: Array) -> Array:
    """(k,) speed of `point` along `direction` per turn about each of the axes (3, k) at `origins` (k, 3)."""
    a, b, c = (point - origins).T
    x, y, z = direction
    return axes[0] * (b * z - c * y) + axes[1] * (c * x - a * z) + axes[2] * (a * y - b * x)
