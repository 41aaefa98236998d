"""Watches a run and says when it is over, for better or worse.

Each monitor looks at the recent past only and knows nothing of images or robots.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from vita.types import Array

CONVERGED_PERIODS = 3
FOLLOWED_PERIODS = 45
"""A goal that may move by itself must have been met for longer before the arm stops following it."""
DIVERGED_PERIODS = 3
DIVERGED_JUMP_PX = 100.0
"""The thesis' rule: an error that grows by so much in one step is lost."""
STALL_PERIODS = 60
DEAD_BAND_PERIODS = 10
SWINGS, SWING_PERIODS = 3, 20
"""So often must the error have turned over within so many periods: once or twice is an overshoot."""
FADING = 0.8
"""What a period leaves of the last swing's far end, lest the long way to the goal count as one."""
SWING_SIGMAS = 4.0
"""Errors that are smaller than so many deviations of the noise are no swing."""


class Convergence:
    """True once every component has been within the tolerance for a few periods."""

    def __init__(self) -> None:
        self._count = 0

    def update(self, largest_px: float, tolerance_px: float, periods: int = CONVERGED_PERIODS) -> bool:
        self._count = self._count + 1 if largest_px <= tolerance_px else 0
        return self._count >= periods


class Divergence:
    """True when the error is well above its best for a few periods, or leaps in one."""

    def __init__(self) -> None:
        self.best = float("inf")
        self._last = float("inf")
        self._count = 0

    def update(self, norm_px: float) -> bool:
        leap = norm_px - self._last > DIVERGED_JUMP_PX
        self.best, self._last = min(self.best, norm_px), norm_px
        self._count = self._count + 1 if norm_px > 1.5 * self.best + 10.0 else 0
        return leap or self._count >= DIVERGED_PERIODS


class Stall:
    """True when neither the error nor the arm has got anywhere for a while.

    A slow arm on a long way makes little progress in the image but travels; it is not stalled.
    """

    def __init__(self) -> None:
        self._past: deque[tuple[float, Array]] = deque(maxlen=STALL_PERIODS)

    def update(self, norm_px: float, q: Array) -> bool:
        self._past.append((norm_px, q))
        if len(self._past) < STALL_PERIODS:
            return False
        errors = [norm for norm, _ in self._past]
        half = STALL_PERIODS // 2
        better = min(errors[half:]) < 0.95 * min(errors[:half])
        travelled = float(np.abs(self._past[-1][1] - self._past[0][1]).max())
        return not better and travelled < 0.01


class DeadBand:
    """True when the arm is asked to move and does not, at all (thesis 5.1.3)."""

    def __init__(self) -> None:
        self._count = 0
        self._last: Array | None = None

    def update(self, q: Array, dq: Array) -> bool:
        moved = self._last is None or float(np.abs(q - self._last).max()) > 1e-6
        asked = float(np.abs(dq).max(initial=0.0)) > 1e-6
        self._last = q
        self._count = self._count + 1 if asked and not moved else 0
        return self._count >= DEAD_BAND_PERIODS

    def restart(self) -> None:
        self._count = 0


class Oscillation:
    """True when the error goes to and fro: the arm overshoots its goal again and again.

    An arm without mass would overshoot in every period; one that has to slow down first swings more
    slowly. What both do is that the error turns over. Only errors that stand out of the noise count.
    """

    def __init__(self) -> None:
        self._side: Array | None = None
        """The error at the far end of the last swing (m,), fading [px]."""
        self._periods = 0
        self._swings: deque[int] = deque(maxlen=SWINGS)

    def update(self, error: Array, sigma_px: float) -> bool:
        """Take the error (m,) [px], NaN in rows that are not seen, and the noise of a row."""
        self._periods += 1
        error = np.where(np.isfinite(error), error, 0.0)
        size = float(np.linalg.norm(error))
        if size < SWING_SIGMAS * sigma_px * np.sqrt(error.size):
            return False
        if self._side is None or self._side.shape != error.shape:
            self._side = error
            return False
        self._side = FADING * self._side
        along, far = float(error @ self._side), float(np.linalg.norm(self._side))
        if along < -0.5 * size * far:
            self._swings.append(self._periods)
            self._side = error
        elif size > far:
            self._side = error
        return len(self._swings) == SWINGS and self._swings[-1] - self._swings[0] <= SWING_PERIODS
