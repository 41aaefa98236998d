"""Sub-pixel corners of a dark quadrangle on light ground: a straight line fitted to each side.

A corner is where two sides meet. Each side has tens of edge points, so their lines are known far
better than the few pixels at the corner itself would tell, and a corner that is a little worn or
covered does no harm.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.types import Array
from vita.vision.images import Crop, Gray

_ALONG = np.linspace(0.07, 0.93, 22)
"""Where along each side the edge is looked for; the ends belong to the corners."""
_STEP = 0.5
"""Distance of the samples across a side [px]."""
_TUKEY = 4.0


def refined(crop: Crop, corners: Array, cell: float) -> Array | None:
    """(4, 2) corners of the quadrangle near `corners`, which are clockwise as seen; None where there is none.

    `cell` [px] is the width of the dark frame: the edge is sought within less than it, so that what
    is printed inside does not pull.
    """
    image = crop.blurred(0.6)
    half = float(np.clip(0.42 * cell, 1.5, 4.0))
    now, extra = corners, 1.0
    for _ in range(4):
        lines = _sides(image, now - crop.origin, half + extra)
        if lines is None:
            return None
        before, now = now, _meetings(lines) + crop.origin
        if not np.isfinite(now).all() or np.abs(now - corners).max() > max(3.0, 0.8 * cell):
            return None
        moved = np.abs(now - before).max()
        if extra == 0.0 and moved < 0.1:
            break
        # Once near, the narrowest window sees the whole edge and least of what is beside it.
        extra = 0.0 if moved < 1.0 else 0.5
    return now


def _sides(image: Gray, corners: Array, half: float) -> Array | None:
    """(4, 3) lines n.x = c of the sides, as rows (n_u, n_v, c), n of any length; None without clear edges."""
    ends = np.roll(corners, -1, axis=0)
    run = ends - corners
    length = np.linalg.norm(run, axis=1)
    if length.min() < 6:
        return None
    outward = np.stack([run[:, 1], -run[:, 0]], axis=1) / length[:, None]
    across = np.arange(-half, half + 1e-6, _STEP)
    points = corners[:, None] + _ALONG[None, :, None] * run[:, None]  # side, along, uv
    places = points[:, :, None] + across[None, None, :, None] * outward[:, None, None]
    values = _sampled(image, places)
    rise = np.maximum(np.diff(values, axis=2), 0.0)
    rise = np.maximum(rise - 0.1 * rise.max(axis=2, keepdims=True), 0.0)
    total = rise.sum(axis=2)
    middle = 0.5 * (across[1:] + across[:-1])
    offset = (rise @ middle) / (total + 1e-9)
    clear = total > max(4.0, 0.35 * float(np.median(total)))
    height, width = image.shape
    tips = places[:, :, (0, -1)]
    clear &= np.all((tips >= 0) & (tips <= (width - 1, height - 1)), axis=(2, 3))
    if clear.sum(axis=1).min() < 8:
        return None
    tilt, shift = _lines(offset, clear)
    a = corners + shift[:, None] * outward
    b = ends + (shift + tilt)[:, None] * outward
    normals = np.stack([b[:, 1] - a[:, 1], a[:, 0] - b[:, 0]], axis=1)
    return np.column_stack([normals, (normals * a).sum(axis=1)])


def _sampled(image: Gray, places: Array) -> Array:
    """Values of `image` at (..., 2) pixels, bilinear."""
    flat = places.reshape(places.shape[0], -1, 2).astype(np.float32)
    mapped = cv2.remap(image, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return np.asarray(mapped, np.float64).reshape(places.shape[:-1])


def _lines(offset: Array, clear: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Slope and intercept (4,) of each side's `offset` (4, k) along it, weighted against outliers (Tukey)."""
    slope, shift = np.zeros(4), np.zeros(4)
    for k in range(3):
        residual = offset - slope[:, None] * _ALONG - shift[:, None] if k else offset - _middle(offset, clear)
        scale = np.maximum(1.4826 * _middle(np.abs(residual), clear), 0.05)
        weights = clear * np.square(np.maximum(0.0, 1.0 - np.square(residual / (_TUKEY * scale))))
        total = weights.sum(axis=1) + 1e-12
        t, x = weights @ _ALONG / total, (weights * offset).sum(axis=1) / total
        away = weights * (_ALONG - t[:, None])
        slope = (away * (offset - x[:, None])).sum(axis=1) / (
            (away * (_ALONG - t[:, None])).sum(axis=1) + 1e-12
        )
        shift = x - slope * t
    return slope, shift


def _middle(values: Array, clear: NDArray[np.bool_]) -> Array:
    """(4, 1) medians of the rows over their clear entries."""
    ordered = np.sort(np.where(clear, values, np.inf), axis=1)
    return np.take_along_axis(ordered, clear.sum(axis=1, keepdims=True) // 2, axis=1)


def _meetings(lines: Array) -> Array:
    """(4, 2) where each side meets the one before it: corner k lies between sides k - 1 and k."""
    before = np.roll(lines, 1, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        det = before[:, 0] * lines[:, 1] - before[:, 1] * lines[:, 0]
        u = (before[:, 2] * lines[:, 1] - lines[:, 2] * before[:, 1]) / det
        v = (before[:, 0] * lines[:, 2] - lines[:, 0] * before[:, 2]) / det
    return np.stack([u, v], axis=1)
