"""Whether a place can be held on to, and how large a region is needed for it.

The score is the smaller eigenvalue of the gradients' covariance (Shi and Tomasi, "Good features
to track", 1994): large only where the picture changes in every direction. An edge slides along
itself and scores low, as a plain wall does.
"""

from __future__ import annotations

import cv2
import numpy as np

from vita.errors import BadInput, Untrackable
from vita.types import Array, Image, frozen
from vita.vision.images import Gray, to_gray

SIZES = tuple(range(31, 62, 6))
"""Sides of the square region to choose from, smallest first [px]."""
SMALLEST = 9
"""Smallest side that may be asked for [px]."""
ENOUGH = 2.0
"""Least score; camera noise of 2 grey levels alone scores about 0.25 [grey^2/px^2]."""
GOOD = 25.0
"""Score at which the smallest region is large enough [grey^2/px^2]."""
EDGE = 4.0
"""Larger eigenvalue from which on there is an edge, though in one direction only [grey^2/px^2]."""
_BLUR = 0.9


def choose_region(frame: Image, uv: Array, size_px: float | None) -> tuple[Array, float]:
    """Centre (2,) and side [px] of the region to track around pixel `uv`.

    The smallest of `SIZES` with a good score, or else the best of those that are good enough.
    Near the border the region is shifted into the frame; it still contains `uv`. Raises
    `Untrackable`, with the nearest good pixel as `suggestion`, where there is too little texture.
    """
    height, width = frame.shape[:2]
    room = min(width, height) - 1
    if room < SMALLEST:
        raise BadInput(f"a frame of {width} x {height} pixels is too small to track in")
    if size_px is not None and not SMALLEST <= size_px <= room:
        raise BadInput(f"a region of {size_px:g} px is outside {SMALLEST} to {room} px", "size_px")
    sizes = (float(size_px),) if size_px is not None else tuple(float(s) for s in SIZES if s <= room)
    fitting = _fitting(frame, uv, sizes or (float(room),))
    if fitting is not None:
        return fitting
    suggestion = _nearest_good(frame, uv, sizes or (float(room),))
    reason = f"nothing to hold on to here: {_why(frame, uv, sizes or (float(room),))}."
    hint = (
        "Nowhere in this picture is better."
        if suggestion is None
        else f"The nearest good place is pixel ({suggestion[0]:.0f}, {suggestion[1]:.0f})."
    )
    place = None if suggestion is None else (float(suggestion[0]), float(suggestion[1]))
    raise Untrackable(f"{reason} {hint}", suggestion=place)


def _why(frame: Image, uv: Array, sizes: tuple[float, ...]) -> str:
    """What is wrong with a place: nothing to be seen, or one straight edge."""
    low = np.maximum(np.floor(uv - sizes[-1] / 2), 0).astype(int)
    high = np.ceil(uv + sizes[-1] / 2).astype(int) + 1
    xx, xy, yy = (float(g.mean()) for g in _gradients(frame[low[1] : high[1], low[0] : high[0]]))
    if xx + yy - float(_smaller_eigenvalue(xx, xy, yy)) > EDGE:
        return "one straight edge, which a point slides along; a line tracker would hold it"
    return "the picture is blank"


def _fitting(frame: Image, uv: Array, sizes: tuple[float, ...]) -> tuple[Array, float] | None:
    limit = np.array([frame.shape[1], frame.shape[0]], dtype=np.float64)
    best, best_score = None, ENOUGH
    for size in sizes:
        half = size / 2
        center = np.clip(uv, half - 0.5, limit - half - 0.5)
        low = np.maximum(np.floor(center - half), 0).astype(int)
        high = np.minimum(np.ceil(center + half) + 1, limit).astype(int)
        xx, xy, yy = _gradients(frame[low[1] : high[1], low[0] : high[0]])
        score = float(_smaller_eigenvalue(xx.mean(), xy.mean(), yy.mean()))
        # More pixels average the noise away, so what counts grows with the region's side.
        score *= size / sizes[0] if size > sizes[0] else 1.0
        if score >= GOOD:
            return center, size
        if score > best_score:
            best, best_score = (center, size), score
    return best


def _gradients(frame: Image) -> tuple[Gray, Gray, Gray]:
    """Squares and product of the image gradients, each (h, w)."""
    gray = cv2.GaussianBlur(to_gray(frame).astype(np.float32), (0, 0), _BLUR)
    gx = cv2.Sobel(gray, cv2.CV_32F, 1, 0, ksize=1, scale=0.5)
    gy = cv2.Sobel(gray, cv2.CV_32F, 0, 1, ksize=1, scale=0.5)
    return gx * gx, gx * gy, gy * gy  # type: ignore[return-value]


def _smaller_eigenvalue(xx, xy, yy):  # type: ignore[no-untyped-def]
    """Of the symmetric matrices [[xx, xy], [xy, yy]], numbers or arrays."""
    return 0.5 * (xx + yy) - np.sqrt(0.25 * np.square(xx - yy) + np.square(xy))


def _nearest_good(frame: Image, uv: Array, sizes: tuple[float, ...]) -> Array | None:
    """(2,) the nearest pixel with clearly enough texture, checked as a click there would be."""
    side = int(sizes[0]) | 1
    means = [cv2.boxFilter(g, -1, (side, side)) for g in _gradients(frame)]
    score = _smaller_eigenvalue(*means)
    rows, columns = np.mgrid[0 : score.shape[0], 0 : score.shape[1]]
    away = np.hypot(columns - uv[0], rows - uv[1])
    for enough in (4 * ENOUGH, 1.5 * ENOUGH):
        distance = np.where(score >= enough, away, np.inf)
        for _ in range(5):
            v, u = np.unravel_index(int(np.argmin(distance)), distance.shape)
            if not np.isfinite(distance[v, u]):
                break
            place = frozen([u, v])
            if _fitting(frame, place, sizes) is not None:
                return place
            distance[max(0, v - 8) : v + 9, max(0, u - 8) : u + 9] = np.inf
    return None
