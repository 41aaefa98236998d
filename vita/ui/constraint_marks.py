"""How each kind of constraint is drawn over a view."""

from __future__ import annotations

import math

import numpy as np

from vita.scenario.schema import ConstraintSpec
from vita.snapshot import Snapshot
from vita.ui.marks import Drawing, clip_line, loop
from vita.ui.tags import Tag
from vita.ui.words import Rgb, kind_of, pixels


def draw_constraint(
    drawing: Drawing, spec: ConstraintSpec, at: list[np.ndarray], size: tuple[int, int], snapshot: Snapshot,
    unit: float,
) -> None:
    """`at` holds the constraint's points (2,) [px], moving ones first; `unit` is image per screen pixel."""
    color = kind_of(spec.kind).color
    rows = np.asarray(snapshot.error.of(spec.name)) if snapshot.error.labels else np.zeros(0)
    seen = rows[np.isfinite(rows)]
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
        drawing.bold.add(loop(np.stack(at)), color)
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
