"""The protocol of image trackers and their registry."""

from __future__ import annotations

from typing import Protocol

from vita.types import Feature, Image


class Tracker(Protocol):
    """Follows one place of one camera's image, on pixels alone."""

    kind: str

    def update(self, frame: Image) -> Feature:
        """Find the target in the next frame, shape (h, w, 3) RGB uint8. Never raises on a loss."""
        ...
