"""Where an ellipse may be: around a clicked pixel, near it, or where it went from frame to frame."""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np

from vita.types import Array, Image
from vita.vision.edges import WEAKEST, Tint, cut
from vita.vision.images import Gray
from vita.vision.oval import Oval

LARGEST = 320.0
"""Longest diameter [px]."""
_FIXED, _FLOATING = (5, 8, 12, 18, 26, 38, 55, 80), (1, 2, 3, 5)
"""Tolerances of the flood fill against the clicked pixel, and from pixel to pixel [grey levels]."""


def around(frame: Image, pixel: Array, size_px: float | None, tint: Tint) -> Iterator[Oval]:
    """Ellipses that the even region around a pixel may have, by flood fill with many tolerances."""
    limit = LARGEST if size_px is None else 1.3 * size_px
    crop = cut(frame, pixel[None], limit, tint)
    soft = np.clip(np.rint(crop.blurred(0.8)), 0, 255).astype(np.uint8)
    seed = np.clip(np.rint(pixel - crop.origin), 0, np.array(soft.shape[::-1]) - 1).astype(int).tolist()
    for flag, tolerances in ((cv2.FLOODFILL_FIXED_RANGE, _FIXED), (0, _FLOATING)):
        last = 0
        for tolerance in tolerances:
            mask = np.zeros((soft.shape[0] + 2, soft.shape[1] + 2), np.uint8)
            flags = 4 | flag | cv2.FLOODFILL_MASK_ONLY | (255 << 8)
            area, _, _, _ = cv2.floodFill(soft, mask, seed, 0, tolerance, tolerance, flags)
            if area == last:
                continue
            last = area
            if area > 0.9 * soft.size:
                break
            oval = _outline(mask[1:-1, 1:-1])
            if oval is not None and max(oval.diameters) < limit:
                yield oval.shifted(crop.origin)


def nearest(frame: Image, pixel: Array, tint: Tint) -> Iterator[Oval]:
    """Round spots that differ from what is around them, nearest first; at most eight."""
    crop = cut(frame, pixel[None], LARGEST, tint)
    gray = np.clip(np.rint(crop.blurred(1.0)), 0, 255).astype(np.uint8)
    found = []
    for block in (31, 101):
        for kind in (cv2.THRESH_BINARY, cv2.THRESH_BINARY_INV):
            offset = -WEAKEST if kind == cv2.THRESH_BINARY else WEAKEST
            mask = cv2.adaptiveThreshold(gray, 255, cv2.ADAPTIVE_THRESH_MEAN_C, kind, block, offset)
            contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
            found += [oval for c in contours if (oval := _fitted(c)) is not None]
    found = [oval.shifted(crop.origin) for oval in found]
    found.sort(key=lambda oval: float(np.hypot(*(oval.center - pixel))))
    return iter(found[:8])


def _outline(mask: np.ndarray) -> Oval | None:
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return None
    # Smoothing cuts whiskers off, where the fill leaked a little through a weak edge.
    largest = max(contours, key=len)
    return _fitted(largest) or _fitted(cv2.convexHull(largest))


def _fitted(contour: np.ndarray) -> Oval | None:
    """The ellipse of a contour; None when it is something else."""
    if len(contour) < 12:
        return None
    (u, v), (width, height), angle = cv2.fitEllipseDirect(contour)
    # A contour runs through the middle of the region's outermost pixels.
    a, b = (width + 1) / 2, (height + 1) / 2
    if not (math.isfinite(a + b + u + v) and min(a, b) > 2.5 and max(a, b) < LARGEST / 2):
        return None
    ratio = (cv2.contourArea(contour) + 0.5 * len(contour) + 1) / (math.pi * a * b)
    return Oval.from_axes((u, v), (a, b), math.radians(angle)) if 0.8 < ratio < 1.25 else None


def vote(
    frame: Image, oval: Oval, speed: Array, height: float, reach: float, tint: Tint, count: int = 2
) -> list[Oval]:
    """Where the outline finds most edges of the right sign: `oval` shifted, likeliest first.

    Every gradient is cut to one edge's height and multiplied with the outline's normal there, so
    that a strong edge nearby counts no more than any other (after Steger, "Similarity measures for
    occlusion, clutter, and illumination invariant object recognition", 2001).
    """
    shrink = float(np.clip(48 / oval.diameters[0], 0.2, 1.0))
    crop = cut(frame, oval.points(16), reach + 3, tint)
    size = np.maximum(np.rint(np.array(crop.gray.shape[::-1]) * shrink), 8).astype(int)
    scale = size / crop.gray.shape[::-1]
    gray = cv2.resize(crop.gray, size.tolist(), interpolation=cv2.INTER_AREA).astype(np.float32)
    gray = cv2.GaussianBlur(gray, (0, 0), 1.0)
    gx = cv2.Sobel(gray, cv2.CV_32F, 1, 0, ksize=1, scale=0.5)
    gy = cv2.Sobel(gray, cv2.CV_32F, 0, 1, ksize=1, scale=0.5)
    # A step of height h blurred by one pixel has a slope of 0.4 h; blurred more, less.
    full = 0.25 * height
    unit = 1 / np.maximum(np.hypot(gx, gy), abs(full)) * math.copysign(1.0, full)
    points, normals, _ = oval.samples(64)
    local = np.rint((points - oval.center) * scale).astype(int)
    low = local.min(axis=0)
    extent = local.max(axis=0) - low + 1
    if np.any(extent >= size):
        return []
    total = np.float32(0)
    for gradient, normal in ((gx, normals[:, 0]), (gy, normals[:, 1])):
        mark = np.zeros(extent[::-1], np.float32)
        np.add.at(mark, (local[:, 1] - low[1], local[:, 0] - low[0]), normal / len(points))
        total = total + cv2.matchTemplate(np.asarray(gradient * unit, np.float32), mark, cv2.TM_CCORR)
    return _peaks(np.asarray(total), oval, low, scale, crop.origin, speed, reach, count)


def _peaks(
    total: Gray, oval: Oval, low: Array, scale: Array, origin: Array, speed: Array, reach: float, count: int
) -> list[Oval]:
    """The best shifts; of two alike the one nearer to where it is expected."""
    u = (np.arange(total.shape[1]) - low[0] + 0.5) / scale[0] - 0.5 + origin[0] - oval.center[0]
    v = (np.arange(total.shape[0]) - low[1] + 0.5) / scale[1] - 0.5 + origin[1] - oval.center[1]
    far = np.square(u - speed[0]) + np.square(v - speed[1])[:, None]
    total = total - (0.1 / reach**2) * far
    found = []
    for _ in range(count):
        y, x = divmod(int(total.argmax()), total.shape[1])
        if total[y, x] < 0.15:
            break
        found.append(oval.shifted(np.array([u[x], v[y]])))
        total[max(0, y - 3) : y + 4, max(0, x - 3) : x + 4] = -1
    return found
