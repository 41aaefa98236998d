"""`vita stop`: stop the arm past the app, with a signal to the process that has the gate."""

from __future__ import annotations

import os
import signal
import sys
import time

from vita.run_file import Running, running
from vita.sim.shared_frames import Flags

PATIENCE_S = 2.0
NOTHING_RUNS, NOT_CONFIRMED = 3, 1


def stop(port: int | None = None, emergency: bool = False) -> int:
    """Stop the arm of the app on `port`, or of every app of this user, and see that it rests.

    Returns the exit code: 0 it rests, 1 it has not said so, 3 nothing runs there.
    """
    everyone = running()
    found = [entry for entry in everyone if port in (None, entry.port)]
    if not found:
        where = "" if port is None else f" on port {port}"
        others = ", ".join(str(entry.port) for entry in everyone)
        hint = f"; there is one on {others} (--port)" if others else ""
        print(f"vita: no app runs{where}{hint}", file=sys.stderr)
        return NOTHING_RUNS
    # Everyone is told before anyone is waited for.
    told = [_Told(entry, emergency) for entry in found]
    return max(one.confirm() for one in told)


class _Told:
    """One arm that was told to stop."""

    def __init__(self, entry: Running, emergency: bool) -> None:
        self._entry, self._emergency = entry, emergency
        self._cause = "emergency" if emergency else "stop"
        self._began = time.monotonic()
        self._flags: Flags | None = None
        self._before = 0
        if not entry.child_lives:
            return
        try:
            self._flags = Flags(entry.memory)
            self._before = self._flags.latched()[self._cause]
        except (OSError, ValueError):
            pass  # It cannot be watched, but it can be told.
        try:
            os.kill(entry.child, signal.SIGUSR2 if emergency else signal.SIGUSR1)
        except ProcessLookupError:
            self._close()

    def confirm(self) -> int:
        """Wait until it rests; say so; the exit code."""
        name = f"vita on port {self._entry.port}"
        try:
            if not self._rests():
                print(f"{name} was told to stop but has not said that the arm rests", file=sys.stderr)
                return NOT_CONFIRMED
        finally:
            self._close()
        if not self._entry.child_lives:
            print(f"{name}: nothing moves, its simulation has ended")
            return 0
        after = 1e3 * (time.monotonic() - self._began)
        then = "Reset at the page, confirm, then Start" if self._emergency else "Start at the page"
        print(f"{name}: the arm rests (seen {after:.0f} ms after the signal); to go on, press {then}")
        return 0

    def _rests(self) -> bool:
        seen = None
        while time.monotonic() < self._began + PATIENCE_S:
            if not self._entry.child_lives:
                return True
            flags = self._flags
            if flags is not None and flags.latched()[self._cause] != self._before:
                seen = flags.beats if seen is None else seen
                # `at_rest` is of the cycle before, and the signal may have come in the middle of one.
                if flags.beats >= seen + 3 and flags.at_rest:
                    return True
            time.sleep(0.005)
        return False

    def _close(self) -> None:
        if self._flags is not None:
            self._flags.close()
            self._flags = None
