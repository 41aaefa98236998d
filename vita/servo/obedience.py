"""Does each joint go where it was sent? Commanded against measured motion, without any image.

A joint whose sign is wrong somewhere between servo and motor runs away from its goal, faster and faster,
and no estimator can help: it only ever sees that image and measured joints agree.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from vita.types import Array

LATE_PERIODS = 3
"""A rig may answer so late: a joint disobeys only when it goes against all of the last commands."""
WRONG_PERIODS = 2
"""So many periods on end, and without slowing down: an arm that is told to turn back slows down first."""
LEAST_RAD = 3e-4
"""Less motion or command in a period is rounding, play and shaking [rad]."""
LEAST_SHARE = 0.1
"""Nor does a joint count that moves less than this share of the fastest."""
SLOWING = 0.9
"""A joint that keeps less than this share of its speed is slowing down."""


class Obedience:
    """Watches a run: each period `update` with what is measured, then `asked` with what is asked."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """The arm has rested, or was moved by others."""
        self._asked: deque[Array] = deque(maxlen=LATE_PERIODS)
        self._q: Array | None = None
        self._moved: Array | None = None
        self._wrong = np.zeros(0, int)

    def asked(self, dq: Array) -> None:
        """The motion (n,) that is asked for now [rad]."""
        self._asked.append(dq.copy())

    def update(self, q: Array) -> list[int]:
        """The joints that run the wrong way, from the measured positions `q` (n,) [rad]."""
        q0, self._q = self._q, q.copy()
        if q0 is None or q0.size != q.size:
            return []
        moved, before = q - q0, self._moved
        self._moved = moved
        if before is None or len(self._asked) < LATE_PERIODS:
            self._wrong = np.zeros(q.size, int)
            return []
        size = np.abs(moved)
        asked = np.array(self._asked)
        against = (asked * moved < 0.0).all(axis=0) & (np.abs(asked).min(axis=0) > LEAST_RAD)
        clear = (size > LEAST_RAD) & (size > LEAST_SHARE * size.max())
        going_on = (before * moved > 0.0) & (size > SLOWING * np.abs(before))
        self._wrong = np.where(against & clear & going_on, self._wrong + 1, 0)
        return [int(j) for j in np.flatnonzero(self._wrong >= WRONG_PERIODS)]
