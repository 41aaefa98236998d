"""How fast people and obstacles move, from one look to the next."""

from __future__ import annotations

import numpy as np

from vita.impedance.clearance import Obstacles
from vita.impedance.surroundings import Surroundings
from vita.types import Array


class Sightings:
    """Remembers where each part of each body was."""

    def __init__(self) -> None:
        self._seen: dict[str, list[tuple[Array, Array]]] = {}

    def take(self, around: Surroundings, duration_s: float) -> Obstacles:
        """The capsules with the velocities of their ends, as told or from the last call to this one."""
        starts = np.array([c.start for c in around.capsules], dtype=float).reshape(-1, 3)
        ends = np.array([c.end for c in around.capsules], dtype=float).reshape(-1, 3)
        radii = np.array([c.radius for c in around.capsules], dtype=float)
        if around.velocities is not None:
            told = np.array(around.velocities, dtype=float).reshape(-1, 3)
            return Obstacles(starts, ends, radii, told, told)
        seen: dict[str, list[tuple[Array, Array]]] = {}
        moved = np.zeros((2, len(radii), 3))
        for i, capsule in enumerate(around.capsules):
            parts, old = seen.setdefault(capsule.body, []), self._seen.get(capsule.body, [])
            if len(old) > len(parts):
                was = old[len(parts)]
                moved[:, i] = starts[i] - was[0], ends[i] - was[1]
            parts.append((starts[i], ends[i]))
        self._seen = seen
        return Obstacles(starts, ends, radii, moved[0] / duration_s, moved[1] / duration_s)
