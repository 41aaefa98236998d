"""What `auto` does: choosing the tracker that holds best on to what was clicked."""

from __future__ import annotations

import cv2
import numpy as np

from vita.errors import Untrackable
from vita.types import Array, Image
from vita.vision.base import Tracker
from vita.vision.blob import BlobTracker
from vita.vision.ellipse import EllipseTracker
from vita.vision.images import check_frame, check_pixel, to_gray
from vita.vision.marker import MarkerTracker
from vita.vision.patch import PatchTracker
from vita.vision.point import PointTracker

PLAIN = 8.0
"""Standard deviation of the fine detail below which the inside of a disc is plain [grey levels]."""
CENTRAL = 0.5
"""Share of a disc's radius within which a click means the disc, and not a place on it."""
LARGEST_DISC = 160.0
"""Diameter beyond which a plain round thing is scenery [px]."""


def best_tracker(frame: Image, uv: object, size_px: float | None) -> Tracker:
    """The tracker for pixel `uv` (2,) of `frame`. Raises as `make_tracker` does.

    A marker is known by its number and cannot be mistaken for another. A plain disc has nothing but
    its rim, and a square region around it would be half background. Anything else with texture is a
    patch, which is the most precise. A spot too small for that may be a point, and what has only a
    colour is a blob. Whoever asks for a size asks for a patch.
    """
    pixel = check_pixel(uv, check_frame(frame))
    if size_px is None:
        special = _marker(frame, pixel) or _disc(frame, pixel)
        if special is not None:
            return special
    refusal: Untrackable | None = None
    for maker in (PatchTracker, PointTracker, BlobTracker):
        try:
            return maker(frame, pixel, size_px=size_px)
        except Untrackable as failure:
            # The first reason and suggestion are about texture, which people can look for.
            refusal = refusal or failure
    assert refusal is not None
    raise refusal


def _marker(frame: Image, pixel: Array) -> Tracker | None:
    try:
        return MarkerTracker(frame, pixel)
    except Untrackable:
        return None


def _disc(frame: Image, pixel: Array) -> Tracker | None:
    """A tracker of the plain disc whose middle was clicked, if that is what was clicked."""
    try:
        tracker = EllipseTracker(frame, pixel, suggest=False)
    except Untrackable:
        return None
    feature = tracker.update(frame)
    if not feature.ok or feature.outline is None:
        return None
    radius = np.hypot(*(feature.outline - feature.uv).T)
    off = float(np.hypot(*(pixel - feature.uv)))
    central = off <= CENTRAL * float(radius.min()) and 2 * float(radius.max()) <= LARGEST_DISC
    return tracker if central and _detail(frame, feature.uv, feature.outline) < PLAIN else None


def _detail(frame: Image, center: Array, outline: Array) -> float:
    """Standard deviation of what is finer than the shading inside an outline (k, 2) [grey levels]."""
    inner = center + 0.7 * (outline - center)
    low = np.maximum(np.floor(inner.min(axis=0)).astype(int), 0)
    high = np.ceil(inner.max(axis=0)).astype(int) + 1
    gray = to_gray(frame[low[1] : high[1], low[0] : high[0]]).astype(np.float32)
    inside = np.zeros(gray.shape, np.uint8)
    cv2.fillConvexPoly(inside, np.rint(inner - low).astype(np.int32), 1)
    sigma = max(1.0, min(gray.shape) / 8)
    # Normalised, so that what lies beyond the rim does not shine in.
    weight = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), sigma)
    soft = cv2.GaussianBlur(gray * inside, (0, 0), sigma) / np.maximum(weight, 1e-6)
    return float((gray - soft)[inside > 0].std()) if inside.any() else 0.0
