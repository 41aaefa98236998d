"""Video files and cameras, both read by OpenCV."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np

from vita.errors import BadInput, MissingDependency
from vita.tracking.sources import Picture
from vita.types import Image

FPS = 30.0
"""Taken for a source that does not say, or says nonsense."""


class VideoSource:
    """A video file. Seeking is inexact in most formats, so frames are only ever read in their order."""

    live = False

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        # Asked, not tried: opening and closing a pipe would take away its first bytes.
        if not os.access(path, os.R_OK):
            raise BadInput("no permission to read it", self.name)
        self._video = cv2.VideoCapture(self.name)
        if not self._video.isOpened():
            raise BadInput(
                "not a video that OpenCV can read: it is damaged, cut short, or of another format", self.name
            )
        self.fps = _fps(self._video)
        count = self._video.get(cv2.CAP_PROP_FRAME_COUNT)
        self.total = int(count) if 0 < count < 1e9 else None

    def read(self) -> Picture | None:
        return _next(self._video)

    def skip(self) -> bool:
        return bool(self._video.grab())

    def close(self) -> None:
        self._video.release()


class CameraSource:
    """A camera by its number, as the operating system counts them."""

    live = True
    total = None

    def __init__(self, number: int) -> None:
        self.name = f"camera {number}"
        self._video = cv2.VideoCapture(number)
        if not self._video.isOpened():
            raise MissingDependency(f"there is no {self.name}, or another program uses it. {_present()}")
        self.fps = _fps(self._video)

    def read(self) -> Picture | None:
        return _next(self._video)

    def skip(self) -> bool:
        return bool(self._video.grab())

    def retrieve(self) -> Picture | None:
        """The frame that `skip` left out: two cameras are exposed together and unpacked afterwards."""
        ok, bgr = self._video.retrieve()
        return Picture(_rgb(bgr)) if ok and bgr is not None else None

    def close(self) -> None:
        self._video.release()


def _next(video: cv2.VideoCapture) -> Picture | None:
    ok, bgr = video.read()
    if not ok or bgr is None:
        return None
    return Picture(_rgb(bgr))


def _rgb(bgr: np.ndarray) -> Image:
    code = cv2.COLOR_GRAY2RGB if bgr.ndim == 2 else cv2.COLOR_BGR2RGB
    image = np.asarray(cv2.cvtColor(bgr, code), dtype=np.uint8)
    image.setflags(write=False)
    return image


def _fps(video: cv2.VideoCapture) -> float:
    fps = video.get(cv2.CAP_PROP_FPS)
    return fps if 1 <= fps <= 240 else FPS


def _present() -> str:
    """The cameras that this computer has, where it can be known without opening each of them."""
    numbers = sorted(p.name.removeprefix("video") for p in Path("/dev").glob("video*"))
    return f"Cameras here: {', '.join(numbers)}." if numbers else "No camera is connected."
