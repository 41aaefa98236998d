"""Why no picture shows the board: what else is on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from vita.calibration.board import Board
from vita.calibration.detect import Finder
from vita.types import Image

_FAMILIES = ("4X4_1000", "5X5_1000", "6X6_1000", "7X7_1000")


def hint(board: Board, samples: Sequence[Image]) -> str:
    """The rest of a sentence: another board that the pictures do show, or what to look at; never empty."""
    for other in _others(board):
        if any(Finder(other).find(image) is not None for image in samples):
            return f". They show {other.words}: --board {other.text}"
    return ". Is the whole board in the picture (a checkerboard must be), sharp, flat, with a white margin?"


def larger(board: Board, shown: Image | None) -> Board | None:
    """The larger checkerboard that the picture shows, if it does: the finder is content with a part of one,
    and two cameras would not take the same part."""
    if shown is None or board.kind != "checker":
        return None
    sizes = [
        (board.cols + i, board.rows + j)
        for i, j in ((1, 1), (1, 0), (0, 1))
        if max(board.cols, board.rows) < 60
    ]
    others = [replace(board, cols=cols, rows=rows) for cols, rows in sizes]
    return next((other for other in others if Finder(other).find(shown) is not None), None)


def _others(board: Board) -> Iterator[Board]:
    """Boards that people mean when they type this one."""
    cols, rows = board.cols, board.rows
    if board.kind == "checker":
        counts = [(cols + 1, rows + 1), (cols - 1, rows - 1), (rows, cols), (rows + 1, cols + 1)]
        yield from (replace(board, cols=c, rows=r) for c, r in counts if min(c, r) >= 4)
        return
    yield replace(board, cols=rows, rows=cols)
    for family in _FAMILIES:
        if family[:3] != board.family[:3]:
            yield replace(board, family=family)
    yield Board("checker", cols, rows, board.square)
