"""Lines that are none: two ends at one place have no direction (row T5 of the fault catalogue)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from vita.errors import BadInput
from vita.scenario import names
from vita.scenario.schema import AttachSpec, Scenario, TrackerSpec
from vita.scenario.typed import shown

End = tuple[float, float] | AttachSpec | None
"""Where a point is in the first frame: a pixel, or a place on a body."""


def check_lengths(scenario: Scenario) -> None:
    """Raise `BadInput` on the first line whose ends are too near to each other to give it a direction."""
    trackers = {tracker.name: tracker for tracker in scenario.tracker}
    for i, tracker in enumerate(scenario.tracker):
        ends = [end for _, end in _ends(tracker)]
        if len(ends) == 2 and (gap := _gap(*ends)):
            key = "to" if tracker.to is not None else "attach_to"
            what = f"the line {tracker.name!r} has no direction: its ends are {gap}"
            raise BadInput(what, f"tracker[{i}].{key}")
    for i, spec in enumerate(scenario.constraint):
        points = list(_points(spec.points, trackers))
        for a, b in names.constraint_lines(spec.kind):
            (first, one), (second, other) = points[a], points[b]
            if gap := _gap(one, other):
                where = f"constraint[{i}].points[{spec.points.index(second)}]"
                what = f"{shown(first)} and {shown(second)}" if first != second else shown(first)
                raise BadInput(f"the line of {what} has no direction: its ends are {gap}", where)


def _points(points: tuple[str, ...], trackers: Mapping[str, TrackerSpec]) -> Iterator[tuple[str, End]]:
    for name in points:
        yield from _ends(trackers[name])


def _ends(tracker: TrackerSpec) -> list[tuple[str, End]]:
    """The tracker's point, or the two of a line, each with its name."""
    ends: list[End] = [tracker.at if tracker.at is not None else tracker.attach]
    if tracker.kind == names.LINE:
        ends.append(tracker.to if tracker.to is not None else tracker.attach_to)
    return [(tracker.name, end) for end in ends]


def _gap(one: End, other: End) -> str:
    """How near two ends are, in words; empty when they are far enough apart, or only a run can tell."""
    if isinstance(one, tuple) and isinstance(other, tuple):
        apart = math.dist(one, other)
        least = names.shortest_line_px()
        return f"{apart:.1f} px apart, and at least {least:g} are needed" if apart < least else ""
    same = isinstance(one, AttachSpec) and one == other
    return "the same point of the same body" if same else ""
