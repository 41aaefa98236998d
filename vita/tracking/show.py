"""The annotated video: regions, trails, names and scores drawn on the frames."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import cv2
import numpy as np

from vita.errors import BadInput, MissingDependency
from vita.tracking import draw
from vita.types import Array, Feature, Image

CODECS = {".mp4": "mp4v", ".m4v": "mp4v", ".mov": "mp4v", ".mkv": "mp4v", ".avi": "MJPG", ".webm": "VP80"}
"""What the wheels of OpenCV can write everywhere. Browsers play only the last one."""
TRAIL = 60
"""Positions of the trail."""


class Show:
    """Writes a video of the source's size and rate; codecs cut an odd size to an even one."""

    def __init__(self, path: Path, first: Image, fps: float, last: int | None, names: list[str]) -> None:
        """`path` is overwritten. `last` is the number of the last frame, where it is known."""
        self.path, self._last = path, last
        self._size = (first.shape[1], first.shape[0])
        self._trails = {name: deque[Array | None](maxlen=TRAIL) for name in names}
        self._picture = first
        self.written = 0
        self.missing = 0
        """Frames that did not reach the file; known when it is closed."""
        codec = CODECS.get(path.suffix.lower())
        if codec is None:
            raise BadInput(f"unknown kind of video; choose one of {', '.join(CODECS)}", str(path))
        try:
            path.open("wb").close()
        except OSError as error:
            raise BadInput(f"cannot be written: {error.strerror or error}", str(path)) from None
        self._video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), fps, self._size)
        if not self._video.isOpened():
            path.unlink()
            raise MissingDependency(f"{path}: this OpenCV cannot write {path.suffix} videos ({codec})")

    def add(self, number: int, image: Image | None, trouble: str, features: dict[str, Feature]) -> None:
        """One frame; where there is no picture the last one is shown, darkened."""
        if image is not None:
            self._picture = image
        canvas = np.asarray(cv2.cvtColor(self._picture, cv2.COLOR_RGB2BGR), dtype=np.uint8)
        if image is None:
            canvas //= 3
        for name, feature in features.items():
            self._trails[name].append(feature.uv if feature.ok else None)
        caption = f"frame {number}" + ("" if self._last is None else f" of {self._last}")
        draw.annotate(canvas, features, self._trails, f"{caption}: {trouble}" if trouble else caption)
        self._video.write(canvas)
        self.written += 1

    def close(self) -> None:
        """Finish the file. OpenCV never tells that a disk is full, so the frames are counted once more."""
        self._video.release()
        written = cv2.VideoCapture(str(self.path))
        count = int(written.get(cv2.CAP_PROP_FRAME_COUNT)) if written.isOpened() else 0
        written.release()
        self.missing = self.written - count
