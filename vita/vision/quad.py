"""Sub-pixel corners of a dark quadrangle on light ground: a straight line fitted to each side.

A corner is where two sides meet. Each side has tens of edge points, so their lines are known far
better than the few pixels at the corner itself would tell, and a corner that is a little worn or
covered does no harm.

The four sides are sampled and fitted at once, and within this file a pixel is one complex number, column +
i row: arrays so small cost by the number of operations, not by their size.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.types import Array
from vita.vision.images import Crop, Gray

Pixels = NDArray[np.complex128]

_ALONG = np.linspace(0.07, 0.93, 22)
"""Where along each side the edge is looked for; the ends belong to the corners."""
_STEP = 0.5
"""Distance of the samples across a side [px]."""
_TUKEY = 4.0
_WEIGHINGS, _SETTLED_PX = 3, 0.01
"""How often outliers are weighed down, at most; once is enough to see where to look again."""
_NEXT, _BEFORE, _EACH = np.array([1, 2, 3, 0]), np.array([3, 0, 1, 2]), np.arange(4)
_POWERS = _ALONG[:, None] ** np.arange(3)


def refined(crop: Crop, corners: Array, cell: float) -> Array | None:
    """(4, 2) corners of the quadrangle near `corners`, which are clockwise as seen; None where there is none.

    `cell` [px] is the width of the dark frame: the edge is sought within less than it, so that what
    is printed inside does not pull.
    """
    image = crop.blurred(0.6)
    half, furthest = min(max(0.42 * cell, 1.5), 4.0), max(3.0, 0.8 * cell)
    start = np.ascontiguousarray(corners - crop.origin, np.float64).view(np.complex128)[:, 0]
    now, extra = start, 1.0
    for _ in range(4):
        found = _corners(image, now, half + extra, _WEIGHINGS if extra == 0.0 else 1)
        # Written so that what is not a number is refused as well.
        if found is None or not _largest(found - start) <= furthest:
            return None
        moved, now = _largest(found - now), found
        if extra == 0.0 and moved < 0.1:
            break
        # Once near, the narrowest window sees the whole edge and least of what is beside it.
        extra = 0.0 if moved < 1.0 else 0.5
    return now.view(np.float64).reshape(4, 2) + crop.origin


def _largest(way: Pixels) -> float:
    """Largest number of columns or rows in (4,) ways."""
    return float(np.abs(way.view(np.float64)).max())


def _corners(image: Gray, corners: Pixels, half: float, weighings: int) -> Pixels | None:
    """(4,) where the sides meet that are seen within `half` [px] of those of `corners`; None if not clear."""
    run = corners[_NEXT] - corners
    length = np.abs(run)
    if length.min() < 6:
        return None
    outward = run / length * -1j
    across = np.arange(-half, half + 1e-6, _STEP)
    edge = corners[:, None] + run[:, None] * _ALONG
    places = (edge + across[:, None, None] * outward[:, None]).astype(np.complex64)
    # From here on the last two axes are the side and the place along it; the first of three is across.
    values = _sampled(image, places)
    rise = np.maximum(values[1:] - values[:-1], 0.0)
    rise = np.maximum(rise - 0.1 * rise.max(axis=0), 0.0)
    total = rise.sum(axis=0)
    middle = across[1:] - 0.5 * _STEP
    offset = (middle @ rise.reshape(middle.size, -1)).reshape(total.shape) / (total + 1e-9)
    usual = float(np.partition(total, total.size // 2, axis=None)[total.size // 2])
    clear = (total > max(4.0, 0.35 * usual)) & _inside(image, places)
    if clear.sum(axis=1).min() < 8:
        return None
    shift, tilt = _lines(offset, clear, weighings)
    return _meetings(corners + shift * outward, run + tilt * outward)


def _sampled(image: Gray, places: NDArray[np.complex64]) -> Gray:
    """Values of `image` at (across, side, along) pixels, bilinear."""
    flat = places.view(np.float32).reshape(places.shape[0], -1, 2)
    mapped = cv2.remap(image, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return mapped.reshape(places.shape)  # type: ignore[return-value]


def _inside(image: Gray, places: NDArray[np.complex64]) -> NDArray[np.bool_]:
    """(side, along) whether both ends of what is sampled across a side lie in the picture."""
    tips = places[(0, -1),].view(np.float32).reshape(2, 4, -1, 2)
    last = image.shape[1] - 1, image.shape[0] - 1
    return np.all((tips >= 0) & (tips <= last), axis=(0, 3))


def _lines(offset: Array, clear: NDArray[np.bool_], weighings: int) -> tuple[Array, Array]:
    """Intercept and slope (4,) of each side's `offset` (4, k) along it, weighted against outliers (Tukey)."""
    hidden, half = np.where(clear, 0.0, np.inf), clear.sum(axis=1) // 2
    lines = np.zeros((4, 2))
    away = offset - np.sort(offset + hidden, axis=1)[_EACH, half, None]
    for _ in range(weighings):
        away = np.abs(away) + hidden
        usual = np.sort(away, axis=1)[_EACH, half, None]
        reach = np.maximum(1.4826 * _TUKEY * usual, 0.05 * _TUKEY)
        weights = np.square(np.maximum(1.0 - np.square(away / reach), 0.0))
        sums = zip((weights @ _POWERS).tolist(), ((weights * offset) @ _POWERS).tolist(), strict=True)
        before, lines = lines, np.array([_line(*side) for side in sums])
        if np.abs(lines - before).max() < _SETTLED_PX:
            break
        away = offset - lines @ _POWERS.T[:2]
    return lines[:, 0], lines[:, 1]


def _line(weights: list[float], values: list[float]) -> tuple[float, float]:
    """Intercept and slope, from the sums of 1, t, t^2 and of x, t x, t^2 x."""
    (one, t, tt), (x, tx, _) = weights, values
    slope = (one * tx - t * x) / (one * tt - t * t)
    return (x - slope * t) / one, slope


def _meetings(point: Pixels, way: Pixels) -> Pixels:
    """(4,) where each side, by a point of it and a way along it, meets the one before it."""
    before = way[_BEFORE]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = _cross(before, point[_BEFORE] - point) / _cross(before, way)
        return point + far * way


def _cross(a: Pixels, b: Pixels) -> Array:
    """(4,) parallelogram that two ways span, positive when `b` is clockwise of `a` as seen."""
    return (a.conj() * b).imag
