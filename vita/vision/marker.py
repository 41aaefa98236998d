"""The marker tracker: a printed ArUco or AprilTag code, known by its number."""

from __future__ import annotations

import math

import cv2
import numpy as np

from vita.errors import Untrackable
from vita.types import Array, Feature, Image, frozen
from vita.vision import warps
from vita.vision.images import Crop, check_frame, check_pixel, inside, is_frame, to_gray
from vita.vision.marker_code import Code, detector, outliner, read
from vita.vision.quad import refined

SNAP_PX, SNAP_SHARE = 3.0, 0.12
"""A click this near to a corner or the centre means it: in pixels, or as a share of the side."""
SURE = 0.75
"""Least correlation of what is seen with the code's own black and white."""
SUGGESTIONS = 8
"""Outlines that are read to find a marker to suggest, nearest first."""
BLURRED_CELLS = 1
"""Cells that may read wrong where only the outline says that it is the same marker."""
Match = tuple[Array, float, int]
"""Refined corners (4, 2) [px], likeness to the code, cells that read wrong."""
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
        self._corners = corners
        self._velocity = np.zeros(2)
        self._missing = 0
        self._uv = frozen(self._carried(corners))

    def update(self, frame: Image) -> Feature:
        """Find the marker in the next frame."""
        if not is_frame(frame, self._size):
            return self._lost("the camera gave no usable frame")
        found = self._near(frame) if self._missing == 0 else None
        if found is None and (self._missing < 5 or self._missing % 2):
            # A whole frame takes several times as long, so one that stays away is sought less often.
            found = self._anywhere(frame)
        if found is None:
            return self._lost(f"marker {self._code.number} is not seen")
        corners, score, _ = found
        uv = self._carried(corners)
        if not inside(uv, self._size):
            return self._lost("left the view")
        self._velocity = uv - self._uv if self._missing == 0 else np.zeros(2)
        self._corners, self._uv, self._missing = corners, frozen(uv), 0
        detail = f"marker {self._code.number}, {self._spot}"
        return Feature(self._uv, "ok", score, frozen(corners), detail=detail)

    def _lost(self, why: str) -> Feature:
        self._missing += 1
        self._velocity = np.zeros(2)
        return Feature(self._uv, "lost", 0.0, frozen(self._corners), detail=why)

    def _carried(self, corners: Array) -> Array:
        """(2,) the tracked point, given where the four corners are."""
        return warps.apply(_plane(corners), self._point[None])[0]

    def _near(self, frame: Image) -> Match | None:
        """The marker around where it should be now: by its code or, when blurred, by its outline."""
        ahead = self._corners + self._velocity
        if math.hypot(*(ahead.mean(axis=0) - np.clip(ahead.mean(axis=0), 0, self._size))) > 0:
            return None
        margin = 0.4 * _side(ahead) + 12 + math.hypot(*self._velocity)
        crop = Crop.cut(frame, ahead, margin)
        # Where the outline is as predicted and every cell reads right, nothing needs to be detected.
        sharp = self._judged(crop, ahead)
        if sharp is not None and sharp[2] == 0:
            return sharp
        seen = self._seen(crop)
        if seen is not None or sharp is None:
            return seen
        return sharp if sharp[2] <= BLURRED_CELLS else None

    def _anywhere(self, frame: Image) -> Match | None:
        return self._seen(Crop(to_gray(frame), np.zeros(2)))

    def _seen(self, crop: Crop) -> Match | None:
        """The nearest marker of our number in `crop`, its corners refined, and its score."""
        quads = [
            corners for number, corners in detected(self._code.family, crop) if number == self._code.number
        ]
        here = (self._corners + self._velocity).mean(axis=0)
        for quad in sorted(quads, key=lambda q: math.hypot(*(q.mean(axis=0) - here))):
            found = self._judged(crop, quad)
            if found is not None:
                return found
        return None

    def _judged(self, crop: Crop, quad: Array) -> Match | None:
        """`quad` refined to sub-pixel and what it holds compared with the code; None if it is not ours."""
        corners = refined(crop, quad, cell=_side(quad) / self._code.across)
        if corners is None:
            return None
        score, wrong = self._code.likeness(crop, _plane(corners))
        return (corners, score, wrong) if score >= SURE else None


def detected(family: str, crop: Crop) -> list[tuple[int, Array]]:
    """Number and (4, 2) rough corners in frame pixels of every marker of one family in `crop`."""
    quads, numbers, _ = detector(family).detectMarkers(crop.gray)
    if numbers is None:
        return []
    # The detector's corners are centres of black pixels, half a pixel inside of the true outline.
    return [(int(n), crop.origin + q[0]) for n, q in zip(np.ravel(numbers), quads, strict=True)]


def _clicked(frame: Image, pixel: Array) -> tuple[Code, Array]:
    """The code under the click and its refined corners; `Untrackable` where there is none."""
    crop = Crop(to_gray(frame), np.zeros(2))
    quads = _quads(crop)
    under = [quad for quad in quads if _beyond(quad, pixel) <= max(SNAP_PX, SNAP_SHARE * _side(quad))]
    # A code within another, as in a nest of boxes: the inner one was meant.
    for quad in sorted(under, key=_side):
        found = _read(crop, quad)
        if found is not None:
            return found
    others = sorted(quads, key=lambda quad: _beyond(quad, pixel))
    for quad in others[: len(under) + SUGGESTIONS]:
        found = _read(crop, quad)
        if found is not None:
            u, v = warps.apply(_plane(found[1]), np.zeros((1, 2)))[0].tolist()
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
    corners = refined(crop, quad, cell=_side(quad) / 8)
    name = read(crop, _plane(corners)) if corners is not None else None
    if corners is None or name is None:
        return None
    code = Code(*name)
    turned = [np.roll(corners, -k, axis=0) for k in range(4)]
    likeness = [code.likeness(crop, _plane(c))[0] for c in turned]
    best = int(np.argmax(likeness))
    return (code, turned[best]) if likeness[best] >= SURE else None


def _beyond(quad: Array, pixel: Array) -> float:
    """How far a pixel is outside of an outline, negative inside [px]."""
    return -cv2.pointPolygonTest(quad.astype(np.float32)[:, None], pixel.tolist(), True)


def _snapped(pixel: Array, corners: Array) -> tuple[Array, str]:
    """(2,) the clicked point in the marker's square, moved to a near corner or the centre, and its name."""
    plane = _plane(corners)
    reach = max(SNAP_PX, SNAP_SHARE * _side(corners))
    away = {
        name: math.hypot(*(warps.apply(plane, np.array([spot]))[0] - pixel)) for name, spot in _SPOTS.items()
    }
    nearest = min(away, key=lambda name: away[name])
    if away[nearest] <= reach:
        return np.array(_SPOTS[nearest]), nearest
    return warps.apply(np.asarray(np.linalg.inv(plane), np.float64), pixel[None])[0], "a point on it"


_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)


def _plane(corners: Array) -> Array:
    """(3, 3) homography from the marker's square [-1, 1]^2 to the image."""
    return np.asarray(cv2.getPerspectiveTransform(_SQUARE, corners.astype(np.float32)), np.float64)


def _side(corners: Array) -> float:
    """Mean side of a quadrangle [px]."""
    return float(np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).mean())
