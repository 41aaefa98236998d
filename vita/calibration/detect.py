"""Where a picture shows the board's corners, to a fraction of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.calibration.board import MIN_CORNERS, Board
from vita.calibration.overpaint import without_markers
from vita.types import Array, Image, frozen

_REACH = 0.33
"""Half the window that a corner is refined in, as a share of the distance to the next."""
_SEARCH = 1600
"""Longer side at which a checkerboard is looked for; its corners are refined in the full picture [px]."""


@dataclass(frozen=True, eq=False)
class Sighting:
    """The corners of the board that one picture shows."""

    ids: NDArray[np.int64]
    """(n,) which of `Board.corners`, ascending."""
    uv: Array
    """(n, 2) where they are seen [px], origin at the centre of the top-left pixel."""
    blur: float
    """Width of the edges at the corners [px]; 1 to 3 in a sharp picture."""

    def only(self, keep: NDArray[np.bool_]) -> Sighting:
        return Sighting(self.ids[keep], frozen(self.uv[keep]), self.blur)


class Finder:
    """Looks for one board in many pictures."""

    def __init__(self, board: Board) -> None:
        self.board = board
        if board.kind == "charuco":
            parameters = cv2.aruco.CharucoParameters()
            # Corners beside a single marker are kept: at the picture's rim there is often no second one.
            parameters.minMarkers = 1
            self._charuco = cv2.aruco.CharucoDetector(board.charuco(), parameters)

    def find(self, image: Image) -> Sighting | None:
        """The corners in (h, w, 3) RGB or (h, w) grey; None for fewer than `MIN_CORNERS` or all on a line."""
        grey = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
        found = self._find_charuco(grey) if self.board.kind == "charuco" else self._find_checker(grey)
        if found is None:
            return None
        ids, uv = found
        inside = ((uv > 1) & (uv < np.array(grey.shape[::-1]) - 2)).all(axis=1)
        ids, uv = ids[inside], uv[inside]
        if len(ids) < MIN_CORNERS or _on_a_line(self.board, ids):
            return None
        order = np.argsort(ids)
        return Sighting(ids[order], frozen(uv[order]), edge_width(grey, self.board, ids, uv))

    def _find_charuco(self, grey: Image) -> tuple[NDArray[np.int64], Array] | None:
        uv, ids, quads, numbers = self._charuco.detectBoard(grey)
        if ids is None or uv is None or len(ids) < MIN_CORNERS:
            return None
        ids, uv = np.asarray(ids, np.int64).ravel(), np.asarray(uv, np.float64).reshape(-1, 2)
        markers = [np.asarray(quad, np.float64) for quad in quads]
        painted, free = without_markers(grey, self.board, markers, np.ravel(numbers).astype(np.int64), ids)
        spacing = _spacing(self.board, ids, uv)
        gap = 0.5 * (1 - self.board.marker / self.board.square)
        close, wide = _refine(grey, uv, spacing, gap), _refine(painted, uv, spacing, _REACH)
        return ids, np.where(free[:, None], wide, close)

    def _find_checker(self, grey: Image) -> tuple[NDArray[np.int64], Array] | None:
        scale = min(1.0, _SEARCH / max(grey.shape))
        small = (
            grey if scale == 1 else cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        )
        ok, corners = cv2.findChessboardCornersSB(small, self.board.across)
        if not ok or corners is None:
            return None
        uv = (np.asarray(corners, np.float64).reshape(-1, 2) + 0.5) / scale - 0.5
        uv = _upright(grey, uv, self.board)
        ids = np.arange(len(uv))
        return ids, _refine(grey, uv, _spacing(self.board, ids, uv), _REACH)


def _refine(grey: Image, uv: Array, spacing: float, reach: float) -> Array:
    """(n, 2) corners at the saddle of the grey values within `reach` of the spacing around them [px]."""
    half = int(np.clip(reach * spacing, 2, 12))
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    start = uv.astype(np.float32).reshape(-1, 1, 2).copy()
    fine = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), stop).reshape(-1, 2).astype(np.float64)
    # One that ran away from its start was drawn to something else.
    ran = np.linalg.norm(fine - uv, axis=1) > max(1.5, 0.1 * spacing)
    return np.where(ran[:, None], uv, fine)


def _spacing(board: Board, ids: NDArray[np.int64], uv: Array) -> float:
    """Smallest distance of two neighbouring corners [px]; a typical one where none are neighbours."""
    at = dict(zip(ids.tolist(), uv, strict=True))
    cols = board.across[0]
    gaps = [
        float(np.linalg.norm(at[i] - at[j]))
        for i in at
        for j in ((i + 1,) if (i + 1) % cols else ()) + (i + cols,)
        if j in at
    ]
    return min(gaps) if gaps else 10.0


def _on_a_line(board: Board, ids: NDArray[np.int64]) -> bool:
    cells = np.column_stack(np.divmod(ids, board.across[0])).astype(float)
    return bool(np.linalg.svd(cells - cells.mean(axis=0), compute_uv=False)[1] < 1.0)


def _upright(grey: Image, uv: Array, board: Board) -> Array:
    """The corners of a checkerboard counted from the one beside the black corner square.

    Turned by 180 degrees a checkerboard has the same corners, and the finder starts at either end; two
    cameras must agree. Where the colours leave the choice (even by even squares), the board is taken as
    upright.
    """
    cols, rows = board.across
    grid = uv.reshape(rows, cols, 2)
    turns = (0, 1, 2, 3) if cols == rows else (0, 2)
    options = [np.rot90(g, turn) for g in (grid, grid[:, ::-1]) for turn in turns]
    options = [g for g in options if g.shape == grid.shape and _handed(g) > 0]
    options = [g for g in options if _starts_black(grey, g)] or options
    best = max(options, key=lambda g: float((g[:, -1] - g[:, 0]).sum(axis=0)[0]))
    return np.ascontiguousarray(best).reshape(-1, 2)


def _handed(grid: Array) -> float:
    """Above 0 where columns to the right and rows downwards make a picture that is not mirrored."""
    x, y = (grid[:, -1] - grid[:, 0]).sum(axis=0), (grid[-1] - grid[0]).sum(axis=0)
    return float(x[0] * y[1] - x[1] * y[0])


def _starts_black(grey: Image, grid: Array) -> bool:
    """Whether the first inner square, one step from the board's corner square, is black like that one."""
    middles = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    values = np.array([[_value(grey, uv) for uv in row] for row in middles])
    even = np.add.outer(np.arange(values.shape[0]), np.arange(values.shape[1])) % 2 == 0
    return bool(values[even].mean() < values[~even].mean())


