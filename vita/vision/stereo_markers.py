"""The markers of tool and target in both pictures of a stereo rig, found and followed without a click."""

from __future__ import annotations

import math
from collections.abc import Mapping

import cv2
import numpy as np

from vita.errors import BadInput, UnknownName
from vita.stereo.base import Lens, MarkerCorners, StereoRig
from vita.types import Array, Image, frozen
from vita.vision import warps
from vita.vision.images import Crop, is_frame, to_gray
from vita.vision.marker_code import Code
from vita.vision.marker_follow import BLURRED_CELLS, MarkerFollower, Match, sides_of
from vita.vision.marker_search import MarkerSearch

FAMILY = "6X6_250"
"""OpenCV's dictionary that the numbers belong to."""
SOON, LATER, SELDOM = 5, 60, 4
"""A missing marker is sought in every frame for so long, then in every other, then in one of so many."""

BEST_PX, NARROW_PX = 0.03, 0.2
"""Error of a corner of a large marker, and of one that is 10 px wide [px]."""
SHARP, BLURRED_PX = 0.995, 8.0
"""Likeness to the code below which motion has blurred it, and the error of a corner per unit of that [px]."""


class StereoMarkers:
    """Looks for each marker in both pictures. State: where each was, and for how long it is missing."""

    def __init__(self, rig: StereoRig, cameras: tuple[str, str], numbers: Mapping[str, int]) -> None:
        """`cameras` are the names of left and right; `numbers` gives the code of each marker by its name."""
        if len(cameras) != 2 or cameras[0] == cameras[1]:
            raise BadInput(f"expected two different cameras, got {cameras}", "cameras")
        if not numbers or len(set(numbers.values())) != len(numbers):
            raise BadInput(f"each marker needs a number of its own, got {dict(numbers)}", "numbers")
        self.rig, self.cameras = rig, (cameras[0], cameras[1])
        self._eyes = tuple(_Eye(lens, numbers, turn) for turn, lens in enumerate((rig.left, rig.right)))

    def look(self, frames: Mapping[str, Image]) -> dict[str, MarkerCorners]:
        """The corners of every marker in this pair of frames; None for a camera that does not see it."""
        for camera in self.cameras:
            if camera not in frames:
                raise UnknownName("camera", camera, frames)
        left, right = (eye.look(frames[camera]) for eye, camera in zip(self._eyes, self.cameras, strict=True))
        return {name: _together(left[name], right[name]) for name in left}

    @property
    def corners(self) -> dict[tuple[str, str], Array]:
        """(camera, marker) to (4, 2) corners as the picture shows them, of what the last look saw [px]."""
        return {
            (camera, name): corners
            for eye, camera in zip(self._eyes, self.cameras, strict=True)
            for name, corners in eye.raw.items()
        }


Sight = tuple[Array, float] | None
"""(4, 2) undistorted corners and their standard deviation [px]; None where it is not seen."""


class _Eye:
    """One camera."""

    def __init__(self, lens: Lens, numbers: Mapping[str, int], turn: int) -> None:
        self._lens, self._turn, self._count = lens, turn, 0
        codes = {name: _code(name, number) for name, number in numbers.items()}
        self._find = MarkerSearch(list(codes.values())).find
        self._followers = {name: MarkerFollower(code, find=self._find) for name, code in codes.items()}
        self.raw: dict[str, Array] = {}

    def look(self, frame: Image) -> dict[str, Sight]:
        """Each marker in this frame."""
        self._count += 1
        matches: dict[str, Match | None] = dict.fromkeys(self._followers)
        if is_frame(frame):
            matches = {name: follower.near(frame) for name, follower in self._followers.items()}
            wanted = [n for n, m in matches.items() if m is None and self._due(self._followers[n].missing)]
            if wanted:
                # One search of the whole frame serves all that are missing.
                whole = Crop(to_gray(frame), np.zeros(2))
                found = self._find(whole)
                for name in wanted:
                    matches[name] = self._followers[name].among(whole, found)
        self.raw, sights = {}, {}
        for name, match in matches.items():
            follower = self._followers[name]
            if match is None or match.wrong > BLURRED_CELLS:
                follower.lose()
                sights[name] = None
                continue
            follower.follow(match)
            self.raw[name] = frozen(match.corners)
            sights[name] = undistorted(self._lens, match.corners), spread_px(match.corners, match.score)
        return sights

    def _due(self, missing: int) -> bool:
        """Whether a whole frame is searched for one that is missing for so long; the eyes take turns."""
        if missing < SOON:
            return True
        return (self._count + self._turn) % (2 if missing < LATER else SELDOM) == 0


def _code(name: str, number: int) -> Code:
    if not (isinstance(number, int | np.integer) and 0 <= number < 250):
        raise BadInput(f"the 6 x 6 dictionary has the numbers 0 to 249, not {number}", name)
    return Code(FAMILY, int(number))


def _together(left: Sight, right: Sight) -> MarkerCorners:
    spread = max(sight[1] for sight in (left, right) if sight is not None) if left or right else 0.2
    return MarkerCorners(
        None if left is None else frozen(left[0]), None if right is None else frozen(right[0]), spread
    )


def undistorted(lens: Lens, pixels: Array) -> Array:
    """(k, 2) where an ideal lens of the same focal length would show the (k, 2) `pixels`."""
    if not any(lens.distortion):
        return pixels
    K = lens.matrix
    ideal = cv2.undistortPoints(pixels[:, None], K, np.array(lens.distortion), P=K)
    return np.asarray(ideal, dtype=np.float64)[:, 0]


def spread_px(corners: Array, score: float) -> float:
    """Standard deviation of each corner's coordinate [px] for a marker that looks like this.

    Measured on rendered pictures against the truth (640 x 480, camera noise of 2 grey levels, tilts up to 65
    degrees). It is the narrow side that counts: where its cells become smaller than two pixels, the edges of
    neighbouring cells, of the white rim and of the background pull at the outline. Motion blur shows in the
    likeness to the code before it hides it.
    """
    narrow = abs(warps.area(corners)) / max(sides_of(corners))
    return math.hypot(BEST_PX, NARROW_PX * (10.0 / narrow) ** 2, BLURRED_PX * max(0.0, SHARP - score))
