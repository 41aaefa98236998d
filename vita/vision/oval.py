"""An ellipse as trackers use it: a centre and a symmetric shape matrix."""

from __future__ import annotations

import math

import numpy as np

from vita.types import Array

_CIRCLES: dict[int, Array] = {}


def _circle(k: int) -> Array:
    """(2, k) points around the unit circle, made once."""
    if k not in _CIRCLES:
        angles = (np.arange(k) + 0.5) * (2 * math.pi / k)
        _CIRCLES[k] = np.array([np.cos(angles), np.sin(angles)])
    return _CIRCLES[k]


class Oval:
    """The points c + S u for u on the unit circle; S is symmetric and positive.

    Five numbers without a seam: a circle is no special case, as it is with axes and an angle.
    """

    def __init__(self, center: Array, shape: Array) -> None:
        self.center, self.shape = center, shape

    @classmethod
    def from_axes(cls, center: tuple[float, float], axes: tuple[float, float], angle: float) -> Oval:
        """From half axes [px] and the angle of the first one [rad]."""
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s], [s, c]])
        return cls(np.array(center, dtype=np.float64), turn @ np.diag(axes) @ turn.T)

    @property
    def diameters(self) -> tuple[float, float]:
        """Longest and shortest diameter [px]."""
        (a, b), (_, d) = self.shape.tolist()
        half, spread = (a + d) / 2, math.hypot((a - d) / 2, b)
        return 2 * (half + spread), 2 * (half - spread)

    @property
    def area(self) -> float:
        """[px^2]"""
        (a, b), (_, d) = self.shape.tolist()
        return math.pi * (a * d - b * b)

    @property
    def radius(self) -> float:
        """Of the circle with the same area [px]."""
        return math.sqrt(self.area / math.pi)

    def points(self, k: int) -> Array:
        """(k, 2) around the outline [px]."""
        return (self.center[:, None] + self.shape @ _circle(k)).T

    def samples(self, k: int) -> tuple[Array, Array, Array]:
        """(k, 2) points of the outline, (k, 2) outward unit normals there, (2, k) their unit circle."""
        circle = _circle(k)
        (a, b), (_, d) = self.shape.tolist()
        normals = np.array([[d, -b], [-b, a]]) @ circle
        normals = normals / np.sqrt(normals[0] * normals[0] + normals[1] * normals[1])
        return (self.center[:, None] + self.shape @ circle).T, normals.T, circle

    def motions(self, normals: Array, circle: Array) -> Array:
        """(5, k) motion of the outline along its normals per unit of each of the five numbers."""
        nx, ny = normals.T
        x, y = circle
        return np.array([nx, ny, nx * x, nx * y + ny * x, ny * y])

    def changed(self, step: Array) -> Oval | None:
        """With its five numbers changed by `step`; None when that is no ellipse any more."""
        du, dv, a, b, d = step.tolist()
        shape = self.shape + np.array([[a, b], [b, d]])
        moved = Oval(self.center + (du, dv), shape)
        longest, shortest = moved.diameters
        return moved if math.isfinite(longest) and shortest > max(3.0, 0.1 * longest) else None

    def shifted(self, by: Array) -> Oval:
        return Oval(self.center + by, self.shape)

    def contains(self, pixel: Array) -> bool:
        """Whether a pixel lies in it."""
        x = np.linalg.solve(self.shape, pixel - self.center)
        return bool(x @ x < 1.0)
