"""What is drawn over a camera view: markers, tracked regions and constraints, as line segments and labels.

Everything of one view goes into three line nodes (outline, halo, colour) whose points are replaced,
and a pool of labels that is reused: nodes are never added or removed from frame to frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vita.scenario.schema import ConstraintSpec, TrackerSpec
from vita.snapshot import Snapshot
from vita.types import Feature
from vita.ui.compose import Composer
from vita.ui.layout import Cell
from vita.ui.tags import Tag
from vita.ui.words import GREEN, INK, RED, TEAL, Rgb, kind_of, pixels

_LINEAR = np.array([round(255 * (i / 255) ** 2.2) for i in range(256)], np.uint8)
"""viser takes the colours of line segments as linear light; the page's colours are sRGB."""


def _loop(points: np.ndarray) -> np.ndarray:
    """(k, 2, 2) segments of the closed polygon through `points` (k, 2)."""
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)


_ANGLES = np.linspace(0, 2 * np.pi, 20, endpoint=False)
_RING = _loop(np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1))
# Marks in screen pixels around the feature, each (k, 2, 2) segments.
_ARMS = np.array([[[3, 0], [12, 0]], [[-3, 0], [-12, 0]], [[0, 3], [0, 12]], [[0, -3], [0, -12]]], float)
TRACKER_MARK = np.concatenate([7 * _RING, _ARMS])
GOAL_MARK = np.concatenate([_loop(np.array([[0, -11], [11, 0], [0, 11], [-11, 0]], float)), 2.5 * _RING[::4]])
LOST_MARK = np.array([[[-6, -6], [6, 6]], [[-6, 6], [6, -6]]], float)
PENDING_MARK = 15 * _RING
PLUS_MARK = np.array([[[-5, 0], [5, 0]], [[0, -5], [0, 5]]], float)


class Strokes:
    """Collects 2D line segments with colours, in pixels of one view."""

    def __init__(self) -> None:
        self._segments: list[np.ndarray] = []
        self._colors: list[Rgb] = []

    def add(self, segments: np.ndarray, color: Rgb) -> None:
        """`segments` (k, 2, 2)."""
        self._segments.append(segments)
        self._colors.append(color)

    def line(self, a: np.ndarray, b: np.ndarray, color: Rgb) -> None:
        self.add(np.array([[a, b]]), color)

    def dashes(self, a: np.ndarray, b: np.ndarray, dash: float, color: Rgb) -> None:
        length = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        count = int(min(max(length / (2 * dash), 1), 60))
        t = (np.arange(count)[:, None] + np.array([[0.0, 0.5]])) / count
        self.add(a + t[..., None] * (b - a), color)

    def arrays(self, cell: Cell, z: float) -> tuple[np.ndarray, np.ndarray]:
        """(k, 2, 3) points in the view's frame and (k, 2, 3) colours."""
        if not self._segments:
            return np.zeros((1, 2, 3), np.float32), np.zeros((1, 2, 3), np.uint8)
        flat = np.concatenate(self._segments)
        points = np.empty((len(flat), 2, 3), np.float32)
        points[..., :2] = (flat + 0.5) * cell.scale
        points[..., 2] = z
        colors = np.repeat(_LINEAR[np.array(self._colors)], [len(s) for s in self._segments], axis=0)
        return points, np.repeat(colors[:, None], 2, axis=1)


def clip_line(a: np.ndarray, b: np.ndarray, size: tuple[int, int]) -> np.ndarray | None:
    """(2, 2) ends of the infinite line through `a` and `b` inside the image, or None."""
    low, high = np.array([-0.5, -0.5]), np.array(size) - 0.5
    direction = b - a
    if float(np.abs(direction).max()) < 1e-6:
        return None
    start, stop = -np.inf, np.inf
    for axis in (0, 1):
        if abs(direction[axis]) < 1e-9:
            if not low[axis] <= a[axis] <= high[axis]:
                return None
            continue
        t = (np.array([low[axis], high[axis]]) - a[axis]) / direction[axis]
        start, stop = max(start, t.min()), min(stop, t.max())
    return np.stack([a + start * direction, a + stop * direction]) if start < stop else None


@dataclass
class Drawing:
    """The strokes and labels of one view at one instant."""

    thin: Strokes
    bold: Strokes
    tags: list[Tag]


def draw(
    camera: str,
    cell: Cell,
    snapshot: Snapshot,
    composer: Composer,
    unit: float,
    dragged: Mapping[str, tuple[float, float]],
) -> Drawing:
    """The overlay of one view. `unit` is image pixels per screen pixel, so that markers keep their size."""
    drawing = Drawing(Strokes(), Strokes(), [])
    trackers = {t.name: t for t in snapshot.scenario.tracker if t.camera == camera}
    places: dict[str, np.ndarray] = {}
    for name, spec in trackers.items():
        feature = snapshot.features.get(name)
        if name in dragged:
            places[name] = np.array(dragged[name])
        elif feature is not None and np.isfinite(feature.uv).all():
            places[name] = np.asarray(feature.uv, float)
        elif spec.at is not None:
            places[name] = np.array(spec.at)
    for constraint in snapshot.scenario.constraint:
        if all(p in places for p in constraint.points):
            _constraint(drawing, constraint, [places[p] for p in constraint.points], cell, snapshot, unit)
    goals = {p for k in snapshot.scenario.constraint for p in _goal_names(k)}
    for name, place in places.items():
        _marker(drawing, trackers[name], snapshot.features.get(name), place, unit, name in goals,
                composer, name in dragged)
    _pending(drawing, camera, composer, places, unit)
    return drawing


