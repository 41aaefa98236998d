"""How far a robot under velocity control goes on by itself, learned while it moves.

Thesis eq. 5.1 takes a speed held for one period to be a joint motion, "although in practice they are
not exactly equivalent": the robot needs time to reach the speed, and to leave it. Commanded without
regard to that, a full step at a lag of three periods overshoots again and again.
"""

from __future__ import annotations

import numpy as np

from vita.types import Array

SLOWEST = 0.95
"""Largest share of its speed that a robot is taken to keep in one period without command."""
DOUBT = 1e-6
"""Squared motion [rad^2] that must have been seen before the lag counts."""
FORGET = 0.995
"""Share of the past that each period keeps."""


class Coasting:
    """Learns from commands and measured motion how one follows from the other,

        d' = a d + (1 - a - b) u + b u_before,

    with d the motion in the last period, d' in the next, u what is commanded for it (speed times
    period) and u_before what was commanded for the last one. A first-order lag and a delay of up to a
    period are of this form. Commanded to rest now, the robot would still go on by

        d + d' + ... = (a d + b u_before) / (1 - a).
    """

    def __init__(self) -> None:
        self._normal, self._right = DOUBT * np.eye(2), np.zeros(2)
        self.restart()

    def restart(self) -> None:
        """The robot has rested, or was moved by others; what has been learned of it stays."""
        self._q: Array | None = None
        self._moved = self._commanded = self._before = np.zeros(())

    @property
    def law(self) -> tuple[float, float]:
        """a and b; both zero for a robot that follows at once."""
        a, b = np.linalg.solve(self._normal, self._right)
        a = float(np.clip(a, 0.0, SLOWEST))
        return a, float(np.clip(b, -a, 1.0 - a))

    def remaining(self, q: Array) -> Array:
        """(n,) how far the robot will go on from the measured joints `q` (n,) when told to rest [rad]."""
        if self._q is not None:
            moved = q - self._q
            if self._moved.ndim:
                ahead = np.stack([self._moved - self._commanded, self._before - self._commanded])
                self._normal = FORGET * self._normal + ahead @ ahead.T + (1 - FORGET) * DOUBT * np.eye(2)
                self._right = FORGET * self._right + ahead @ (moved - self._commanded)
            self._moved = moved
        self._q = q.copy()
        if not self._moved.ndim:
            return np.zeros(q.shape)
        a, b = self.law
        return (a * self._moved + b * self._commanded) / (1.0 - a)

    def command(self, motion: Array) -> None:
        """What is commanded for the next period, (n,) speed times period [rad]."""
        self._before, self._commanded = self._commanded, motion.copy()
