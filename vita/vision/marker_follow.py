"""One printed code from frame to frame: by its outline where it should be, else near there by its number."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from vita.types import Array, Image
from vita.vision.images import Crop
from vita.vision.marker_code import Code, detector
from vita.vision.quad import refined

SURE = 0.75
"""Least correlation of what is seen with the code's own black and white."""
BLURRED_CELLS = 1
"""Cells that may read wrong where only the outline says that it is the same marker."""
Found = tuple[int, Array]
"""Number and rough corners (4, 2) [px] of something that the detector took for a marker."""


Finder = Callable[[Crop], list[Found]]


@dataclass(frozen=True, eq=False)
class Match:
    """A marker as one picture shows it."""

    corners: Array
    """(4, 2) refined, clockwise from the code's own top-left [px]."""
    score: float
    """Likeness to the code, 0 to 1."""
    wrong: int
    """Cells that read as the other colour."""


class MarkerFollower:
    """Remembers where one code was and how it moved."""

    def __init__(self, code: Code, corners: Array | None = None, find: Finder | None = None) -> None:
        """`corners` (4, 2) [px] where it is seen now, if that is known; `find` looks for it in a picture."""
        self.code = code
        self._find = find or (lambda crop: detected(code.family, crop))
        self.corners = corners
        """(4, 2) where it was seen last [px]; None before that."""
        self.velocity = np.zeros(2)
        """Its way from the frame before the last [px]."""
        self.missing = 0 if corners is not None else 1
        """Frames since it was seen."""

    def follow(self, match: Match, moved: Array | None = None) -> None:
        """Go on from `match`; `moved` (2,) is the way since the last frame, else that of the middle [px]."""
        if self.missing or self.corners is None:
            self.velocity = np.zeros(2)
        else:
            self.velocity = (match.corners - self.corners).mean(axis=0) if moved is None else moved
        self.corners, self.missing = match.corners, 0

    def lose(self) -> None:
        """It was not seen in this frame."""
        self.missing += 1
        self.velocity = np.zeros(2)

    def near(self, frame: Image) -> Match | None:
        """The marker around where it should be now: by its code or, when blurred, by its outline."""
        if self.missing or self.corners is None:
            return None
        ahead = self.corners + self.velocity
        u, v = middle_of(ahead)
        if not (0 <= u <= frame.shape[1] and 0 <= v <= frame.shape[0]):
            return None
        margin = 0.4 * side_of(ahead) + 12 + math.hypot(*self.velocity)
        crop = Crop.cut(frame, ahead, margin)
        # Where the outline is as predicted and every cell reads right, nothing needs to be detected.
        sharp = judged(self.code, crop, ahead)
        if sharp is not None and sharp.wrong == 0:
            return sharp
        seen = self.within(crop)
        if seen is not None or sharp is None:
            return seen
        return sharp if sharp.wrong <= BLURRED_CELLS else None

    def within(self, crop: Crop) -> Match | None:
        """The marker anywhere in `crop`."""
        return self.among(crop, self._find(crop))

    def among(self, crop: Crop, found: Iterable[Found]) -> Match | None:
        """The nearest of our number among what was found in `crop`, refined and compared with the code."""
        quads = [corners for number, corners in found if number == self.code.number]
        if self.corners is not None:
            here = middle_of(self.corners + self.velocity)
            quads.sort(key=lambda quad: math.dist(middle_of(quad), here))
        for quad in quads:
            match = judged(self.code, crop, quad)
            if match is not None:
                return match
        return None


def judged(code: Code, crop: Crop, quad: Array) -> Match | None:
    """`quad` refined to sub-pixel and what it holds compared with the code; None if it is not that."""
    corners = refined(crop, quad, cell=side_of(quad) / code.across)
    if corners is None:
        return None
    score, wrong = code.likeness(crop, plane_of(corners))
    return Match(corners, score, wrong) if score >= SURE else None


def detected(family: str, crop: Crop) -> list[Found]:
    """Number and (4, 2) rough corners in frame pixels of every marker of one family in `crop`."""
    quads, numbers, _ = detector(family).detectMarkers(crop.gray)
    if numbers is None:
        return []
    # The detector's corners are centres of black pixels, half a pixel inside of the true outline.
    return [(int(n), crop.origin + q[0]) for n, q in zip(np.ravel(numbers), quads, strict=True)]


_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)


def plane_of(corners: Array) -> Array:
    """(3, 3) homography from the marker's square [-1, 1]^2 to the image."""
    return np.asarray(cv2.getPerspectiveTransform(_SQUARE, corners.astype(np.float32)), np.float64)


def side_of(corners: Array) -> float:
    """Mean side of a quadrangle [px]."""
    return 0.25 * sum(sides_of(corners))


def sides_of(corners: Array) -> list[float]:
    """The four sides of a quadrangle, from the one after the first corner [px]."""
    points = corners.tolist()
    return [math.dist(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]


def middle_of(corners: Array) -> tuple[float, float]:
    """Mean of a quadrangle's corners [px]."""
    (a, b), (c, d), (e, f), (g, h) = corners.tolist()
    return 0.25 * (a + c + e + g), 0.25 * (b + d + f + h)
