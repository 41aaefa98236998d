"""The memory of a region by its SIFT features: where, and how turned and scaled, it is in a frame.

Features after Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.errors import Untrackable
from vita.types import Array, Image
from vita.vision import warps
from vita.vision.images import to_gray

LEAST_FEATURES = 12
"""Fewer features than this in a region are too few to know it again by."""
LEAST_AGREEING = 5
"""Matches that must agree on one pose for the patch tracker to be asked about it."""
RATIO = 0.8
"""Lowe's ratio test: the best match must be this much nearer than the second best."""
_MOST = 800
"""Features of one look, strongest first."""
_SCALES, _SMALL_SCALES, _SMALL_PX = (0.5, 1.0), (0.5, 1.0, 2.0), 48
"""Sizes at which a region is learned; one of fewer pixels than that is enlarged too."""
Descriptors = NDArray[np.float32]


class Memory:
    """Features of one region, in the coordinates of its own square [-1, 1]^2."""

    def __init__(self, frame: Image, warp: Array) -> None:
        """`warp` (3, 3) carries the square to the pixels of `frame`. Raises `Untrackable`."""
        outline = warps.corners(warp)
        self.side = float((outline.max(axis=0) - outline.min(axis=0)).max())
        margin = 0.15 * self.side
        low = np.maximum(np.floor(outline.min(axis=0) - margin), 0).astype(int)
        high = np.ceil(outline.max(axis=0) + margin).astype(int) + 1
        gray = to_gray(frame)[low[1] : high[1], low[0] : high[0]]
        into_square = np.asarray(np.linalg.inv(warp), np.float64)
        places, looks = [], []
        for scale in _SCALES if self.side >= _SMALL_PX else _SMALL_SCALES:
            points, descriptors = described(gray, scale, low)
            points = warps.apply(into_square, points)
            own = np.abs(points).max(axis=1, initial=0.0) < 1.0
            places.append(points[own])
            looks.append(descriptors[own])
        self._places: Array = np.concatenate(places)
        self._looks: Descriptors = np.concatenate(looks)
        if len(self._places) < LEAST_FEATURES:
            raise Untrackable(f"only {len(self._places)} features here, {LEAST_FEATURES} are needed.")

    def poses(self, frame: Image, look: int) -> list[Array]:
        """Warps (3, 3) from the square to the pixels of `frame` where the region may be, likeliest first.

        Features of a whole frame would take the time of several frames. Even looks go over the frame
        at half its size, odd ones over one quarter after the other at full size, for targets that
        are far away: each is about a fourth of that work.
        """
        if look % 2 == 0:
            points, descriptors = described(to_gray(frame), 0.5, np.zeros(2))
        else:
            part, origin = _quarter(frame, look // 2 % 4, self.side)
            points, descriptors = described(to_gray(part), 1.0, origin)
        if len(points) < LEAST_AGREEING:
            return []
        # Each feature of the frame asks for the one remembered feature that it is; the two scales
        # remember some twice, so the second best must be somewhere else on the region.
        found = cv2.BFMatcher(cv2.NORM_L2).knnMatch(descriptors, self._looks, k=min(4, len(self._looks)))
        here, there = [], []
        for best, *others in found:
            spot = self._places[best.trainIdx]
            rivals = [o.distance for o in others if np.abs(self._places[o.trainIdx] - spot).max() > 0.1]
            if rivals and best.distance < RATIO * rivals[0]:
                here.append(spot)
                there.append(points[best.queryIdx])
        if len(here) < LEAST_AGREEING:
            return []
        return _agreed(np.array(here), np.array(there))


def _quarter(frame: Image, which: int, overlap: float) -> tuple[Image, Array]:
    """One of the four quarters of a frame, `overlap` [px] larger than that, and its top-left pixel (2,)."""
    height, width = frame.shape[:2]
    w, h = (min(n, int(n / 2 + overlap / 2) + 1) for n in (width, height))
    x, y = (width - w) * (which % 2), (height - h) * (which // 2)
    return frame[y : y + h, x : x + w], np.array([x, y])


def described(gray: NDArray[np.uint8], scale: float, origin: Array) -> tuple[Array, Descriptors]:
    """(k, 2) frame pixels of the SIFT features of a picture, and their (k, 128) descriptors.

    The picture's top-left pixel is at `origin` (2,) of the frame; it is looked at in `scale` times its size.
    """
    if scale != 1.0:
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=way)  # type: ignore[assignment]
    features, descriptors = cv2.SIFT_create(_MOST, 3, 0.025).detectAndCompute(gray, None)  # type: ignore[attr-defined]
    if descriptors is None or not len(features):
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    points = np.array([feature.pt for feature in features], dtype=np.float64)
    return (points + 0.5) / scale - 0.5 + origin, np.asarray(descriptors, np.float32)


def _agreed(here: Array, there: Array) -> list[Array]:
    """Poses that enough matches (k, 2) `here` in the square to (k, 2) `there` in the frame agree on."""
    poses = []
    for _ in range(2):
        if len(here) < LEAST_AGREEING:
            break
        # OpenCV seeds both RANSACs the same way each time, so that runs repeat.
        rough, chosen = cv2.estimateAffinePartial2D(
            here, there, method=cv2.RANSAC, ransacReprojThreshold=4.0, maxIters=500
        )
        if rough is None or np.count_nonzero(chosen) < LEAST_AGREEING:
            break
        agree = chosen.ravel() > 0
        similar = np.vstack([rough, [0, 0, 1.0]])
        candidates = []
        if np.count_nonzero(agree) >= 2 * LEAST_AGREEING:
            bent, _ = cv2.findHomography(here, there, cv2.RANSAC, 3.0, maxIters=500)
            if bent is not None and np.isfinite(bent).all():
                candidates.append(bent)
        poses += [pose for pose in (*candidates, similar) if _possible(pose)]
        here, there = here[~agree], there[~agree]
    return poses


def _possible(pose: Array) -> bool:
    outline = warps.corners(pose)
    return bool(np.isfinite(outline).all() and warps.is_convex(outline) and warps.area(outline) > 64)
