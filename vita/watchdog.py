"""Notices a control loop that hangs: its count of beats stands still for longer than its work may take.

The gate needs none of this: it brakes as soon as commands stay away. This is about saying so, and about a
way out.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from typing import Protocol

log = logging.getLogger("vita.watchdog")
PERIOD_S = 0.02
HUNG_S = 0.5
"""A period's work may take so long while the arm moves, the wait for pictures not counted [s]. The arm rests
long before, because the permission to move has ended at the gate; a machine that is busy is no fault."""
HUNG_AT_REST_S = 2.0
WAIT_S = 3.0
"""A rig says within a second that no picture came; one that does not has hung itself [s]."""
COMMAND_S = 5.0
"""What people ask for may take so long while the arm moves. At rest it may load a whole scene [s]."""
DOING = {
    "observe": "waiting for pictures",
    "work": "reading the pictures",
    "track": "tracking",
    "servo": "computing or sending the next step",
    "publish": "publishing what it saw",
    "": "carrying out a command",
}
"""Phase of a tick in words."""


class Beating(Protocol):
    """What is watched: `vita.engine.Engine`."""

    phase: str
    beats: int

    @property
    def moving(self) -> bool: ...


def limit_s(phase: str, moving: bool) -> float:
    """How long a phase may take [s]."""
    if phase == "observe":
        return WAIT_S
    if phase == "":
        return COMMAND_S if moving else float("inf")
    return HUNG_S if moving else HUNG_AT_REST_S


class Watchdog:
    """Looks every `PERIOD_S`, in a thread of its own, and calls `stuck` once for every hang."""

    def __init__(
        self,
        watched: Callable[[], Beating],
        stuck: Callable[[Beating, str, float], None],
        each: Callable[[], None] = lambda: None,
        start: bool = True,
    ) -> None:
        """
        stuck: is told what hangs, doing what, and for how many milliseconds.
        each: is called after every look.
        """
        self._watched, self._stuck, self._each = watched, stuck, each
        self._last: tuple[int, int] | None = None
        self._still_s, self._told = 0.0, False
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="vita-watchdog", daemon=True)
        if start:
            self._thread.start()

    def look(self, elapsed_s: float) -> None:
        """One look, `elapsed_s` after the last one.

        A look that comes late itself counts as two periods at most: whatever kept this thread waiting (a
        machine that sleeps, another thread that holds the interpreter) has kept the watched one waiting, too.
        """
        watched = self._watched()
        beat = id(watched), watched.beats
        if beat != self._last:
            self._last, self._still_s, self._told = beat, 0.0, False
            return
        self._still_s += min(elapsed_s, 2 * PERIOD_S)
        phase = watched.phase
        if not self._told and self._still_s > limit_s(phase, watched.moving):
            self._told = True
            self._stuck(watched, DOING.get(phase, phase), 1e3 * self._still_s)

    def close(self) -> None:
        """End the thread. Idempotent."""
        self._closing.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout=1.0)

    def _run(self) -> None:
        last = time.monotonic()
        while not self._closing.wait(PERIOD_S):
            now = time.monotonic()
            try:
                self.look(now - last)
                self._each()
            except Exception:
                log.exception("the watchdog failed")
            last = now
