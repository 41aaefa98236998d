"""Pictures from cameras: taken by themselves while somebody holds the board in front of them."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from vita.calibration.board import Board
from vita.calibration.gather import Gathered, Searcher
from vita.calibration.verdict import empty_places
from vita.calibration.views import View, distance, outline
from vita.errors import BadInput, MissingDependency
from vita.tracking.sources import Picture, Source
from vita.tracking.stop import StopSignals
from vita.tracking.video import CameraSource

WANTED = 25
"""Views after which it ends by itself."""
STILL_PX = 1.0
"""Motion from one picture to the next up to which the board counts as held still [px]."""
NEW = 0.05
"""How far a view must differ from all before, in shares of the diagonal."""


def capture(board: Board, sources: Sequence[Source], keep: bool) -> Gathered:
    """Until there are `WANTED` views or Ctrl-C. Two USB cameras are not synchronized, so a view is taken only
    while the board is held still."""
    if not all(source.live for source in sources):
        raise BadInput("a camera goes with another camera, not with a file")
    searcher = Searcher(board, sources, keep)
    taken = searcher.gathered.views
    before: View | None = None
    _say(f"hold {board.words} still in front of the camera; Ctrl-C ends")
    with StopSignals() as stop:
        while not stop.signal and len(taken) < WANTED:
            pictures = _grab(sources)
            if any(picture is None for picture in pictures):
                break
            view = searcher.search(f"view {len(taken)}", [p for p in pictures if p is not None])
            sizes = [
                (p.image.shape[1], p.image.shape[0])
                for p in pictures
                if p is not None and p.image is not None
            ]
            if all(view.seen) and len(sizes) == len(sources):
                if before is not None and _still(before, view) and _new(board, view, taken, sizes):
                    taken.append(view)
                    _say(f"{len(taken)} of {WANTED} taken; {_next(taken, sizes)}")
            before = view
    if not searcher.gathered.pictures:
        raise MissingDependency(f"{sources[0].name} sends no pictures")
    return searcher.finish()


def _grab(sources: Sequence[Source]) -> list[Picture | None]:
    """All cameras are told to expose before the first picture is unpacked, which takes longer."""
    ready = [source.skip() for source in sources]
    return [
        (source.retrieve() if isinstance(source, CameraSource) else source.read()) if ok else None
        for source, ok in zip(sources, ready, strict=True)
    ]


def _still(before: View, now: View) -> bool:
    for a, b in zip(before.sights, now.sights, strict=True):
        if a is None or b is None:
            return False
        _, i, j = np.intersect1d(a.ids, b.ids, return_indices=True)
        if not len(i) or np.linalg.norm(a.uv[i] - b.uv[j], axis=1).max() > STILL_PX:
            return False
    return True


def _new(board: Board, view: View, taken: Sequence[View], sizes: Sequence[tuple[int, int]]) -> bool:
    own = outline(board, view, sizes)
    return all(distance(own, outline(board, other, sizes)) > NEW for other in taken)


def _next(taken: Sequence[View], sizes: Sequence[tuple[int, int]]) -> str:
    """What to do now: to the places where there is nothing yet, tilting it all the while."""
    for camera, size in enumerate(sizes):
        empty = empty_places([s for view in taken if (s := view.sights[camera]) is not None], size)
        if empty:
            whose = "" if len(sizes) == 1 else f" of the {('left', 'right')[camera]} picture"
            return f"now towards {empty[0]}{whose}, tilted"
    return "now nearer, farther, tilted to each side"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
