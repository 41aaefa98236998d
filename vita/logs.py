"""The log: one line a second and kind at most, in files that cannot fill the disk."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from logging.handlers import RotatingFileHandler
from pathlib import Path

FILE_BYTES = 10_000_000
FILES = 3
TRACEBACK_S = 60.0
"""The same exception shows its traceback so often at most [s]."""


class OncePerSecond(logging.Filter):
    """Lets one record of each kind through a second; the next one says how many were left out.

    Records are of one kind when they come from the same line of code and, for an exception, of the same type.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._last: dict[tuple, float] = {}
        self._traced: dict[tuple, float] = {}
        self._left_out: dict[tuple, int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        if getattr(record, "vita_passed", False):
            return True  # Another of us has let it through.
        now = self._clock()
        failure = record.exc_info[0].__name__ if record.exc_info and record.exc_info[0] else ""
        kind = record.name, record.pathname, record.lineno, failure
        if now - self._last.get(kind, -1e9) < 1.0:
            self._left_out[kind] = self._left_out.get(kind, 0) + 1
            return False
        self._last[kind] = now
        left_out = self._left_out.pop(kind, 0)
        text = record.getMessage()
        if record.exc_info and record.exc_info[1] is not None:
            if now - self._traced.get(kind, -1e9) < TRACEBACK_S:
                text += f": {failure}: {record.exc_info[1]}"
                record.exc_info = None
            else:
                self._traced[kind] = now
        record.msg, record.args = text + (f" (and {left_out} more)" if left_out else ""), None
        record.vita_passed = True
        return True


def keep_log(folder: Path) -> logging.Handler:
    """Write vita's log into `folder`/vita.log from now on: at most `FILES` files of `FILE_BYTES`. The caller
    removes the handler from the logger `vita`."""
    folder.mkdir(parents=True, exist_ok=True)
    handler = RotatingFileHandler(
        folder / "vita.log", maxBytes=FILE_BYTES, backupCount=FILES - 1, encoding="utf-8"
    )
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    handler.addFilter(OncePerSecond())
    logging.getLogger("vita").addHandler(handler)
    return handler
