"""Markers painted over, so that the corners between them can be refined as on a plain checkerboard.

A corner is found best from long pieces of its edges, but the window that holds them would hold the edges of
two markers as well, which pull it aside.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.calibration.board import Board
from vita.types import Array, Image


def without_markers(
    grey: Image, board: Board, quads: Sequence[Array], numbers: NDArray[np.int64], ids: NDArray[np.int64]
) -> tuple[Image, NDArray[np.bool_]]:
    """The picture with the markers `quads` (4, 2) [px] of these numbers gone, and which corners are free.

    A marker that was not recognised stays, and with it both corners that it touches.
    """
    painted = grey.copy()
    # Half of the white gap around a marker goes with it, because its own edge is blurred.
    grown = 1 + 0.5 * (board.square / board.marker - 1)
    for quad in quads:
        corners = np.asarray(quad, np.float64).reshape(4, 2)
        outline = corners.mean(axis=0) + grown * (corners - corners.mean(axis=0))
        white = np.concatenate([outline, (outline + np.roll(outline, 1, axis=0)) / 2]).astype(np.float32)
        level = cv2.remap(
            grey, white[None, :, 0], white[None, :, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        fixed = np.rint(outline * 16).astype(np.int32)
        cv2.fillConvexPoly(painted, fixed, float(np.median(level)), cv2.LINE_8, 4)
    known = set(numbers.tolist())
    return painted, np.array([_touching(board, int(i)) <= known for i in ids], bool)


def _touching(board: Board, corner: int) -> set[int]:
    """Numbers of the two markers in the white squares at an inner corner."""
    row, col = divmod(corner, board.across[0])
    squares = [(row + i) * board.cols + col + j for i in (0, 1) for j in (0, 1) if (row + col + i + j) % 2]
    # Markers count the white squares; of the squares before one, every second is white.
    return {_white_before(board, square) for square in squares}


def _white_before(board: Board, square: int) -> int:
    row, col = divmod(square, board.cols)
    # A row that begins with black holds cols // 2 white squares, the next one the rest.
    whole = row // 2 * board.cols + (row % 2) * (board.cols // 2)
    return whole + (col + row % 2) // 2
