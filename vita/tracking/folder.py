"""A folder of images, in natural order: frame_2 before frame_10."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np

from vita.errors import BadInput
from vita.tracking.sources import Picture
from vita.types import Image

IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm", ".pbm", ".pnm", ".jp2")
FPS = 30.0
_DEPTHS = (8, 10, 12, 14, 16)
"""Bits in which cameras count; files of more than 8 store any of them in 16."""


class FolderSource:
    """Every image of a folder is a frame; other files and hidden ones are left alone."""

    live = False
    fps = FPS

    def __init__(self, folder: Path) -> None:
        self.name = str(folder)
        try:
            found = [p for p in folder.iterdir() if p.suffix.lower() in IMAGES and not p.name.startswith(".")]
        except OSError as error:
            raise BadInput(f"cannot be read: {error.strerror or error}", self.name) from None
        if not found:
            raise BadInput(f"no images in this folder ({', '.join(i[1:] for i in IMAGES)})", self.name)
        self._paths = sorted(found, key=lambda path: natural(path.name))
        self._next = 0
        self._bits: int | None = None
        self.total = len(self._paths)
        self.names = [path.name for path in self._paths]

    def read(self) -> Picture | None:
        if self._next >= len(self._paths):
            return None
        path = self._paths[self._next]
        self._next += 1
        image, trouble = _decode(path)
        if image is None:
            return Picture(None, f"{path.name}: {trouble}")
        return Picture(self._eight_bits(image))

    def skip(self) -> bool:
        self._next += 1
        return self._next <= len(self._paths)

    def close(self) -> None:
        pass

    def _eight_bits(self, image: np.ndarray) -> Image:
        if image.dtype == np.uint16:
            if self._bits is None:
                # The same for all frames, or the light would seem to jump.
                self._bits = next(bits for bits in _DEPTHS if int(image.max()) < 2**bits)
            image = np.minimum(image >> (self._bits - 8), 255).astype(np.uint8)
        image.setflags(write=False)
        return image


def natural(name: str) -> list[tuple[int, int, str]]:
    """A sort key that compares the numbers in a name as numbers."""
    parts = re.findall(r"[0-9]+|[^0-9]+", name)
    # The name itself decides between 1.png and 01.png, so that the order never depends on the disk.
    return [(0, int(p), "") if p[0] in "0123456789" else (1, 0, p.lower()) for p in parts] + [(0, -1, name)]


def _decode(path: Path) -> tuple[np.ndarray | None, str]:
    """(h, w, 3) RGB, 8 or 16 bits, without its transparency and turned as its EXIF says; or why not."""
    try:
        # Read by Python: OpenCV's own reader does not know every system's letters in file names.
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        return None, f"cannot be read: {error.strerror or error}"
    try:
        image = cv2.imdecode(data, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_ANYDEPTH)
    except cv2.error:  # An empty file, or a size that its decoder refuses.
        image = None
    if image is None:
        return None, "damaged, cut short, or of another format"
    if image.dtype not in (np.uint8, np.uint16):
        return None, f"its pixels are {image.dtype}; give 8 or 16 bits"
    return image, ""
