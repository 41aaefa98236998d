"""Lets the control loop rest while the arm does and nobody looks: an app that is left open costs little."""

from __future__ import annotations

import threading
import time

AFTER_S = 2.0
"""So long nobody must have asked for a picture or a command [s]."""
PERIOD_S = 0.5
"""How often the loop looks at the robot meanwhile, to notice what becomes of it [s]."""


class Doze:
    """Belongs to one control loop; `wake` may be called from any thread."""

    def __init__(self) -> None:
        self._wake = threading.Event()
        self._wanted_s = time.monotonic()

    def wake(self) -> None:
        """Somebody is there."""
        self._wanted_s = time.monotonic()
        self._wake.set()

    def nap(self, moving: bool) -> None:
        """Called once in each period: waits only when nothing moves and nobody has been there for a while."""
        self._wake.clear()
        if not moving and time.monotonic() - self._wanted_s > AFTER_S:
            self._wake.wait(PERIOD_S)
