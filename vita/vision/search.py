"""Finding a lost target again: normalised correlation at low resolution over a window."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from vita.types import Array, Image
from vita.vision import warps
from vita.vision.images import Gray, to_gray

_CELLS = 12
"""Side of the target at the resolution of the search [pixels]."""
_LEAST = 0.4
"""Correlation below which a place is not worth a closer look."""


def candidates(frame: Image, look: Gray, poses: Sequence[Array], radius: float, best: int = 3) -> list[Array]:
    """Warps where the target may be, likeliest first.

    `look` (n, n) is the template; it is sought as each of `poses` (3, 3) shows it (turned, nearer,
    farther), all about the same place, within `radius` [px] of there.
    """
    outlines = [warps.corners(pose) for pose in poses]
    spans = [outline.max(axis=0) - outline.min(axis=0) for outline in outlines]
    window = _window(frame, outlines[0].mean(axis=0), np.max(spans, axis=0), radius)
    if window is None:
        return []
    low, high = window
    shrink = max(1.0, float(spans[0].min()) / _CELLS)
    gray = to_gray(frame[low[1] : high[1], low[0] : high[0]])
    small = np.maximum(np.rint((high - low) / shrink), 4).astype(int)
    scale = small / (high - low)
    scene = cv2.resize(gray, (int(small[0]), int(small[1])), interpolation=cv2.INTER_AREA).astype(np.float32)
    soft = cv2.GaussianBlur(look, (0, 0), max(0.5 * look.shape[0] / _CELLS, 0.3))
    found: list[tuple[float, Array]] = []
    for pose, outline, span in zip(poses, outlines, spans, strict=True):
        cells = np.maximum(np.rint(span * scale), 4).astype(int)
        if np.any(cells > small):
            continue
        view = _drawn(soft, pose, outline, scale, cells)  # type: ignore[arg-type]
        match = cv2.matchTemplate(scene, view, cv2.TM_CCOEFF_NORMED)
        # As it was seen last is likelier than any one of the others.
        count = best if pose is poses[0] else 1
        for value, x, y in _peaks(np.asarray(match, np.float32), max(2, int(cells.min()) // 4), count):
            corner = low + (np.array([x, y]) + 0.5) / scale - 0.5
            found.append((value, warps.shift(corner - outline.min(axis=0)) @ pose))
    found.sort(key=lambda place: -place[0])
    return [warp for _, warp in found[:best]]


def _window(frame: Image, center: Array, span: Array, radius: float) -> tuple[Array, Array] | None:
    """Top-left and bottom-right pixel of the part of the frame to look in; None if it is too small."""
    height, width = frame.shape[:2]
    low = np.clip(np.floor(center - span / 2 - radius), 0, None).astype(int)
    high = np.minimum(np.ceil(center + span / 2 + radius).astype(int) + 1, (width, height))
    return None if np.any(high - low < span * 0.8) else (low, high)


def _drawn(look: Gray, pose: Array, outline: Array, scale: Array, cells: Array) -> Gray:
    """The blurred template as `pose` shows it, at the low resolution."""
    n = look.shape[0]
    into_square = np.array([[2 / n, 0, 1 / n - 1], [0, 2 / n, 1 / n - 1], [0, 0, 1.0]])
    pixel = np.array([[scale[0], 0, 0.5 * scale[0] - 0.5], [0, scale[1], 0.5 * scale[1] - 0.5], [0, 0, 1.0]])
    placed = pixel @ warps.shift(-outline.min(axis=0)) @ pose @ into_square
    area = (int(cells[0]), int(cells[1]))
    return cv2.warpPerspective(look, placed, area, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[return-value]


def _peaks(match: Gray, apart: int, count: int) -> list[tuple[float, int, int]]:
    """The highest `count` values (value, column, row) that are at least `apart` cells from one another."""
    match = np.where(np.isfinite(match), match, np.float32(-1.0))
    peaks = []
    for _ in range(count):
        _, value, _, (x, y) = cv2.minMaxLoc(match)
        if value < _LEAST:
            break
        peaks.append((value, x, y))
        match[max(0, y - apart) : y + apart + 1, max(0, x - apart) : x + apart + 1] = -1.0
    return peaks
