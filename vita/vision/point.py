"""The point tracker: a corner or a small spot, followed by optical flow and registered at once."""

from __future__ import annotations

import math
from typing import Literal

import cv2
import numpy as np

from vita.errors import Untrackable
from vita.types import Array, Feature, Image, frozen
from vita.vision import search, warps
from vita.vision.images import Crop, check_frame, check_pixel, inside, is_frame, to_gray
from vita.vision.texture import SMALLEST, choose_region
from vita.vision.window import Found, Window

WINDOW = 21.0
"""Side of the square that is looked at unless another is asked for [px]."""
SURE = 0.96
"""A plain fit that correlates this well needs no second look."""
GOOD_SCORE, GOOD_SHARE = 0.9, 0.5
"""A robust fit is taken from this weighted correlation and share of agreeing pixels on."""
FOUND = 0.85
"""What a lost point's score must reach to count as found again: it may be anywhere."""
REACH = 16.0
"""Motion from frame to frame that optical flow has to bridge [px]."""


class PointTracker:
    """Pyramidal optical flow (Bouguet's KLT), then registration against the first window.

    The flow alone drifts, and sits still on the background once its point is covered. So it only
    says where to start; the first window says where the point is, and whether it is there at all.
    """

    kind = "point"

    def __init__(self, frame: Image, uv: object, *, size_px: float | None = None) -> None:
        self._size = check_frame(frame)
        self._uv = check_pixel(uv, self._size)
        try:
            center, self._side = choose_region(frame, self._uv, WINDOW if size_px is None else size_px)
        except Untrackable as error:
            raise _refusal(frame, self._uv) from error
        self._warp = warps.square(center, self._side / 2)
        self._point = ((self._uv - center) / (self._side / 2))[None]
        self._before = Crop.cut(frame, warps.corners(self._warp), REACH)
        n = int(np.clip(round(self._side), SMALLEST, 31))
        self._window = Window(self._before, self._warp, n, 6, self._point[0])
        self._velocity = np.zeros(2)
        self._covered = False
        self._missing = 0

    def update(self, frame: Image) -> Feature:
        """Find the point in the next frame."""
        if not is_frame(frame, self._size):
            return self._lost("the camera gave no usable frame", 0.0)
        reach = REACH + math.hypot(*self._velocity)
        crop = Crop.cut(frame, warps.corners(self._warp), reach)
        fit = self._follow(crop) if not self._missing else None
        if fit is None:
            fit, crop = self._search(frame)
        if fit is None or crop is None:
            return self._lost("covered, or changed too much", 0.0)
        uv = warps.apply(fit.warp, self._point)[0]
        if not inside(uv, self._size):
            return self._lost("left the view", fit.quality)
        self._velocity = np.zeros(2) if self._missing else uv - self._uv
        self._uv, self._warp, self._before, self._missing = frozen(uv), fit.warp, crop, 0
        self._covered = fit.share < 0.95
        self._window.learn(fit.agree)
        return self._feature("ok", fit.quality, f"point, {self._side:.0f} px window")

    def _feature(self, status: Literal["ok", "lost"], score: float, detail: str) -> Feature:
        score = float(np.clip(score, 0, 1))
        return Feature(self._uv, status, score, frozen(warps.corners(self._warp)), detail=detail)

    def _lost(self, why: str, score: float) -> Feature:
        self._missing += 1
        self._velocity = np.zeros(2)
        return self._feature("lost", score, why)

    def _follow(self, crop: Crop) -> Found | None:
        """The best fit near the last place, from the cheapest start that will do."""
        ahead = warps.shift(self._velocity) @ self._warp
        if not self._covered:
            fit = self._plain(crop, ahead)
            if fit is not None:
                return fit
        # Background that stays behind may fit as well, so every start is tried before one is taken.
        starts = [start for start in (self._flow(crop), ahead, self._warp) if start is not None]
        best = None
        for start in starts[:2] if self._covered else starts:
            fit = self._plain(crop, start) or self._robust(crop, start)
            if fit is not None and (best is None or fit.quality > best.quality):
                best = fit
            if best is not None and best.share > 0.95:
                break
        return best

    def _flow(self, crop: Crop) -> Array | None:
        """Where optical flow sees the window now, starting from the frame before."""
        low = np.maximum(self._before.origin, crop.origin)
        ends = [c.origin + c.gray.shape[::-1] for c in (self._before, crop)]
        high = np.minimum(*ends)
        if np.any(high - low < 16):
            return None
        pair = []
        for c in (self._before, crop):
            (x0, y0), (x1, y1) = (low - c.origin).astype(int), (high - c.origin).astype(int)
            pair.append(np.ascontiguousarray(c.gray[y0:y1, x0:x1]))
        center = self._uv
        here = (center - low).astype(np.float32)[None]
        side = max(7, int(0.5 * self._side)) | 1
        there, seen, _ = cv2.calcOpticalFlowPyrLK(
            pair[0], pair[1], here, here.copy(), winSize=(side, side), maxLevel=2
        )
        return warps.shift(there[0] + low - center) @ self._warp if seen[0, 0] else None

    def _plain(self, crop: Crop, start: Array) -> Found | None:
        """Least-squares fit from `start`; None unless it is beyond doubt."""
        near = crop.part(warps.corners(start), 5)
        fit = self._window.align(near, self._steady(near, start), rounds=12)
        return fit if fit.score >= SURE and self._sane(fit.warp, start) else None

    def _robust(self, crop: Crop, start: Array) -> Found | None:
        """Robust fit from `start`, for a window that is covered in part; None unless it is good."""
        near = crop.part(warps.corners(start), 5)
        # Four numbers only: the pixels that are left cannot tell a lean from what moves behind.
        fit = self._window.align(near, self._steady(near, start), rounds=8, robust=True, dof=4)
        good = fit.score >= GOOD_SCORE and fit.share >= GOOD_SHARE
        return fit if good and self._sane(fit.warp, start) else None

    def _steady(self, near: Crop, start: Array) -> Array:
        """`start` shifted only, unless the point hardly moves: the larger fit may run away from afar."""
        if not self._missing and math.hypot(*self._velocity) < 2.0:
            return start
        return self._window.align(near, start, rounds=2, dof=2).warp

    def _search(self, frame: Image) -> tuple[Found | None, Crop | None]:
        """Look for the window around the last place, further away the longer it is missing."""
        if self._missing > 4 and self._missing % 2:
            return None, None
        radius = min(REACH + 4.0 * self._missing, 60.0)
        for start in search.candidates(frame, self._window.shape, [self._warp], radius):
            crop = Crop.cut(frame, warps.corners(start), REACH)
            fit = self._plain(crop, start) or self._robust(crop, start)
            if fit is not None and fit.quality >= FOUND:
                return fit, crop
        return None, None

    def _sane(self, warp: Array, start: Array) -> bool:
        """Whether a pose is possible at all, and near to where registration started."""
        if not np.isfinite(warp).all():
            return False
        ratio = warps.area(warps.corners(warp)) / self._side**2
        reach = np.abs(warp[:2, 2] - start[:2, 2]).max()
        return bool(0.2 < ratio < 5 and reach < 0.5 * self._side)


def _refusal(frame: Image, uv: Array) -> Untrackable:
    """There is nothing here; where is the nearest good corner?"""
    said = "no corner or spot to hold on to here: the picture is too even, or a straight edge."
    gray = to_gray(frame)
    corners = cv2.goodFeaturesToTrack(gray, 400, 0.02, 4, blockSize=5)
    for place in _by_distance(corners, uv):
        try:
            choose_region(frame, place, WINDOW)
        except Untrackable:
            continue
        fine = cv2.cornerSubPix(
            gray, place.astype(np.float32).reshape(1, 1, 2), (5, 5), (-1, -1),
            (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.01),
        )
        u, v = np.asarray(fine, np.float64).ravel().tolist()
        return Untrackable(f"{said} The nearest good corner is at ({u:.0f}, {v:.0f}).", suggestion=(u, v))
    return Untrackable(f"{said} There is no good corner in this picture.")


def _by_distance(corners: np.ndarray | None, uv: Array) -> Array:
    """(k, 2) at most 20 corners, nearest to `uv` first."""
    if corners is None:
        return np.zeros((0, 2))
    places = corners.reshape(-1, 2).astype(np.float64)
    return places[np.argsort(np.hypot(*(places - uv).T), kind="stable")[:20]]
