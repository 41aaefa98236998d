"""What is wrong with a task can often be told from the drawing alone, before anything moves."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations

import numpy as np

from vita.constraints import Term, constraint_of, signed_distance
from vita.servo.diagnosis import quoted
from vita.servo.insight import Finding
from vita.types import Array, Feature

SAME_PX = 2.0
"""Places nearer than this in an image are taken for one and the same: a click is not more exact."""
APART_PX = 5.0
"""Goals of one point that are farther apart cannot both be met, whatever the clicks' exactness."""
SAME_DEG = 2.0
"""Lines that differ by less are taken for parallel."""


def examine_task(
    terms: Sequence[Term], features: Mapping[str, Feature] | None = None, fixed: Collection[str] = ()
) -> tuple[Finding, ...]:
    """Contradictions, copies and constraints that nothing can move.

    `features` gives the pixels as they are now; without it only names are compared. `fixed` names the
    trackers that are constant pixels.
    """
    findings = [f for term in terms for f in _alone(term, frozenset(fixed))]
    places = _places(terms, features or {})
    for first, second in combinations(terms, 2):
        found = _pair(first, second, places)
        if found is not None:
            findings.append(found)
    views = list(dict.fromkeys(term.camera for term in terms))
    if len(views) == 1 and len(terms) < 3:
        findings.append(_one_view(views[0]))
    return tuple(findings)


def contradiction(terms: Sequence[Term], features: Mapping[str, Feature]) -> str:
    """Why the task cannot be met whatever the arm does, naming both culprits; empty when nobody can tell yet.

    Only what is certain: one tracker that is sent to two places in its view. Ranked one above the other the
    two are no contradiction, since then the second only counts where the first leaves the arm free.
    """
    points = [t for t in terms if t.kind == "point_to_point" and t.weight > 0.0]
    for first, second in combinations(points, 2):
        goals = [features.get(term.points[1]) for term in (first, second)]
        if first.points[0] != second.points[0] or first.priority != second.priority:
            continue
        if all(goal is not None and goal.ok for goal in goals):
            off = float(np.linalg.norm(goals[0].uv - goals[1].uv))  # type: ignore[union-attr]
            if off > APART_PX:
                return (
                    f"{quoted((first.name, second.name))} cannot both hold: they send {first.points[0]!r} to "
                    f"goals that are {off:.0f} px apart. Delete one, or move its goal; then Start"
                )
    return ""


def _alone(term: Term, fixed: frozenset[str]) -> list[Finding]:
    moving = _moving(term)
    findings = []
    if set(moving) & set(term.points[len(moving) :]):
        text = f"{term.name!r} ties a point to itself, which is always met. Click another goal."
        findings.append(Finding("bad", "self", text))
    elif set(term.points) <= fixed:
        text = f"{term.name!r} ties fixed pixels only: no motion can change it. Track the moving feature."
        findings.append(Finding("bad", "immovable", text))
    elif set(moving) <= fixed:
        text = f"The moving feature of {term.name!r} is a fixed pixel; the goal comes second. Swap them?"
        findings.append(Finding("warning", "immovable", text))
    if term.weight == 0.0:
        text = f"{term.name!r} has the weight 0 and changes nothing. Raise it, or delete the constraint."
        findings.append(Finding("warning", "no_weight", text))
    return findings


def _one_view(camera: str) -> Finding:
    where = f" {camera!r}" if camera else ""
    text = (
        f"Only the view{where} is used: how far away the hand is hardly shows in it. "
        "Draw the same in a second view, best at a right angle."
    )
    return Finding("warning", "one_view", text)


def _moving(term: Term) -> tuple[str, ...]:
    """The trackers of the moving feature; one line tracker stands for both ends of a line."""
    constraint = constraint_of(term.kind)
    extra = constraint.arity - len(term.points)
    if extra == 0:
        return term.points[: constraint.moving]
    # Which of the trackers are lines is not known here by name; a moving line given as one comes first.
    return term.points[: max(1, constraint.moving - 1)] if constraint.moving == 2 else term.points[:1]