def _goal_names(constraint: ConstraintSpec) -> Sequence[str]:
    roles = kind_of(constraint.kind).roles
    return [p for p, role in zip(constraint.points, roles, strict=False) if role == "goal"]


def _constraint(
    drawing: Drawing, spec: ConstraintSpec, at: list[np.ndarray], cell: Cell, snapshot: Snapshot, unit: float
) -> None:
    color = kind_of(spec.kind).color
    rows = np.asarray(snapshot.error.of(spec.name)) if snapshot.error.labels else np.zeros(0)
    seen = rows[np.isfinite(rows)]
    size = cell.size
    if spec.kind == "point_to_point" and len(at) >= 2:
        drawing.bold.line(at[0], at[1], color)
        spot = (at[0] + at[1]) / 2
        value = math.sqrt(float(seen @ seen)) if seen.size else float("nan")
    elif spec.kind == "point_to_line" and len(at) >= 3:
        _line(drawing, at[1], at[2], size, color, unit)
        along = (at[2] - at[1]) / max(float(np.linalg.norm(at[2] - at[1])), 1e-9)
        foot = at[1] + along * float((at[0] - at[1]) @ along)
        drawing.bold.line(at[0], foot, color)
        spot = (at[0] + foot) / 2
        value = float(np.abs(seen).max()) if seen.size else float("nan")
    elif len(at) >= 4:
        _line(drawing, at[0], at[1], size, color, unit)
        _line(drawing, at[2], at[3], size, color, unit, dashed=True)
        a, b = (at[0] + at[1]) / 2, (at[2] + at[3]) / 2
        drawing.thin.dashes(a, b, 5 * unit, color)
        spot = (a + b) / 2
        value = float(np.abs(seen).max()) if seen.size else float("nan")
    else:
        drawing.bold.add(_loop(np.stack(at)), color)
        spot = np.mean(at, axis=0)
        value = math.sqrt(float(seen @ seen)) if seen.size else float("nan")
    if snapshot.error.labels:
        place = float(spot[0]), float(spot[1])
        drawing.tags.append(Tag(f"value {spec.name}", pixels(value), place, "value"))


def _line(
    drawing: Drawing, a: np.ndarray, b: np.ndarray, size: tuple[int, int], color: Rgb, unit: float,
    dashed: bool = False,
) -> None:
    """A segment, drawn bold, and its continuation to the edges of the image, drawn thin."""
    drawing.bold.line(a, b, color)
    ends = clip_line(a, b, size)
    if ends is not None:
        if dashed:
            drawing.thin.dashes(ends[0], ends[1], 6 * unit, color)
        else:
            drawing.thin.line(ends[0], ends[1], color)


def _marker(
    drawing: Drawing, spec: TrackerSpec, feature: Feature | None, at: np.ndarray, unit: float, goal: bool,
    composer: Composer, dragged: bool,
) -> None:
    lost = feature is not None and not feature.ok
    color: Rgb = RED if lost else TEAL if spec.kind == "fixed" else GREEN
    mark = GOAL_MARK if goal or spec.kind == "fixed" else TRACKER_MARK
    drawing.bold.add(at + unit * mark, color)
    if lost:
        drawing.bold.add(at + unit * LOST_MARK, RED)
    if dragged or composer.selected == spec.name:
        drawing.bold.add(at + 17 * unit * _RING, (255, 255, 255))
        drawing.thin.add(at + 19 * unit * _RING, INK)
    if feature is not None and feature.corners is not None and not dragged:
        corners = np.asarray(feature.corners, float)
        if np.isfinite(corners).all():
            drawing.thin.add(_loop(corners), color)
    text = f"{spec.name} lost" if lost else spec.name
    kind = "goal" if goal or spec.kind == "fixed" else "name"
    drawing.tags.append(Tag(f"name {spec.name}", text, (float(at[0]), float(at[1])), kind))


def _pending(
    drawing: Drawing, camera: str, composer: Composer, places: Mapping[str, np.ndarray], unit: float
) -> None:
    """The clicks of the constraint that is being composed, numbered."""
    kind = composer.kind
    if kind is None or composer.camera != camera:
        return
    for index, pick in enumerate(composer.picked):
        at = places.get(pick.name, np.array(pick.uv))
        drawing.bold.add(at + unit * PENDING_MARK, kind.color)
        if pick.name not in places:
            drawing.bold.add(at + unit * PLUS_MARK, kind.color)
        drawing.tags.append(Tag(f"click {index}", str(index + 1), (float(at[0]), float(at[1])), "value"))
