"""Coarse motion between two frames by sparse optical flow, to start registration close enough."""

from __future__ import annotations

import cv2
import numpy as np

from vita.types import Array
from vita.vision import warps
from vita.vision.images import Crop

_AXIS = np.linspace(-0.85, 0.85, 5)
_POINTS = np.array([(x, y) for y in _AXIS for x in _AXIS])


def carry(before: Crop, after: Crop, warp: Array) -> Array | None:
    """`warp` of the frame of `before`, carried to the frame of `after` by a similarity.

    25 points are followed forward and back; those that come home agree on a similarity by RANSAC
    (OpenCV seeds it the same way each time, so that runs repeat). None when too few agree.
    """
    start = warps.apply(warp, _POINTS)
    # Both crops need the same origin and size for the flow: the smaller is cut from either.
    low = np.maximum(before.origin, after.origin).astype(int)
    high = np.minimum(
        before.origin + np.array(before.raw.shape[1::-1]), after.origin + np.array(after.raw.shape[1::-1])
    ).astype(int)
    if np.any(high - low < 16):
        return None
    pair = []
    for crop in (before, after):
        x0, y0 = (low - crop.origin).astype(int)
        x1, y1 = (high - crop.origin).astype(int)
        pair.append(np.ascontiguousarray(crop.gray[y0:y1, x0:x1]))
    here = (start - low).astype(np.float32)[:, None]
    options = {"winSize": (15, 15), "maxLevel": 3}
    there, seen, _ = cv2.calcOpticalFlowPyrLK(pair[0], pair[1], here, None, **options)  # type: ignore[call-overload]
    back, seen_back, _ = cv2.calcOpticalFlowPyrLK(pair[1], pair[0], there, None, **options)  # type: ignore[call-overload]
    home = np.linalg.norm((back - here)[:, 0], axis=1)
    good = (seen.ravel() > 0) & (seen_back.ravel() > 0) & (home < 1.0)
    if good.sum() < 5:
        return None
    step, _ = cv2.estimateAffinePartial2D(
        start[good].astype(np.float32),
        (there[good, 0] + low).astype(np.float32),
        method=cv2.RANSAC,
        ransacReprojThreshold=1.5,
    )
    if step is None or not np.isfinite(step).all():
        return None
    return np.vstack([step, [0, 0, 1.0]]) @ warp
