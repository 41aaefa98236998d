"""A tracker that never moves: a goal drawn on the image."""

from __future__ import annotations

from vita.types import Array, Feature, Image
from vita.vision.images import check_frame, check_pixel


class FixedTracker:
    """Reports one constant pixel."""

    kind = "fixed"

    def __init__(self, frame: Image, uv: object) -> None:
        self._uv: Array = check_pixel(uv, check_frame(frame))

    def update(self, frame: Image) -> Feature:
        return Feature(self._uv, "ok", 1.0, None, "drawn on the image")
