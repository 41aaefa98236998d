"""The verb `track`: frames through the trackers into a table and, if wanted, a video."""

from __future__ import annotations

import signal
import sys
import time
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

from vita.errors import BadInput, MissingDependency, UnknownName
from vita.tracking.progress import Progress
from vita.tracking.show import Show
from vita.tracking.sources import Picture, Source, open_source
from vita.tracking.stop import StopSignals
from vita.tracking.table import Table
from vita.tracking.tally import Tally
from vita.tracking.targets import read_targets
from vita.types import Feature, Image
from vita.vision import TRACKER_KINDS, Tracker

KINDS = tuple(kind for kind in TRACKER_KINDS if kind != "fixed")
"""All but the goal that stays where it is: there is nothing to track."""


@dataclass(frozen=True)
class Request:
    """The arguments of the command line."""

    source: str
    at: tuple[str, ...]
    tracker: str = "auto"
    out: Path | None = None
    """CSV file; None is the standard output."""
    show: Path | None = None
    """Annotated video; None makes none."""
    first: int = 0
    """The frame in which `at` is meant; those before it are left out."""
    frames: int | None = None
    """How many frames at most; None goes on to the end."""


def track(request: Request) -> int:
    """Do it; returns the exit code. The summary goes to stderr."""
    if request.tracker not in KINDS:
        raise UnknownName("tracker", request.tracker, KINDS, "--tracker")
    if request.frames == 0:
        raise BadInput("0 frames leave nothing to track", "--frames")
    targets = read_targets(request.at, request.tracker)
    _check_outputs(request)
    with ExitStack() as stack:
        source = stack.enter_context(closing(open_source(request.source)))
        image = _first(source, request.first)
        trackers = {target.name: target.start(request.tracker, image) for target in targets}
        # Only now: a click that is refused must not have emptied the files of the last run.
        table = stack.enter_context(closing(Table(request.out)))
        show = None
        if request.show is not None:
            total = None if source.total is None else source.total - 1
            show = stack.enter_context(closing(Show(request.show, image, source.fps, total, list(trackers))))
        stop = stack.enter_context(StopSignals())
        tally = Tally(trackers)
        ended, seconds = _loop(request, source, image, trackers, tally, table, show, stop)
    _say(request, source, tally, ended, seconds, stop.signal)
    if show is not None and show.missing > 1:  # Some containers count one too few.
        kept = f"only {show.written - show.missing} of {show.written} frames are in it"
        raise BadInput(f"{kept}: is the disk full?", str(show.path))
    # Ctrl-C is how one ends a camera; a file that was not finished is worth telling to a script.
    return 0 if source.live and stop.signal == signal.SIGINT else stop.signal and 128 + stop.signal


def _check_outputs(request: Request) -> None:
    """An output that is the source would destroy it, and two outputs in one file each other."""
    files = {"--out": request.out, "--show": request.show}
    paths = [(option, path.resolve()) for option, path in files.items() if path is not None]
    if len(paths) == 2 and paths[0][1] == paths[1][1]:
        raise BadInput("--out and --show name the same file")
    for option, path in paths:
        if path == Path(request.source).resolve():
            raise BadInput(f"{option} would overwrite the source", request.source)


def _first(source: Source, skipped: int) -> Image:
    """The frame in which the targets are clicked."""
    number = 0
    while number < skipped and source.skip():
        number += 1
    picture = source.read()
    if picture is None and source.live:
        raise MissingDependency(f"{source.name} sends no pictures")
    if picture is None:
        why = f"--from {skipped} is behind the end: there are {number} frames" if number else "no frames"
        raise BadInput(why, source.name)
    if picture.image is None:
        raise BadInput(f"the first frame is of no use: {picture.trouble}", source.name)
    return picture.image


def _loop(
    request: Request,
    source: Source,
    first: Image,
    trackers: dict[str, Tracker],
    tally: Tally,
    table: Table,
    show: Show | None,
    stop: StopSignals,
) -> tuple[bool, float]:
    """Whether the source came to its end by itself, and the time that was needed [s]."""
    total = None if source.total is None else max(source.total - request.first, 1)
    if request.frames is not None:
        total = min(total or request.frames, request.frames)
    # A bar among the rows of the table would be unreadable.
    shown = sys.stderr.isatty() and not (request.out is None and sys.stdout.isatty())
    start = time.monotonic()
    with closing(Progress(sys.stderr, total, shown)) as progress:
        picture: Picture | None = Picture(first)
        while picture is not None:
            image, trouble = _usable(picture, first)
            number = request.first + tally.frames
            features: dict[str, Feature] = {n: t.update(image) for n, t in trackers.items()}  # type: ignore[arg-type]
            table.add(number, features)
            if show is not None:
                show.add(number, image, trouble, features)
            tally.add(number, image, trouble, features)
            progress.update(tally.frames, features)
            if stop.signal or tally.frames == request.frames:
                return False, time.monotonic() - start
            picture = source.read()
    return True, time.monotonic() - start


def _usable(picture: Picture, first: Image) -> tuple[Image | None, str]:
    """The frame, or None and why the trackers cannot use it."""
    image = picture.image
    if image is None or image.shape == first.shape:
        return image, picture.trouble
    (h, w), (h0, w0) = image.shape[:2], first.shape[:2]
    return None, f"it has {w} x {h} pixels and the first one {w0} x {h0}"


def _say(request: Request, source: Source, tally: Tally, ended: bool, seconds: float, stopped: int) -> None:
    files = [str(path) for path in (request.out, request.show) if path is not None]
    written = f" -> {', '.join(files)}" if files else ""
    rate = tally.frames / max(seconds, 1e-9)
    lines = [f"{tally.frames} frames of {source.name}, {rate:.0f} frames/s{written}", *tally.table()]
    lines += [f"note: {note}" for note in tally.notes()]
    if stopped:
        lines.append("note: stopped before the end; what was done is kept")
    seen = request.first + tally.frames
    if ended and source.live:
        lines.append(f"note: {source.name} stopped sending pictures")
    # Containers often promise a frame or two that are not there.
    elif ended and source.total is not None and seen < 0.98 * source.total - 2:
        lines.append(f"note: the file promises {source.total} frames but {seen} can be read: is it complete?")
    print("\n".join(lines), file=sys.stderr)
