"""Notices a servo that presses a joint against its limit to no avail."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vita.types import Array

PERIODS = 15
"""Control periods in a row without progress [1/30 s each]."""
BETTER = 0.98
"""An error below so much of the best so far is progress."""
STILL_RAD = 0.002
"""An arm that has moved more than this since the last progress is still on its way [rad]."""


class Pressed:
    """Names the joint that a limit has held for a while, with the arm at rest and the error no less."""

    def __init__(self) -> None:
        self._count = 0
        self._best = np.inf
        self._q: Array | None = None

    def update(self, held: Sequence[int], norm_px: float, q: Array) -> int | None:
        """held: indices of the joints that a limit keeps from going where they are asked to."""
        moved = self._q is None or float(np.abs(q - self._q).max()) > STILL_RAD
        if not held or moved or not norm_px >= BETTER * self._best:
            self._count, self._best, self._q = 0, norm_px, np.array(q)
            return None
        self._count += 1
        return int(held[0]) if self._count >= PERIODS else None
