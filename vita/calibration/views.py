"""The pictures in which the board was found, and which of them are worth solving with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from vita.calibration.board import Board
from vita.calibration.detect import Sighting
from vita.types import Array

MOST = 40
"""Views that are solved with at most; more add time and hardly anything else."""
NEAR = 0.03
"""Views whose board lies within this share of the picture's diagonal at all its corners are the same."""
SHARP_PX = 4.0
"""Edges up to this wide are never called blurred [px]."""


@dataclass(frozen=True, eq=False)
class View:
    """One picture, or one pair taken at the same instant."""

    name: str
    sights: tuple[Sighting | None, ...]
    """One for each camera; None where it does not see the board."""
    pictures: tuple[bytes | None, ...] = ()
    """The pictures themselves, packed, for whoever wants to show them."""

    @property
    def seen(self) -> tuple[bool, ...]:
        return tuple(sight is not None for sight in self.sights)


def without_blurred(views: Sequence[View]) -> tuple[list[View], list[str]]:
    """The views without sights that are much less sharp than the better ones; and what was left out."""
    kept, said = list(views), []
    for camera in range(len(views[0].sights) if views else 0):
        widths = [s.blur for v in kept if (s := v.sights[camera]) is not None]
        if not widths:
            continue
        limit = max(SHARP_PX, 1.8 * float(np.quantile(widths, 0.25)))
        for i, view in enumerate(kept):
            sight = view.sights[camera]
            if sight is not None and sight.blur > limit:
                sights = tuple(None if c == camera else s for c, s in enumerate(view.sights))
                kept[i] = replace(view, sights=sights)
                said.append(f"{view.name}: blurred (edges {sight.blur:.1f} px wide)")
    return [view for view in kept if any(view.seen)], said


def spread(
    board: Board, views: Sequence[View], sizes: Sequence[tuple[int, int]], near: float = NEAR
) -> list[View]:
    """At most `MOST` views that differ from one another, in their old order; those of all cameras first."""
    outlines = [outline(board, view, sizes) for view in views]
    chosen: list[int] = []
    for wanted in (True, False):
        rest = [i for i, view in enumerate(views) if all(view.seen) == wanted]
        while rest and len(chosen) < MOST:
            gaps = [min((distance(outlines[i], outlines[j]) for j in chosen), default=np.inf) for i in rest]
            best = int(np.argmax(gaps))
            if gaps[best] < near:
                break
            chosen.append(rest.pop(best))
    return [views[i] for i in sorted(chosen)]


def outline(board: Board, view: View, sizes: Sequence[tuple[int, int]]) -> tuple[Array | None, ...]:
    """For each camera the (4, 2) corners of the whole board in shares of the picture's diagonal, also those
    that lie outside of it."""
    outlines: list[Array | None] = []
    ends = board.corners[[0, board.across[0] - 1, -1, -board.across[0]], :2]
    for sight, size in zip(view.sights, sizes, strict=True):
        H = None if sight is None else cv2.findHomography(board.corners[sight.ids, :2], sight.uv)[0]
        if H is None:
            outlines.append(None)
            continue
        uvw = np.column_stack([ends, np.ones(4)]) @ H.T
        outlines.append(uvw[:, :2] / uvw[:, 2:] / np.hypot(*size))
    return tuple(outlines)


def distance(a: Sequence[Array | None], b: Sequence[Array | None]) -> float:
    """How far two views differ: the largest shift of a corner of the board, in shares of the diagonal."""
    shifts = [
        float(np.linalg.norm(x - y, axis=1).max())
        for x, y in zip(a, b, strict=True)
        if x is not None and y is not None
    ]
    return max(shifts, default=1.0)
