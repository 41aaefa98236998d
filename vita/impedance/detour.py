"""The way around what stands between the mass and its goal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vita.impedance.surroundings import Nearness
from vita.types import Array


class Detour:
    """Keeps to its side while the thing is near, so that the mass does not waver."""

    def __init__(self) -> None:
        self._aside: Array | None = None

    def look(
        self, near: Nearness, place: Sequence[float], goal: Sequence[float] | None, share: float
    ) -> tuple[list[float], float] | None:
        """Which way leads around the nearest of the people in the way, (3,) unit vector, and how hard to
        steer there [N]; None where nothing is in the way. `place` and `goal` (3,) are those of the mass [m],
        `share` is the part of the repulsion that acts sideways."""
        if near.passing is None or goal is None or share == 0.0:
            self._aside = None
            return None
        normal, push = near.passing
        off = np.subtract(goal, place)
        size, towards = float(np.linalg.norm(off)), float(off @ normal)
        if towards >= 0.0:
            self._aside = None
            return None
        wanted = off if self._aside is None else off + 0.5 * size * self._aside
        across = wanted - (wanted @ normal) * normal
        far = float(np.linalg.norm(across))
        if far < 1e-3 * size:
            # Head-on: any side will do, so one on which the mass gets around at the same height.
            across = np.array([-normal[1], normal[0], 0.0]) if abs(normal[2]) < 0.9 else np.array([1.0, 0, 0])
            across = across - (across @ normal) * normal
            far = float(np.linalg.norm(across))
        aside = self._aside = across / far
        return aside.tolist(), share * push
