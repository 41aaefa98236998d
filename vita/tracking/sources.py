"""Where the frames come from: a video file, a folder of images or a camera."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2

from vita.errors import BadInput
from vita.types import Image

# The decoders' own chatter would tear the progress bar apart; what matters is told by us.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


@dataclass(frozen=True)
class Picture:
    """One frame of a source, or the reason why there is none."""

    image: Image | None
    """(h, w, 3) RGB, read-only."""
    trouble: str = ""


class Source(Protocol):
    """Frames in their order."""

    @property
    def name(self) -> str:
        """For people: the path, or `camera 0`."""
        ...

    @property
    def fps(self) -> float:
        """Frames per second at which to show them; a guess where the source does not say."""
        ...

    @property
    def total(self) -> int | None:
        """How many frames it promises; None for a camera or where nobody knows."""
        ...

    @property
    def live(self) -> bool:
        """Whether it goes on until somebody stops it."""
        ...

    def read(self) -> Picture | None:
        """The next frame; None at the end."""
        ...

    def skip(self) -> bool:
        """Leave out the next frame; False at the end."""
        ...

    def close(self) -> None: ...


def open_source(given: str) -> Source:
    """A file, a folder or the number of a camera. What exists as a path is never taken for a camera."""
    from vita.tracking.folder import IMAGES, FolderSource
    from vita.tracking.video import CameraSource, VideoSource

    path = Path(given)
    if not given.strip():
        raise BadInput("an empty SOURCE; give a video file, a folder of images or the number of a camera")
    if path.is_dir():
        return FolderSource(path)
    if path.exists():
        if path.suffix.lower() in IMAGES:
            raise BadInput("this is a single image; give the folder of images that it is in", given)
        return VideoSource(path)
    if given.isascii() and given.isdigit() and len(given) <= 3:
        return CameraSource(int(given))
    raise BadInput(
        "there is no such file or folder; give a video, a folder of images or a camera's number", given
    )
