"""The progress of an experiment: a bar on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import shutil
import time
from typing import TextIO

BAR = 24
REDRAW_S, LINE_S = 0.1, 10.0
"""How often a terminal's bar and a file's line are written at most."""


class JobProgress:
    """Counts the jobs of one experiment on `stream`; it writes nothing when that is None."""

    def __init__(self, name: str, total: int, stream: TextIO | None) -> None:
        self._name, self._total, self._stream = name, total, stream
        self._bar = stream is not None and stream.isatty()
        self._start = time.monotonic()
        self._due = self._start + (0.0 if self._bar else LINE_S)
        self._draw(0, "")

    def update(self, done: int, label: str) -> None:
        """After `done` jobs, the last of which was `label`."""
        if time.monotonic() >= self._due:
            self._draw(done, label)

    def close(self) -> None:
        """Wipe the bar away, so that what follows starts on a clean line."""
        if self._stream is not None and self._bar:
            self._stream.write("\r\x1b[K")
            self._stream.flush()

    def _draw(self, done: int, label: str) -> None:
        if self._stream is None:
            return
        elapsed = time.monotonic() - self._start
        state = f"{self._name}: {done} of {self._total}"
        if done:
            state += f", {elapsed * (self._total - done) / done:.0f} s left ({label})"
        if self._bar:
            whole = round(BAR * done / max(self._total, 1))
            line = f"[{'#' * whole}{'-' * (BAR - whole)}] {state}"
            self._stream.write(f"\r{line[: shutil.get_terminal_size().columns - 1]}\x1b[K")
        else:
            self._stream.write(f"{state}\n")
        self._stream.flush()
        self._due = time.monotonic() + (REDRAW_S if self._bar else LINE_S)
