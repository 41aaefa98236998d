"""The CSV: one row per frame and tracker."""

from __future__ import annotations

import contextlib
import csv
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TextIO

from vita.errors import BadInput
from vita.types import Feature

COLUMNS = ("frame", "tracker", "status", "u", "v", "x0", "y0", "x1", "y1", "x2", "y2", "x3", "y3", "score")


class Table:
    """Writes as it goes: every frame is handed to the system at once, so a kill loses one at most."""

    def __init__(self, path: Path | None) -> None:
        """`path` is overwritten; None is the standard output."""
        self.path = path
        try:
            self._file: TextIO = sys.stdout if path is None else path.open("w", newline="", encoding="utf-8")
        except OSError as error:
            raise BadInput(f"cannot be written: {error.strerror or error}", str(path)) from None
        self._rows = csv.writer(self._file, lineterminator="\n")
        self._write([COLUMNS])

    def add(self, frame: int, features: dict[str, Feature]) -> None:
        """The rows of one frame, in the trackers' order; a line's ends have rows of their own."""
        self._write([row for name, feature in features.items() for row in _rows(frame, name, feature)])

    def _write(self, rows: Iterable[Iterable[object]]) -> None:
        try:
            self._rows.writerows(rows)
            self._file.flush()
        except BrokenPipeError:  # The reader has seen enough: `vita track ... | head`.
            raise
        except OSError as error:
            where = str(self.path or "standard output")
            raise BadInput(f"cannot be written: {error.strerror or error}", where) from None

    def close(self) -> None:
        if self.path is not None:
            # What could not be written has been told by `add`; closing would only try it again.
            with contextlib.suppress(OSError):
                self._file.close()


def _rows(frame: int, name: str, feature: Feature) -> list[list[object]]:
    places = {name: feature.uv}
    if feature.segment is not None:
        places |= {f"{name}.start": feature.segment[0], f"{name}.end": feature.segment[1]}
    corners = [""] * 8 if feature.corners is None else [_number(x) for x in feature.corners.ravel().tolist()]
    score = _number(feature.score)
    return [[frame, n, feature.status, *map(_number, uv), *corners, score] for n, uv in places.items()]


def _number(value: float) -> str:
    """Four digits: a hundredth of the best tracker's jitter. Without a minus before a zero."""
    return f"{round(float(value), 4) + 0.0:.4f}"
