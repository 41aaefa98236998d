"""The marker tracker: a printed ArUco or AprilTag code, known by its number."""

from __future__ import annotations

import math

import cv2
import numpy as np

from vita.errors import Untrackable
from vita.types import Array, Feature, Image, frozen
from vita.vision import warps
from vita.vision.images import Crop, check_frame, check_pixel, inside, is_frame, to_gray
from vita.vision.marker_code import Code, outliner, read
from vita.vision.marker_follow import SURE, MarkerFollower, plane_of, side_of
from vita.vision.quad import refined

SNAP_PX, SNAP_SHARE = 3.0, 0.12
"""A click this near to a corner or the centre means it: in pixels, or as a share of the side."""
SUGGESTIONS = 8
"""Outlines that are read to find a marker to suggest, nearest first."""
_SPOTS = {
    "centre": (0.0, 0.0), "corner 1": (-1.0, -1.0), "corner 2": (1.0, -1.0),
    "corner 3": (1.0, 1.0), "corner 4": (-1.0, 1.0),
}  # fmt: skip


class MarkerTracker:
    """Follows the clicked point on the plane of a printed code; look-alikes have other numbers.

    `corners` are in the code's own order: clockwise from its own top-left, which is corner 1.
    """

    kind = "marker"

    def __init__(self, frame: Image, uv: object, *, size_px: float | None = None) -> None:
        """`size_px` is ignored: the marker has its own size."""
        del size_px
        self._size = check_frame(frame)
        pixel = check_pixel(uv, self._size)
        self._code, corners = _clicked(frame, pixel)
        self._point, self._spot = _snapped(pixel, corners)
        self._follower = MarkerFollower(self._code, corners)
        self._uv = frozen(self._carried(corners))

    def update(self, frame: Image) -> Feature:
        """Find the marker in the next frame."""
        if not is_frame(frame, self._size):
            return self._lost("the camera gave no usable frame")
        follower = self._follower
        found = follower.near(frame)
        if found is None and (follower.missing < 5 or follower.missing % 2):
            # A whole frame takes several times as long, so one that stays away is sought less often.
            found = follower.within(Crop(to_gray(frame), np.zeros(2)))
        if found is None:
            return self._lost(f"marker {self._code.number} is not seen")
        uv = self._carried(found.corners)
        if not inside(uv, self._size):
            return self._lost("left the view")
        follower.follow(found, uv - self._uv)
        self._uv = frozen(uv)
        detail = f"marker {self._code.number}, {self._spot}"
        return Feature(self._uv, "ok", found.score, frozen(found.corners), detail=detail)

    def _lost(self, why: str) -> Feature:
        self._follower.lose()
        return Feature(self._uv, "lost", 0.0, frozen(self._follower.corners), detail=why)

    def _carried(self, corners: Array) -> Array:
        """(2,) the tracked point, given where the four corners are."""
        return warps.apply(plane_of(corners), self._point[None])[0]


def _clicked(frame: Image, pixel: Array) -> tuple[Code, Array]:
    """The code under the click and its refined corners; `Untrackable` where there is none."""
    crop = Crop(to_gray(frame), np.zeros(2))
    quads = _quads(crop)
    under = [quad for quad in quads if _beyond(quad, pixel) <= max(SNAP_PX, SNAP_SHARE * side_of(quad))]
    # A code within another, as in a nest of boxes: the inner one was meant.
    for quad in sorted(under, key=side_of):
        found = _read(crop, quad)
        if found is not None:
            return found
    others = sorted(quads, key=lambda quad: _beyond(quad, pixel))
    for quad in others[: len(under) + SUGGESTIONS]:
        found = _read(crop, quad)
        if found is not None:
            u, v = warps.apply(plane_of(found[1]), np.zeros((1, 2)))[0].tolist()
            raise Untrackable(
                f"no ArUco or AprilTag marker here. The nearest is at pixel ({u:.0f}, {v:.0f}).",
                suggestion=(u, v),
            )
    raise Untrackable("no ArUco or AprilTag marker here, nor anywhere else in this picture.")


def _quads(crop: Crop) -> list[Array]:
    """(4, 2) outlines of everything that could be a marker of whatever family [px]."""
    known, _, unknown = outliner().detectMarkers(crop.gray)
    return [crop.origin + quad[0] for quad in (*known, *unknown)]


def _read(crop: Crop, quad: Array) -> tuple[Code, Array] | None:
    """The code in an outline, and its corners in the code's own order."""
    corners = refined(crop, quad, cell=side_of(quad) / 8)
    name = read(crop, plane_of(corners)) if corners is not None else None
    if corners is None or name is None:
        return None
    code = Code(*name)
    turned = [np.roll(corners, -k, axis=0) for k in range(4)]
    likeness = [code.likeness(crop, plane_of(c))[0] for c in turned]
    best = int(np.argmax(likeness))
    return (code, turned[best]) if likeness[best] >= SURE else None


def _beyond(quad: Array, pixel: Array) -> float:
    """How far a pixel is outside of an outline, negative inside [px]."""
    return -cv2.pointPolygonTest(quad.astype(np.float32)[:, None], pixel.tolist(), True)


def _snapped(pixel: Array, corners: Array) -> tuple[Array, str]:
    """(2,) the clicked point in the marker's square, moved to a near corner or the centre, and its name."""
    plane = plane_of(corners)
    reach = max(SNAP_PX, SNAP_SHARE * side_of(corners))
    away = {
        name: math.hypot(*(warps.apply(plane, np.array([spot]))[0] - pixel)) for name, spot in _SPOTS.items()
    }
    nearest = min(away, key=lambda name: away[name])
    if away[nearest] <= reach:
        return np.array(_SPOTS[nearest]), nearest
    return warps.apply(np.asarray(np.linalg.inv(plane), np.float64), pixel[None])[0], "a point on it"
