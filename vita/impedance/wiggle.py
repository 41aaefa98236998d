"""The small motion by which the arm learns where the cameras stand (TUM IV-B, figure 7 d)."""

from __future__ import annotations

import numpy as np

from vita.impedance.dynamics import Goal
from vita.types import Array

WAYS = np.array(
    [
        [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0.7, 0.7, 0.7], [0.7, -0.7, 0],
        [-0.7, 0.7, 0.7],
    ]
)
"""Way-points about the start, in units of the size: all directions, upwards rather than down."""
NEAR_M = 0.006
"""A way-point counts as reached within this [m]."""
EACH_S = 0.9
"""A way-point that is not reached in this time is left out: something keeps the arm away from it [s]."""
ROUNDS = 2
"""After so many rounds without a result it is given up."""


class Wiggle:
    """Goals about the place where it starts; the tool keeps its orientation."""

    def __init__(self, T_base_tool: Array, size_m: float, stamp: float) -> None:
        self._start = np.array(T_base_tool)
        self._size = size_m
        self._number = 0
        self._since = stamp

    @property
    def round(self) -> int:
        """How often all way-points have been visited."""
        return self._number // len(WAYS)

    @property
    def progress(self) -> float:
        """Share of the first round, 0 to 1."""
        return min(self._number / len(WAYS), 1.0)

    @property
    def over(self) -> bool:
        """Whether it has run for long enough to say that it does not help."""
        return self.round >= ROUNDS

    def goal(self, stamp: float, position: Array) -> Goal:
        """Where the tool is to go; `position` (3,) is where it is [m]."""
        there = np.linalg.norm(self._point() - position) < NEAR_M
        if there or stamp - self._since > EACH_S:
            self._number, self._since = self._number + 1, stamp
        T = self._start.copy()
        T[:3, 3] = self._point()
        return Goal(T, np.zeros(3), np.zeros(3))

    def _point(self) -> Array:
        return self._start[:3, 3] + self._size * WAYS[self._number % len(WAYS)]
