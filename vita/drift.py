"""Does a feature slide off what it was put on? Finds trackers that drift, a little in every picture.

A check from one picture to the next cannot: a few pixels are within what the joints may have done, and a
model that learns takes the drift for motion of the arm. Here a filter for each feature has a speed of its
own beside what the joints do to it. While the joints' share can explain what is seen, that speed stays
unsure; as soon as the arm slows down or turns, only a drift is left.

Not every speed is a fault. Goals may move, so only features are judged that were seen to be carried by the
arm while it explored; and what all features of a view have in common is the camera's motion, or the object's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vita.types import Array

NOISE_PX = 0.4
"""Noise of a tracker."""
CHANGE = 1.4
"""How fast a feature's motion per joint changes, relative to itself [1/rad]: more than it does, because the
changes of one motion point the same way and those of this model do not."""
TURN_PX = 0.1
"""How much a drift may change from one period to the next."""
UNKNOWN_PX, FASTEST_PX = 1000.0, 3.0
"""What a radian may do before anything is learned [px/rad], and a period's drift."""
SIGMAS, LEAST_PX = 4.0, 0.5
"""A drift is one when it is so sure, and at least so fast in each period."""
EXPLAINED, CARRIED_PX = 1.5, 5.0
"""A feature is carried by the arm when the joints explain so many times what they leave unexplained (in
squares), and so much motion altogether (root of the sum of squares)."""

Mask = NDArray[np.bool_]


class DriftWatch:
    """Watches T features over one run: `update` once per control period.

    The state of each is its place, its motion per joint, and its drift; the two image axes share a
    covariance.
    """

    def __init__(self, uv: Array, q: Array) -> None:
        """`uv` (T, 2) [px] at joints `q` (n,) [rad]."""
        count, n = len(uv), len(q)
        self._q, self._joints = q.copy(), slice(1, n + 1)
        self._x = np.zeros((count, 2, n + 2))
        self._x[:, :, 0] = uv
        self._p = np.tile(np.diag([NOISE_PX**2, *[UNKNOWN_PX**2] * n, FASTEST_PX**2]), (count, 1, 1))
        self._explored, self._by_none = np.zeros((n, n)), np.zeros(count)
        self.carried: Mask = np.zeros(count, bool)
        """(T,) which features were seen to move with the arm while it explored."""

    def update(self, q: Array, uv: Array, seen: Mask, exploring: bool) -> None:
        """Take the places `uv` (T, 2) [px] at joints `q` (n,) [rad]; only those of the mask `seen` (T,)."""
        dq, self._q = q - self._q, q.copy()
        x, p, joints = self._x, self._p, self._joints
        step = np.concatenate([[1.0], dq, [1.0]])
        x[:, :, 0] = x @ step
        # Where it is depends on all that was unsure about how it moves.
        cross = p @ step
        p[:, 0, :], p[:, :, 0] = cross, cross
        p[:, 0, 0] = cross @ step
        size = np.square(x[:, :, joints]).mean(axis=(1, 2))
        inner = np.arange(joints.start, joints.stop)
        p[:, inner, inner] += (size * CHANGE**2 * float(dq @ dq))[:, None]
        p[:, -1, -1] += TURN_PX**2
        rest = np.where(seen[:, None], uv - x[:, :, 0], 0.0)
        spread = p[:, 0, 0] + NOISE_PX**2
        known = seen * np.minimum(2 * NOISE_PX**2 / spread, 1.0)
        gain = p[:, :, 0] / spread[:, None] * seen[:, None]
        x += rest[:, :, None] * gain[:, None, :]
        p -= gain[:, :, None] * p[:, 0, :][:, None, :]
        if exploring:
            self._explored += np.outer(dq, dq)
            # What was not foreseen because nothing was known yet speaks neither for nor against.
            self._by_none += known * np.square(rest).sum(axis=1)
            rows = x[:, :, joints]
            by_joints = (rows @ self._explored * rows).sum(axis=(1, 2))
            self.carried = by_joints > np.maximum(EXPLAINED * self._by_none, CARRIED_PX**2)

    def drifting(self, views: Sequence[str], carried: Mask, alone: bool = True) -> int | None:
        """The feature that drifts most surely, or none. `views` names each one's camera; `alone` whether one
        without others of its view to compare it with is judged too."""
        drift = self._x[:, :, -1]
        sure, worst = SIGMAS, None
        for i in map(int, np.flatnonzero(carried)):
            others = [j for j in map(int, np.flatnonzero(carried)) if j != i and views[j] == views[i]]
            speed = float(np.hypot(*drift[i]))
            if others:  # Against the one that moves most like it.
                speed = min(speed, float(np.hypot(*(drift[others] - drift[i]).T).min()))
            elif not alone:
                continue
            surely = speed / np.sqrt(self._p[i, -1, -1])
            if speed > LEAST_PX and surely > sure:
                sure, worst = surely, i
        return worst
