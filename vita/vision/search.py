"""Finding a lost target again: normalised correlation at low resolution over a window."""

from __future__ import annotations

import cv2
import numpy as np

from vita.types import Array, Image
from vita.vision import warps
from vita.vision.images import Gray, to_gray

_CELLS = 12
"""Side of the target at the resolution of the search [pixels]."""


def candidates(frame: Image, look: Gray, warp: Array, radius: float, best: int = 3) -> list[Array]:
    """Warps where the target may be, likeliest first.

    `look` (n, n) is the template; it is sought as `warp` last saw it (its turn and scale) within
    `radius` [px] of the last place.
    """
    outline = warps.corners(warp)
    size = outline.max(axis=0) - outline.min(axis=0)
    shrink = max(1.0, float(size.min()) / _CELLS)
    center = outline.mean(axis=0)
    height, width = frame.shape[:2]
    low = np.clip(np.floor(center - size / 2 - radius), 0, None).astype(int)
    high = np.minimum(np.ceil(center + size / 2 + radius).astype(int) + 1, (width, height))
    if np.any(high - low < size * 0.8):
        return []
    gray = to_gray(frame[low[1] : high[1], low[0] : high[0]])
    small = np.maximum(np.rint((high - low) / shrink), 4).astype(int)
    scale = small / (high - low)
    scene = cv2.resize(gray, (int(small[0]), int(small[1])), interpolation=cv2.INTER_AREA).astype(np.float32)
    cells = np.maximum(np.rint(size * scale), 4).astype(int)
    if np.any(cells > small):
        return []
    # The template as last seen, drawn at the low resolution; pixels beyond it are masked out.
    n = look.shape[0]
    into_square = np.array([[2 / n, 0, 1 / n - 1], [0, 2 / n, 1 / n - 1], [0, 0, 1.0]])
    pixel = np.array([[scale[0], 0, 0.5 * scale[0] - 0.5], [0, scale[1], 0.5 * scale[1] - 0.5], [0, 0, 1.0]])
    placed = pixel @ warps.shift(-outline.min(axis=0)) @ warp @ into_square
    sigma = 0.5 * n / float(cells.min())
    soft = cv2.GaussianBlur(look, (0, 0), max(sigma, 0.3))
    area = (int(cells[0]), int(cells[1]))
    view = cv2.warpPerspective(soft, placed, area, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    match = cv2.matchTemplate(scene, view, cv2.TM_CCOEFF_NORMED)
    match = np.where(np.isfinite(match), match, -1.0)
    found = []
    for _ in range(best):
        _, value, _, (x, y) = cv2.minMaxLoc(match)
        if value < 0.4:
            break
        corner = low + (np.array([x, y]) + 0.5) / scale - 0.5
        found.append(warps.shift(corner - outline.min(axis=0)) @ warp)
        r = max(2, int(cells.min()) // 4)
        match[max(0, y - r) : y + r + 1, max(0, x - r) : x + r + 1] = -1.0
    return found
