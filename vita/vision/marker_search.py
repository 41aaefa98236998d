"""Looking for a few known codes in a whole picture, cheaply and down to cells of two pixels.

OpenCV's detector reads every dark outline for every code of its dictionary, on corners of whole pixels. Where
the codes are known, it is quicker to compare each outline with those alone, and with corners where lines
through the outline's sides meet, small codes are recognised that the detector cannot read.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.types import Array
from vita.vision import warps
from vita.vision.images import Crop
from vita.vision.marker_code import Code
from vita.vision.marker_follow import Found, plane_of

WINDOW_PX, DARKER = 13, 12
"""Ink is this many grey levels darker than the mean of the window around it."""
LEAST_PX = 9.0
"""Least length of a side: below, cells are smaller than a pixel."""
ALIKE = 0.45
"""Least correlation with a code of what an outline holds, before its corners are refined."""


class MarkerSearch:
    """Finds codes of one size among each other's look-alikes."""

    def __init__(self, codes: Sequence[Code]) -> None:
        self._codes = tuple(codes)
        self._across = self._codes[0].across
        # What is seen when the outline's first corner is the code's first, second, third or fourth.
        looks = [np.rot90(code.pattern, -k) for code in self._codes for k in range(4)]
        self._looks = np.stack([look.ravel() for look in looks])

    def find(self, crop: Crop) -> list[Found]:
        """Number and rough corners (4, 2) [px], in the code's order, of what looks like one of the codes."""
        found: list[Found] = []
        for quad in outlines(crop.gray):
            likeness = self._looks @ self._seen(crop.gray, quad)
            best = int(likeness.argmax())
            if likeness[best] >= ALIKE:
                code, turn = divmod(best, 4)
                found.append((self._codes[code].number, crop.origin + np.roll(quad, -turn, axis=0)))
        return found

    def _seen(self, gray: NDArray[np.uint8], quad: Array) -> Array:
        """(cells,) grey levels of the cells within an outline, of zero mean and unit length."""
        n = 2 * self._across
        low = np.maximum(quad.min(axis=0).astype(int) - 1, 0)
        high = quad.max(axis=0).astype(int) + 3
        part = gray[low[1] : high[1], low[0] : high[0]]
        grid = np.array([[2 / n, 0, 1 / n - 1], [0, 2 / n, 1 / n - 1], [0, 0, 1.0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        cells = cv2.warpPerspective(
            part, plane_of(quad - low) @ grid, (n, n), flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
        values = cv2.resize(cells, (n // 2, n // 2), interpolation=cv2.INTER_AREA).ravel().astype(np.float64)
        values -= values.mean()
        return values / (np.linalg.norm(values) + 1e-9)


def outlines(gray: NDArray[np.uint8]) -> list[Array]:
    """(4, 2) corners [px], clockwise as seen, of every dark quadrangle on lighter ground."""
    ink = cv2.adaptiveThreshold(
        gray, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, WINDOW_PX, DARKER
    )
    contours, _ = cv2.findContours(ink, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    quads = []
    for contour in contours:
        # Points follow one another pixel by pixel, so their number is about the way around.
        if len(contour) < 3.5 * LEAST_PX:
            continue
        corners = cv2.approxPolyDP(contour, 0.05 * len(contour), True)
        if len(corners) == 4 and cv2.isContourConvex(corners):
            quad = _fitted(np.asarray(contour[:, 0], np.int32), np.asarray(corners[:, 0], np.int32))
            if quad is not None:
                quads.append(quad)
    return quads


def _fitted(contour: NDArray[np.int32], corners: NDArray[np.int32]) -> Array | None:
    """(4, 2) where lines through the four sides of a contour meet; None for one that is too small."""
    at = np.sort(np.abs(contour[:, None] - corners).sum(axis=2).argmin(axis=0)).tolist()
    ring = np.concatenate([contour, contour])
    lines = []
    for begin, end in zip(at, (*at[1:], at[0] + len(contour)), strict=True):
        if end - begin < 0.6 * LEAST_PX:
            return None
        # The ends belong to the corners, which are round in a picture.
        spare = (end - begin) // 8
        side = ring[begin + spare : end - spare + 1]
        lines.append(cv2.fitLine(side, cv2.DIST_L2, 0, 0.01, 0.01).ravel().tolist())
    quad = []
    for (u, v, x, y), (p, q, z, w) in zip((lines[-1], *lines[:-1]), lines, strict=True):
        cross = u * q - v * p
        if abs(cross) < 0.05:
            return None
        way = ((z - x) * q - (w - y) * p) / cross
        quad.append((x + way * u, y + way * v))
    found = np.array(quad)
    if np.abs(found - contour[at]).max() > 2.0 + 0.08 * len(contour):
        return None
    return found if warps.area(found) > 0 else found[::-1].copy()
