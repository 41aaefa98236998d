"""The progress line: on a terminal only, and never more often than an eye can follow."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping
from typing import TextIO

from vita.types import Feature

PERIOD_S = 0.1
_BAR = 16
_EIGHTHS = " ▏▎▍▌▋▊▉█"


class Progress:
    """One line that is written over and over, and wiped away at the end."""

    def __init__(self, stream: TextIO, total: int | None, shown: bool) -> None:
        """`total` is the number of frames, None when nobody knows. Nothing is written unless `shown`."""
        self._stream, self._total, self._shown = stream, total, shown
        self._marks = _EIGHTHS if _can_write(stream, _EIGHTHS) else "  ----  #"
        self._start = time.monotonic()
        self._due = self._start

    def update(self, done: int, features: Mapping[str, Feature]) -> None:
        """After `done` frames."""
        now = time.monotonic()
        if not self._shown or now < self._due:
            return
        self._due = now + PERIOD_S
        rate = done / max(now - self._start, 1e-9)
        lost = [name for name, feature in features.items() if not feature.ok]
        state = f"{len(features) - len(lost)} ok"
        if lost:
            state += f", {len(lost)} lost ({', '.join(lost)})"
        text = f"{self._bar(done)}  {rate:.0f} frames/s  {state}"
        width = shutil.get_terminal_size().columns - 1
        self._stream.write(f"\r{text[:width]}\x1b[K")
        self._stream.flush()

    def _bar(self, done: int) -> str:
        if not self._total:
            return f"{done} frames"
        share = min(done / self._total, 1.0)
        whole, part = divmod(round(share * _BAR * 8), 8)
        bar = (self._marks[8] * whole + (self._marks[part] if part else "")).ljust(_BAR)
        return f"{bar}| {100 * share:3.0f} %  {done} of {self._total} frames"

    def close(self) -> None:
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()


def _can_write(stream: TextIO, text: str) -> bool:
    try:
        text.encode(stream.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
