"""A segment of a line, and what the line tracker reads off the samples along it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vita.types import Array


class Line:
    """A segment by its middle, angle and half length."""

    def __init__(self, middle: tuple[float, float], angle: float, half: float) -> None:
        self.middle, self.angle, self.half = middle, angle, half
        self.cos, self.sin = math.cos(angle), math.sin(angle)

    @classmethod
    def between(cls, start: Array, end: Array) -> Line:
        (u0, v0), (u1, v1) = start.tolist(), end.tolist()
        middle = ((u0 + u1) / 2, (v0 + v1) / 2)
        return cls(middle, math.atan2(v1 - v0, u1 - u0), math.hypot(u1 - u0, v1 - v0) / 2)

    def at(self, along: float, across: float) -> tuple[float, float]:
        """Pixel at these distances from the middle [px]; across is a quarter turn clockwise, as seen."""
        u, v = self.middle
        return u + along * self.cos - across * self.sin, v + along * self.sin + across * self.cos

    def moved(self, offset: float, turn: float) -> Line:
        """Shifted across by `offset` [px], then turned by `turn` [rad]."""
        return Line(self.at(0.0, offset), self.angle + turn, self.half)

    def beside(self, other: Line) -> Line:
        """This line with its middle slid to the point nearest to the other's middle."""
        du, dv = other.middle[0] - self.middle[0], other.middle[1] - self.middle[1]
        return Line(self.at(du * self.cos + dv * self.sin, 0.0), self.angle, self.half)


def slide(on: NDArray[np.bool_], before: NDArray[np.bool_], after: NDArray[np.bool_]) -> int:
    """Samples to slide along the edge so as to stay on it, where it ends within the segment.

    `on` tells which samples are on the edge, `before` and `after` the same beyond the two ends,
    from the end outwards. Zero unless the edge goes on beyond one end by what is missing at the other.
    """
    first, last = int(on.argmax()), int(on[::-1].argmax())
    if max(first, last) < 2 or min(first, last) > 0:
        return 0
    further = after if first else before
    free = len(further) if further.all() else int(further.argmin())
    return min(first, free) if first else -min(last, free)


def highest(total: Array, least: float, count: int) -> list[tuple[int, int]]:
    """Indices of the highest values, no two of them next to each other in offset; `total` is spent."""
    found = []
    for _ in range(count):
        a, o = divmod(int(total.argmax()), total.shape[1])
        if total[a, o] < least:
            break
        found.append((a, o))
        total[:, max(0, o - 3) : o + 4] = -1
    return found
