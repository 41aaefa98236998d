"""The re-detecting tracker: a patch tracker whose target is found again anywhere, turned and scaled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vita.errors import BadInput, Untrackable
from vita.types import Array, Feature, Image
from vita.vision import warps
from vita.vision.images import check_frame, check_pixel, is_frame, to_gray
from vita.vision.patch import PatchTracker
from vita.vision.recall import LEAST_FEATURES, Memory, described

SIDE = 71
"""Default side of the region [px]: larger than the patch tracker's, since it must hold enough features."""
SMALLEST = 25
"""Smallest side that may be asked for [px]."""
EVERY, EVERY_LATER, LATER = 2, 5, 30
"""While lost, every second frame is looked at, every fifth after 30 lost frames."""


class RedetectTracker:
    """A `PatchTracker` with a memory of its region's SIFT features, learned at the click.

    The thesis (4.1) used SURF and TLD for this. While the patch is followed the memory costs
    nothing. While it is lost, the features of every second frame are matched with the memory; where
    enough agree on one pose, the patch tracker is asked whether its region is really there, so that
    what is found again has the patch's precision and passes its strict test.
    """

    kind = "redetect"

    def __init__(self, frame: Image, uv: object, *, size_px: float | None = None) -> None:
        self._size = check_frame(frame)
        pixel = check_pixel(uv, self._size)
        room = min(self._size) - 1
        if size_px is not None and not SMALLEST <= size_px <= room:
            raise BadInput(f"a region of {size_px:g} px is outside {SMALLEST} to {room} px", "size_px")
        side = float(min(SIDE, room)) if size_px is None else float(size_px)
        try:
            self._patch, self._memory = _learned(frame, pixel, side)
        except Untrackable:
            raise _refusal(frame, pixel, side) from None
        self._missing = self._looks = 0

    def update(self, frame: Image) -> Feature:
        """Find the region in the next frame."""
        feature = self._patch.update(frame)
        if feature.ok:
            if self._missing > 1:
                feature = self._confirmed(frame, feature)
        else:
            self._missing += 1
            every = EVERY if self._missing < LATER else EVERY_LATER
            if self._missing % every == 1 and is_frame(frame, self._size):
                found = self._resumed(frame, self._memory.poses(frame, self._looks))
                self._looks += 1
                feature = self._patch.update(frame) if found else feature
        if not feature.ok:
            return feature
        self._missing = 0
        return replace(feature, detail=f"re-detecting {feature.detail}")

    def _resumed(self, frame: Image, poses: list[Array]) -> bool:
        """Whether the patch tracker takes up one of the poses."""
        return any(self._patch.resume(frame, pose) for pose in poses)

    def _confirmed(self, frame: Image, feature: Feature) -> Feature:
        """What the patch tracker found by itself, unless the features point to somewhere else.

        It searches by looks at low resolution and can take one coin among many for another.
        """
        poses = self._memory.poses(frame, 0)
        here, reach = warps.corners(self._patch.warp), 0.25 * self._memory.side
        if any(np.abs(warps.corners(pose) - here).max() < reach for pose in poses):
            return feature
        return self._patch.update(frame) if self._resumed(frame, poses) else feature


_TOO_FEW = "too few features here to know the region again by: it needs a rich print."


def _named(feature: Feature) -> Feature:
    word = feature.detail.replace("patch", "re-detecting patch") if feature.ok else feature.detail
    return Feature(feature.uv, feature.status, feature.score, feature.corners, detail=word)


def _learned(frame: Image, pixel: Array, side: float) -> tuple[PatchTracker, Memory]:
    patch = PatchTracker(frame, pixel, size_px=side)
    return patch, Memory(frame, patch.warp)


def _refusal(frame: Image, pixel: Array, side: float) -> Untrackable:
    """Why nothing can be learned here, with the nearest place where it can."""
    points, _ = described(to_gray(frame), 1.0, np.zeros(2))
    size, half = np.array([frame.shape[1], frame.shape[0]]), side / 2
    order = np.argsort(np.hypot(*(points - pixel).T)) if len(points) else []
    tried = 0
    for place in points[order]:
        near = np.abs(points - place).max(axis=1) < half
        if np.any(place < half) or np.any(place > size - 1 - half) or near.sum() < LEAST_FEATURES:
            continue
        tried += 1
        if tried > 12:
            break
        u, v = (float(round(x)) for x in place.tolist())
        try:
            _learned(frame, np.array([u, v]), side)
        except Untrackable:
            continue
        return Untrackable(
            f"{_TOO_FEW} The nearest good place is pixel ({u:.0f}, {v:.0f}).", suggestion=(u, v)
        )
    return Untrackable(f"{_TOO_FEW} No better place was found in this picture.")
