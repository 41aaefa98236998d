"""Making a tracker by the name of its kind."""

from __future__ import annotations

from vita.errors import UnknownName
from vita.types import Image
from vita.vision.base import Tracker
from vita.vision.fixed import FixedTracker
from vita.vision.patch import PatchTracker

TRACKER_KINDS = ("auto", "patch", "fixed")
"""What a person may choose; `projected` trackers are made from ground truth, see `ProjectedTracker`."""


def make_tracker(
    kind: str,
    frame: Image,
    uv: object,
    *,
    to: object = None,
    size_px: float | None = None,
    seed: int = 0,
) -> Tracker:
    """A tracker of what is seen at pixel `uv` (2,) of `frame`.

    `to` (2,) is a line's other end. `size_px` is the side of the region it holds on to; None lets
    it choose. `seed` is for kinds that draw random numbers; none of these does. Raises
    `UnknownName`, `BadInput` for a pixel outside the frame, and `Untrackable` (with a `suggestion`)
    where there is nothing to hold on to.
    """
    del to, seed
    if kind == "fixed":
        return FixedTracker(frame, uv)
    if kind in ("auto", "patch"):
        return PatchTracker(frame, uv, size_px=size_px, kind=kind)
    raise UnknownName("tracker", kind, TRACKER_KINDS)