def _places(terms: Sequence[Term], features: Mapping[str, Feature]) -> dict[str, Array]:
    """Constraint to the (arity, 2) pixels of its points, for those that are all seen."""
    places = {}
    for term in terms:
        seen = [features.get(name) for name in term.points]
        if all(f is not None and f.ok for f in seen):
            places[term.name] = np.concatenate([f.points for f in seen if f is not None])
    return places


def _pair(first: Term, second: Term, places: Mapping[str, Array]) -> Finding | None:
    """What two constraints of one view have to do with each other, if they tie the same moving feature."""
    if first.camera != second.camera:
        return None
    a, b = places.get(first.name), places.get(second.name)
    if a is None or b is None:
        return _pair_by_name(first, second)
    if first.kind == "point_to_line" and second.kind == "point_to_point":
        first, second, a, b = second, first, b, a
    moving = constraint_of(first.kind).moving
    if constraint_of(second.kind).moving != moving or not _same_points(a[:moving], b[:moving]):
        return None
    kinds = (first.kind, second.kind)
    if kinds == ("point_to_point", "point_to_point"):
        return _verdict(first, second, float(np.linalg.norm(a[1] - b[1])), "px apart")
    if kinds == ("point_to_point", "point_to_line"):
        off = abs(float(signed_distance(a[1], b[1], b[2])))
        return None if off <= SAME_PX else _verdict(first, second, off, "px from the line")
    if first.kind != second.kind or len(a) - moving != 2:
        return None
    angle = _angle_deg(a[moving:], b[moving:])
    if first.kind == "parallel_lines":
        return _verdict(first, second, angle, "degrees apart", SAME_DEG)
    off = max(abs(float(signed_distance(p, b[moving], b[moving + 1]))) for p in a[moving:])
    if first.kind == "point_to_line":
        # Two lines that cross hold the point where they do.
        return None if angle > SAME_DEG else _verdict(first, second, off, "px apart and parallel")
    return _verdict(first, second, off, "px apart") if first.kind == "line_to_line" else None


def _pair_by_name(first: Term, second: Term) -> Finding | None:
    if first.kind != second.kind or _moving(first) != _moving(second):
        return None
    if first.points == second.points:
        return _copy(first, second)
    if first.kind == "point_to_point":
        return _conflict(first, second, "two different goals")
    return None


def _same_points(a: Array, b: Array) -> bool:
    """Whether (k, 2) pixels are the same, for a line in either order."""
    return any(float(np.linalg.norm(a - other, axis=1).max()) <= SAME_PX for other in (b, b[::-1]))


def _angle_deg(a: Array, b: Array) -> float:
    """Angle between two lines, each (2, 2), 0 to 90 [deg]."""
    u, v = a[1] - a[0], b[1] - b[0]
    return float(np.degrees(np.arctan2(abs(u[0] * v[1] - u[1] * v[0]), abs(float(u @ v)))))


def _verdict(first: Term, second: Term, off: float, unit: str, same: float = SAME_PX) -> Finding:
    if off <= same:
        return _copy(first, second)
    return _conflict(first, second, f"goals that are {off:.0f} {unit}")


def _copy(first: Term, second: Term) -> Finding:
    text = (
        f"{quoted((first.name, second.name))} say the same in the view {first.camera!r}: the second only "
        "doubles the weight. Delete one, and set the weight of the other to 2 if it should count double."
    )
    return Finding("info", "duplicate", text)


def _conflict(first: Term, second: Term, what: str) -> Finding:
    text = (
        f"{quoted((first.name, second.name))} send the same feature to {what} in the view {first.camera!r}: "
        "they cannot both be met. Delete one, or move its goal."
    )
    return Finding("bad", "conflict", text)
