"""The printed board: what `--board` says, and where its corners lie."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from vita.errors import BadInput, UnknownName
from vita.types import Array

USAGE = "checker:COLSxROWS:SQUARE_MM or charuco:COLSxROWS:SQUARE_MM:MARKER_MM (squares, not corners)"
MIN_CORNERS = 8
"""Corners that a picture must show at least: a pose has 6 unknowns, and these leave something to judge by."""
_SIZES = (50, 100, 250, 1000)
_FAMILIES = tuple(f"{bits}X{bits}_{size}" for bits in (4, 5, 6, 7) for size in _SIZES)


@dataclass(frozen=True)
class Board:
    """A board of `cols` by `rows` squares, black at its top left."""

    kind: Literal["checker", "charuco"]
    cols: int
    """Squares side by side; there is one corner less."""
    rows: int
    square: float
    """Side of a square [m]."""
    marker: float = 0.0
    """Side of a marker, black border included [m]; 0 without markers."""
    family: str = ""
    """Set of markers, such as `4X4_50`."""

    @property
    def across(self) -> tuple[int, int]:
        """Inner corners (columns, rows)."""
        return self.cols - 1, self.rows - 1

    @property
    def corners(self) -> Array:
        """(n, 3) inner corners in the board's frame [m], row by row; z points away from the viewer."""
        cols, rows = self.across
        grid = np.mgrid[0:rows, 0:cols].reshape(2, -1)[::-1].T
        return np.column_stack([(grid + 1) * self.square, np.zeros(len(grid))])

    @property
    def words(self) -> str:
        """For people."""
        cols, rows = self.across
        squares = f"{self.cols} x {self.rows} squares of {1e3 * self.square:g} mm"
        if self.kind == "checker":
            return f"a checkerboard of {squares} ({cols} x {rows} inner corners)"
        return f"a ChArUco board of {squares} with {self.family} markers of {1e3 * self.marker:g} mm"

    @property
    def text(self) -> str:
        """As `--board` takes it."""
        text = f"{self.kind}:{self.cols}x{self.rows}:{1e3 * self.square:g}"
        if self.kind == "checker":
            return text
        usual = self.family == _family(self.cols * self.rows // 2, "--board")
        return f"{text}:{1e3 * self.marker:g}" + ("" if usual else f":{self.family}")

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """The same for OpenCV."""
        sides = self.square, self.marker
        return cv2.aruco.CharucoBoard((self.cols, self.rows), *sides, dictionary(self.family))


def dictionary(family: str) -> cv2.aruco.Dictionary:
    """OpenCV's set of markers."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{family}"))


def parse_board(text: str) -> Board:
    """What `--board` says; names what is wrong with it."""
    where = f"--board {text}"
    kind, *rest = text.strip().lower().split(":")
    if kind not in ("checker", "charuco"):
        raise UnknownName("board", kind, ("checker", "charuco"), where)
    counts = {"checker": (2,), "charuco": (3, 4)}[kind]
    if len(rest) not in counts:
        raise BadInput(f"expected {USAGE}", where)
    cols, rows = _squares(rest[0], 4 if kind == "checker" else 3, where)
    square = _millimetres(rest[1], where)
    if kind == "checker":
        return Board("checker", cols, rows, square)
    marker = _millimetres(rest[2], where)
    if not 0.3 * square <= marker < square:
        raise BadInput("a marker must be smaller than its square, and 0.3 of it at least", where)
    needed = cols * rows // 2
    family = rest[3].upper().removeprefix("DICT_") if len(rest) == 4 else _family(needed, where)
    if family not in _FAMILIES:
        raise UnknownName("set of markers", family, _FAMILIES, where)
    if int(family.partition("_")[2]) < needed:
        raise BadInput(f"{family} has fewer markers than the {needed} that this board takes", where)
    return Board("charuco", cols, rows, square, marker, family)


def _family(needed: int, where: str) -> str:
    size = next((size for size in _SIZES if size >= needed), None)
    if size is None:
        raise BadInput(f"it takes {needed} markers and no set has more than {_SIZES[-1]}", where)
    return f"4X4_{size}"


def _squares(text: str, least: int, where: str) -> tuple[int, int]:
    parts = text.split("x")
    if len(parts) != 2 or not all(p.isascii() and p.isdigit() and len(p) < 4 for p in parts):
        raise BadInput(f"{text!r} is not COLSxROWS, such as 9x6; expected {USAGE}", where)
    cols, rows = int(parts[0]), int(parts[1])
    if min(cols, rows) < least or (cols - 1) * (rows - 1) < MIN_CORNERS or max(cols, rows) > 60:
        raise BadInput(
            f"{cols} x {rows} squares: each side needs {least} to 60, and {MIN_CORNERS} inner corners in all",
            where,
        )
    return cols, rows


def _millimetres(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.5 <= value <= 2000:
        raise BadInput(f"{text!r} is not a length in millimetres (0.5 to 2000)", where)
    return value / 1e3
