"""The board as a picture to print, at its true size."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from PIL import Image as Pictures
from PIL import ImageDraw, ImageFont

from vita.calibration.board import Board, dictionary
from vita.errors import BadInput
from vita.types import Image

FORMATS = (".png", ".pdf", ".tif", ".tiff")
"""Formats that carry the size on paper."""
DPI = 300
MAX_PIXELS = 200_000_000
_MM = 25.4


def draw_board(board: Board, per_square: float) -> Image:
    """(h, w) grey picture of the squares alone, `per_square` pixels a side, edges at the nearest pixel."""
    edge_x = np.rint(np.arange(board.cols + 1) * per_square).astype(int)
    edge_y = np.rint(np.arange(board.rows + 1) * per_square).astype(int)
    picture = np.full((edge_y[-1], edge_x[-1]), 255, np.uint8)
    number = 0
    for row in range(board.rows):
        for col in range(board.cols):
            # OpenCV numbers the markers row by row over the white squares, with black at the top left.
            if (row + col) % 2 == 0:
                picture[edge_y[row] : edge_y[row + 1], edge_x[col] : edge_x[col + 1]] = 0
            elif board.kind == "charuco":
                _draw_marker(picture, board, number, col * per_square, row * per_square, per_square)
                number += 1
    return picture


def _draw_marker(
    picture: Image, board: Board, number: int, left: float, top: float, per_square: float
) -> None:
    family = dictionary(board.family)
    cells = cv2.aruco.generateImageMarker(family, number, family.markerSize + 2)
    side = per_square * board.marker / board.square
    cuts = (per_square - side) / 2 + np.arange(len(cells) + 1) * side / len(cells)
    xs, ys = np.rint(left + cuts).astype(int), np.rint(top + cuts).astype(int)
    for i in range(len(cells)):
        for j in range(len(cells)):
            picture[ys[i] : ys[i + 1], xs[j] : xs[j + 1]] = cells[i, j]


def draw_page(board: Board, dpi: int) -> Image:
    """(h, w) grey page: a white margin, the board, a ruler to check the printer by, what to type."""
    per_mm = dpi / _MM
    per_square = 1e3 * board.square * per_mm
    margin = round(max(0.5 * per_square, 8 * per_mm))
    foot = round(12 * per_mm)
    if (board.cols * per_square + 2 * margin) * (board.rows * per_square + 2 * margin + foot) > MAX_PIXELS:
        raise BadInput(f"the picture would be too large; take fewer than {dpi} dots per inch", "--dpi")
    squares = draw_board(board, per_square)
    page = np.full((squares.shape[0] + 2 * margin + foot, squares.shape[1] + 2 * margin), 255, np.uint8)
    page[margin : margin + squares.shape[0], margin : margin + squares.shape[1]] = squares
    canvas = Pictures.fromarray(page)
    pen = ImageDraw.Draw(canvas)
    length = 100 if board.cols * board.square > 0.1 else 10
    y, x, tick = squares.shape[0] + 2 * margin, margin, round(1.5 * per_mm)
    end = x + round(length * per_mm)
    thick = max(1, round(0.3 * per_mm))
    pen.line((x, y, end, y), fill=0, width=thick)
    for at in (x, end):
        pen.line((at, y - tick, at, y + tick), fill=0, width=thick)
    words = f"{length} mm: measure it; if it is not, print at 100 %.  vita calibrate --board {board.text}"
    pen.text((x, y + 2 * tick), words, fill=0, font=ImageFont.load_default(max(8, 3 * per_mm)))
    return np.asarray(canvas)


def print_board(board: Board, path: Path, dpi: int = DPI) -> tuple[float, float]:
    """Write the page; returns its size on paper (width, height) [mm]."""
    if path.suffix.lower() not in FORMATS:
        raise BadInput(f"cannot write {path.suffix or 'no suffix'!r}; take {', '.join(FORMATS)}", str(path))
    page = draw_page(board, dpi)
    try:
        # A PDF takes its page size from `resolution`, the others carry `dpi`.
        Pictures.fromarray(page).save(path, dpi=(dpi, dpi), resolution=dpi)
    except OSError as error:
        raise BadInput(f"cannot be written: {error.strerror or error}", str(path)) from None
    return page.shape[1] / dpi * _MM, page.shape[0] / dpi * _MM
