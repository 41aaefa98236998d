"""From the sources to views: pictures are read, paired by order, and searched for the board."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from vita.calibration.board import Board
from vita.calibration.detect import Finder, Sighting
from vita.calibration.views import View
from vita.errors import BadInput
from vita.tracking.folder import FolderSource
from vita.tracking.sources import Picture, Source
from vita.types import Image

SEARCHED = 150
"""Frames of a video that are searched for the board at most; the sharpest of each stretch."""
_STRETCH = 5
"""Length of a stretch where nobody knows how many frames there are [frames]."""


@dataclass(eq=False)
class Gathered:
    """What the sources gave."""

    views: list[View] = field(default_factory=list)
    sizes: list[tuple[int, int]] = field(default_factory=list)
    """Width and height of each camera's pictures [px]."""
    pictures: int = 0
    """Pictures, or pairs, that were searched."""
    said: list[str] = field(default_factory=list)
    """A line about each picture that could not be used."""
    samples: list[Image] = field(default_factory=list)
    """A few pictures without the board, to guess why."""
    shown: Image | None = None
    """The first picture with the board."""


class Searcher:
    """Takes pictures of the same instant one after another, and keeps what shows the board."""

    def __init__(self, board: Board, sources: Sequence[Source], keep: bool) -> None:
        """`keep` packs the pictures of each view, for whoever wants to show them."""
        self._finder = Finder(board)
        self._sources = sources
        self._keep = keep
        self.gathered = Gathered()
        self._sizes: list[tuple[int, int] | None] = [None] * len(sources)

    def search(self, name: str, pictures: Sequence[Picture]) -> View:
        """The view; it is not added yet."""
        g = self.gathered
        g.pictures += 1
        sights = tuple(self._sight(name, camera, picture) for camera, picture in enumerate(pictures))
        packed = tuple(_packed(p.image) if self._keep and p.image is not None else None for p in pictures)
        return View(name, sights, packed)

    def _sight(self, name: str, camera: int, picture: Picture) -> Sighting | None:
        where = name if len(self._sources) == 1 else f"{name} of {self._sources[camera].name}"
        image = picture.image
        if image is None:
            self.gathered.said.append(picture.trouble or f"{where}: cannot be read")
            return None
        size = image.shape[1], image.shape[0]
        first = self._sizes[camera]
        if first is None:
            self._sizes[camera] = size
        elif size != first:
            text = f"{size[0]} x {size[1]} pixels, the first one has {first[0]} x {first[1]}"
            self.gathered.said.append(f"{where}: {text}")
            return None
        sight = self._finder.find(image)
        if sight is None and len(self.gathered.samples) < 3:
            self.gathered.samples.append(image)
        if sight is not None and self.gathered.shown is None:
            self.gathered.shown = image
        return sight

    def finish(self) -> Gathered:
        for source, size in zip(self._sources, self._sizes, strict=True):
            if size is None:
                trouble = f": {self.gathered.said[0]}" if self.gathered.said else ""
                raise BadInput(f"no picture of it can be read{trouble}", source.name)
            self.gathered.sizes.append(size)
        return self.gathered


def gather(board: Board, sources: Sequence[Source], keep: bool) -> Gathered:
    """Search the pictures of one folder or video, or of two, paired by order."""
    _check_counts(sources)
    searcher = Searcher(board, sources, keep)
    for name, pictures in _sharpest(sources):
        _progress(searcher.gathered.pictures, sources)
        view = searcher.search(name, pictures)
        if any(view.seen):
            searcher.gathered.views.append(view)
    _progress(None, sources)
    return searcher.finish()


def _check_counts(sources: Sequence[Source]) -> None:
    folders = [isinstance(source, FolderSource) for source in sources]
    if len(sources) == 2 and folders[0] != folders[1]:
        raise BadInput("pictures are paired by order: give two folders, two videos or two cameras")
    if all(folders) and len({source.total for source in sources}) > 1:
        counts = " and ".join(f"{source.name} has {source.total} pictures" for source in sources)
        raise BadInput(f"{counts}; they are paired by order, so each needs its counterpart")


def _sharpest(sources: Sequence[Source]) -> Iterator[tuple[str, list[Picture]]]:
    """Every picture of folders; of videos, the sharpest frame of each stretch."""
    first = sources[0]
    if isinstance(first, FolderSource):
        for name in first.names:
            yield name, [source.read() or Picture(None) for source in sources]
        return
    known = [source.total for source in sources if source.total]
    stretch = max(1, -(-min(known) // SEARCHED)) if known else _STRETCH
    best: tuple[float, str, list[Picture]] | None = None
    number = 0
    while True:
        pictures = [source.read() for source in sources]
        read = [picture for picture in pictures if picture is not None]
        if len(read) < len(sources):
            break
        sharp = min(_sharpness(picture) for picture in read)
        if best is None or sharp > best[0]:
            best = sharp, f"frame {number}", read
        number += 1
        if number % stretch == 0:
            yield best[1], best[2]
            best = None
    if best is not None:
        yield best[1], best[2]
    _same_end(sources, pictures, number)


def _same_end(sources: Sequence[Source], last: Sequence[Picture | None], number: int) -> None:
    """Videos whose lengths differ by more than a moment were not taken together."""
    for source, picture in zip(sources, last, strict=True):
        more = 0 if picture is None else 1
        while more and more <= max(5, 0.02 * number) and source.skip():
            more += 1
        if more > max(5, 0.02 * number):
            other = next(s for s in sources if s is not source)
            raise BadInput(
                f"{other.name} ends after {number} frames and {source.name} goes on; they are paired by "
                "order, so both must begin and end together"
            )


def _sharpness(picture: Picture) -> float:
    if picture.image is None:
        return -1.0
    small = np.ascontiguousarray(picture.image[:, :, 1])
    return float(cv2.Laplacian(small, cv2.CV_16S).std())


def _packed(image: Image) -> bytes:
    ok, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 92])
    return data.tobytes() if ok else b""


def _progress(done: int | None, sources: Sequence[Source]) -> None:
    if not sys.stderr.isatty():
        return
    sys.stderr.write("\r\x1b[K" if done is None else f"\rpicture {done + 1} of {sources[0].name}\x1b[K")
    sys.stderr.flush()
