"""Making a tracker by the name of its kind."""

from __future__ import annotations

from collections.abc import Callable

from vita.errors import BadInput, UnknownName
from vita.types import Image
from vita.vision.auto import best_tracker
from vita.vision.base import Tracker
from vita.vision.blob import BlobTracker
from vita.vision.ellipse import EllipseTracker
from vita.vision.fixed import FixedTracker
from vita.vision.images import check_frame, check_pixel
from vita.vision.line import LineTracker
from vita.vision.marker import MarkerTracker
from vita.vision.patch import PatchTracker
from vita.vision.point import PointTracker
from vita.vision.redetect import RedetectTracker

Maker = Callable[..., Tracker]

_MAKERS: dict[str, Maker] = {
    "patch": PatchTracker,
    "point": PointTracker,
    "ellipse": EllipseTracker,
    "blob": BlobTracker,
    "marker": MarkerTracker,
    "redetect": RedetectTracker,
}
"""Kinds that are placed by one pixel."""
LINE, FIXED, AUTO = "line", "fixed", "auto"
TRACKER_KINDS = (AUTO, "patch", "point", LINE, "ellipse", "blob", "marker", "redetect", FIXED)
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
    del seed
    if kind not in TRACKER_KINDS:
        raise UnknownName("tracker", kind, TRACKER_KINDS)
    check_pixel(uv, check_frame(frame))
    if to is not None and kind not in (LINE, AUTO):
        raise BadInput(f"only a line has another end; a {kind!r} tracker is placed by one pixel", "to")
    if kind == FIXED:
        return FixedTracker(frame, uv)
    if kind == LINE or to is not None:
        if to is None:
            raise BadInput("a line is given by two pixels; the other end is missing", "to")
        return LineTracker(frame, uv, to, size_px=size_px)
    if kind == AUTO:
        return best_tracker(frame, uv, size_px)
    return _MAKERS[kind](frame, uv, size_px=size_px)
