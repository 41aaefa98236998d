"""What is drawn over a camera view: trackers with their regions and trails, and constraints.

Everything of one view goes into three line nodes (outline, halo, colour) whose points are replaced,
and a pool of labels that is reused: nodes are never added or removed from frame to frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vita.scenario.schema import ConstraintSpec, TrackerSpec
from vita.snapshot import Snapshot
from vita.types import Array, Feature
from vita.ui.compose import Composer
from vita.ui.constraint_marks import draw_constraint
from vita.ui.ghost import draw_ghost
from vita.ui.layout import Cell
from vita.ui.marker_outlines import draw_markers
from vita.ui.marks import (
    END_MARK,
    GOAL_MARK,
    LOST_MARK,
    PENDING_MARK,
    PLUS_MARK,
    RING,
    TRACKER_MARK,
    Drawing,
    Strokes,
    loop,
)
from vita.ui.mode import following
from vita.ui.tags import Tag
from vita.ui.trails import Trails
from vita.ui.words import GREEN, INK, RED, TEAL, WHITE, Rgb, kind_of, quality

Uv = tuple[float, float]
NO_TRAILS = Trails()
NO_GHOSTS: Mapping[str, Array] = {}
HINT_LABEL = "good place: click here"


def draw(
    camera: str,
    cell: Cell,
    snapshot: Snapshot,
    composer: Composer,
    unit: float,
    dragged: Mapping[str, Array],
    trails: Trails = NO_TRAILS,
    aim: Uv | None = None,
    ghosts: Mapping[str, Array] = NO_GHOSTS,
) -> Drawing:
    """The overlay of one view. `unit` is image pixels per screen pixel, so that markers keep their size.

    `dragged` holds the points (k, 2) of markers in somebody's hand, `aim` the pixel under the pointer,
    `ghosts` the steps (k, 2, 2) that trackers are expected to make, of all views.
    """
    if following(snapshot):
        return draw_markers(camera, cell, snapshot, unit)
    drawing = Drawing(Strokes(), Strokes(), [])
    trackers = {t.name: t for t in snapshot.scenario.tracker if t.camera == camera}
    where = {name: _points(spec, snapshot, dragged) for name, spec in trackers.items()}
    places = {name: points for name, points in where.items() if points is not None}
    for name in places:
        if name not in dragged:
            _trail(drawing, trails.of(name), snapshot.features.get(name))
    for constraint in snapshot.scenario.constraint:
        if all(p in places for p in constraint.points):
            # A tracked line gives both of its ends.
            at = [point for p in constraint.points for point in places[p]]
            draw_constraint(drawing, constraint, at, cell.size, snapshot, unit)
    goals = {p for k in snapshot.scenario.constraint for p in _goal_names(k, places)}
    for name, points in places.items():
        _marker(drawing, trackers[name], snapshot.features.get(name), points, unit, name in goals,
                composer, name in dragged)
    for name, steps in ghosts.items():
        if name in places and name not in dragged:
            draw_ghost(drawing.ghost, steps, unit)
    _pending(drawing, camera, composer, places, unit, aim)
    _hint(drawing, camera, composer, unit, snapshot.stamp)
    return drawing


def _points(spec: TrackerSpec, snapshot: Snapshot, dragged: Mapping[str, Array]) -> np.ndarray | None:
    """(k, 2) where a tracker is shown: in a hand, where it was seen, or where it was asked for."""
    feature = snapshot.features.get(spec.name)
    if spec.name in dragged:
        return np.asarray(dragged[spec.name], float)
    if feature is not None and np.isfinite(feature.points).all():
        return np.asarray(feature.points, float)
    ends = [end for end in (spec.at, spec.to) if end is not None]
    return np.array(ends, float) if ends else None


def _goal_names(constraint: ConstraintSpec, places: Mapping[str, np.ndarray]) -> Sequence[str]:
    """The trackers of a constraint that stand for a goal; roles count points, of which a line has two."""
    roles, names, number = kind_of(constraint.kind).roles, [], 0
    for name in constraint.points:
        if number < len(roles) and roles[number] == "goal":
            names.append(name)
        number += len(places[name]) if name in places else 1
    return names


def _trail(drawing: Drawing, trail: Array, feature: Feature | None) -> None:
    """A line behind the tracker whose older parts are ever shorter dashes: strokes cannot be transparent."""
    if len(trail) < 2 or feature is None:
        return
    count = len(trail) - 1
    share = 0.15 + 0.85 / count * np.arange(1, count + 1)[:, None]
    segments = np.empty((count, 2, 2))
    segments[:, 0] = trail[:-1]
    segments[:, 1] = trail[:-1] + share * (trail[1:] - trail[:-1])
    drawing.thin.add(segments, quality(feature.score) if feature.ok else RED)


def _marker(
    drawing: Drawing, spec: TrackerSpec, feature: Feature | None, points: np.ndarray, unit: float, goal: bool,
    composer: Composer, dragged: bool,
) -> None:
    lost = feature is not None and not feature.ok
    fixed = spec.kind == "fixed"
    score = feature.score if feature is not None else 1.0
    color: Rgb = RED if lost else TEAL if fixed else quality(score)
    at = (points[0] + points[-1]) / 2
    if len(points) == 2:
        drawing.bold.line(points[0], points[1], color)
        for end in points:
            drawing.bold.add(end + unit * END_MARK, color)
    else:
        drawing.bold.add(at + unit * (GOAL_MARK if goal or fixed else TRACKER_MARK), color)
    if lost:
        drawing.bold.add(at + unit * LOST_MARK, RED)
    if dragged or composer.selected == spec.name:
        drawing.bold.add(at + 17 * unit * RING, WHITE)
        drawing.thin.add(at + 19 * unit * RING, INK)
    if feature is not None and not dragged:
        for region in (feature.corners, feature.outline):
            if region is not None and np.isfinite(region).all():
                drawing.thin.add(loop(np.asarray(region, float)), color)
    text = f"{spec.name} lost: drag it back or delete it" if lost else spec.name
    kind = "goal" if goal or fixed else "name"
    drawing.tags.append(Tag(f"name {spec.name}", text, (float(at[0]), float(at[1])), kind))


def _pending(
    drawing: Drawing, camera: str, composer: Composer, places: Mapping[str, np.ndarray], unit: float,
    aim: Uv | None,
) -> None:
    """The clicks of the constraint that is being composed, numbered."""
    if composer.camera != camera:
        return
    color = composer.kind.color if composer.kind is not None else GREEN
    number = 1
    for pick in composer.picked:
        at = places.get(pick.name, np.array(pick.ends))
        for u, v in at:
            drawing.bold.add((u, v) + unit * PENDING_MARK, color)
            if pick.name not in places:
                drawing.bold.add((u, v) + unit * PLUS_MARK, color)
            drawing.tags.append(Tag(f"click {number}", str(number), (float(u), float(v)), "value"))
            number += 1
    if composer.first is not None:
        first = np.array(composer.first)
        drawing.bold.add(first + unit * END_MARK, color)
        drawing.bold.add(first + unit * PENDING_MARK, color)
        drawing.tags.append(Tag(f"click {number}", str(number), composer.first, "value"))
        if aim is not None:
            drawing.thin.dashes(first, np.array(aim), 5 * unit, color)


def _hint(drawing: Drawing, camera: str, composer: Composer, unit: float, now: float) -> None:
    """Where a refused tracker could hold on: a ring that beats, to be clicked."""
    hint = composer.hint
    if hint is None or hint.camera != camera:
        return
    at = np.array(hint.uv)
    drawing.bold.add(at + unit * (13 + 3 * np.sin(6.0 * now)) * RING, GREEN)
    drawing.bold.add(at + unit * PLUS_MARK, GREEN)
    drawing.tags.append(Tag("hint", HINT_LABEL, hint.uv, "value"))