def _value(grey: Image, uv: Array) -> float:
    col, row = np.clip(np.rint(uv).astype(int), 0, np.array(grey.shape[::-1]) - 1)
    return float(grey[row, col])


def edge_width(grey: Image, board: Board, ids: NDArray[np.int64], uv: Array) -> float:
    """Width of the edges between neighbouring corners [px]: contrast over the steepest slope across them.

    The edges along the rows and along the columns of the board are judged apart and the wider counts, so that
    a picture blurred by a motion in one direction is found as well. Infinite where nothing can be measured.
    """
    at = dict(zip(ids.tolist(), uv, strict=True))
    cols = board.across[0]
    along_rows = [(at[i], at[i + 1]) for i in at if (i + 1) % cols and i + 1 in at]
    along_cols = [(at[i], at[i + cols]) for i in at if i + cols in at]
    widths = [_width(grey, np.array(ends)) for ends in (along_rows, along_cols) if ends]
    return max(widths, default=float("inf"))


def _width(grey: Image, ends: Array) -> float:
    """Median width [px] of (k, 2, 2) edges given by their ends, from a profile across each one's middle."""
    line = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(line, axis=1)
    normal = np.column_stack([-line[:, 1], line[:, 0]]) / length[:, None]
    # A tenth of the edge to either side shows both colours without reaching a marker.
    half = max(3.0, float(np.median(length)) * 0.12)
    steps = np.arange(-half, half + 0.25, 0.5)
    shares = np.linspace(0.35, 0.65, 7)
    middles = ends[:, :1] + shares[:, None] * line[:, None]
    where = middles[:, :, None] + steps[:, None] * normal[:, None, None]
    xy = where.reshape(len(ends), -1, 2).astype(np.float32)
    values = cv2.remap(grey, xy[..., 0], xy[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profile = values.reshape(len(ends), len(shares), len(steps)).astype(float).mean(axis=1)
    slope = np.abs(profile[:, 2:] - profile[:, :-2]).max(axis=1)
    contrast = np.ptp(profile, axis=1)
    return float(np.median(contrast / np.maximum(slope, 1e-3)))
