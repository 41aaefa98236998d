"""The verb `calibrate`: pictures of a printed board into a calibration file, with a verdict."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path

from vita.calibration.board import Board, parse_board
from vita.calibration.draw import print_board
from vita.calibration.gather import Gathered, gather
from vita.calibration.hints import hint, larger
from vita.calibration.live import capture
from vita.calibration.output import camera_text, check_out, write_camera, write_pair
from vita.calibration.pair import PairFit, solve_pair
from vita.calibration.report import camera_lines, dropped_lines, pair_lines, verdict_lines
from vita.calibration.show import show_views
from vita.calibration.solve import CameraFit, solve_camera
from vita.calibration.verdict import Finding, judge_camera, judge_pair
from vita.calibration.views import View, spread, without_blurred
from vita.errors import BadInput
from vita.tracking.sources import open_source

__all__ = ["Request", "calibrate"]


@dataclass(frozen=True)
class Request:
    """The arguments of the command line."""

    sources: tuple[str, ...]
    """None (only `--print`), one or two."""
    board: str
    out: Path | None = None
    """The calibration file; None prints it."""
    show: Path | None = None
    """A folder for the pictures with their corners drawn in; None makes none."""
    print_to: Path | None = None
    dpi: int = 300


def calibrate(request: Request) -> int:
    """Do it; returns the exit code. The report goes to stderr, so that the file can go to stdout."""
    board = parse_board(request.board)
    if request.print_to is not None:
        width, height = print_board(board, request.print_to, request.dpi)
        size = f"{width:.0f} x {height:.0f} mm at {request.dpi} dpi"
        _say([f"{request.print_to}: {board.words}, on paper {size}: print at 100 %"])
        if not request.sources:
            return 0
    _check(request)
    names = ("camera",) if len(request.sources) == 1 else ("left", "right")
    gathered = _gather(request, board)
    if not gathered.views:
        found = f"no board found in {gathered.pictures} pictures"
        where = " and ".join(request.sources)
        raise BadInput(f"{found}; sought {board.words}{hint(board, gathered.samples)}", where)
    if (more := larger(board, gathered.shown)) is not None:
        raise BadInput(f"the pictures show more squares: {more.words} or larger; count them again", "--board")
    views, blurred = without_blurred(gathered.views)
    views = spread(board, views, gathered.sizes)
    _say([f"{_found(gathered, names)}; {len(views)} views differ enough to be used"])
    fits, said = _cameras(board, views, gathered, names)
    findings: list[Finding] = []
    pair: PairFit | None = None
    if len(fits) == 2:
        pair, disagreed = solve_pair(board, (fits[0], fits[1]))
        fits, said = list(pair.cameras), said + disagreed
    lines = dropped_lines(gathered.said + blurred + said)
    for fit, name in zip(fits, names, strict=True):
        lines += camera_lines(fit, name)
        findings += judge_camera(fit, name)
    if pair is not None:
        lines += pair_lines(pair)
        findings += judge_pair(pair)
    _say([*lines, *verdict_lines(findings)])
    if pair is not None:
        write_pair(request.out, pair)
    else:
        write_camera(request.out, camera_text(fits[0]))
    if request.show is not None:
        show_views(request.show, board, views, fits, names)
    files = [str(path) for path in (request.out, request.show) if path is not None]
    if files:
        _say([f"-> {', '.join(files)}"])
    return 1 if any(finding.level == "poor" for finding in findings) else 0


def _check(request: Request) -> None:
    if not request.sources:
        raise BadInput("give a SOURCE (a folder of images, a video or a camera's number), or --print FILE")
    if len(request.sources) == 2 and _same(*request.sources):
        raise BadInput("both sources are the same; a stereo rig has two cameras", request.sources[0])
    check_out(request.out, request.sources)


def _same(a: str, b: str) -> bool:
    return a == b or (Path(a).exists() and Path(a).resolve() == Path(b).resolve())


def _gather(request: Request, board: Board) -> Gathered:
    with ExitStack() as stack:
        sources = [stack.enter_context(closing(open_source(given))) for given in request.sources]
        if any(source.live for source in sources):
            return capture(board, sources, request.show is not None)
        return gather(board, sources, request.show is not None)


def _found(gathered: Gathered, names: Sequence[str]) -> str:
    counts = [sum(view.seen[c] for view in gathered.views) for c in range(len(names))]
    if len(counts) == 1:
        return f"the board is seen in {counts[0]} of {gathered.pictures} pictures"
    both = sum(all(view.seen) for view in gathered.views)
    each = f"by left in {counts[0]}, by right in {counts[1]}, by both in {both}"
    return f"the board is seen {each} of {gathered.pictures} pairs"


def _cameras(
    board: Board, views: Sequence[View], gathered: Gathered, names: Sequence[str]
) -> tuple[list[CameraFit], list[str]]:
    fits, said = [], []
    for camera, name in enumerate(names):
        sights = {view.name: sight for view in views if (sight := view.sights[camera]) is not None}
        try:
            fit, dropped = solve_camera(board, sights, gathered.sizes[camera])
        except BadInput as error:
            error.args = (f"{name}: {error}",)
            raise
        fits.append(fit)
        said += [line if len(names) == 1 else f"{name} {line}" for line in dropped]
    return fits, said


def _say(lines: Sequence[str]) -> None:
    print("\n".join(lines), file=sys.stderr, flush=True)
