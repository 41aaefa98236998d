"""Round-ended plates with truly round edges, which the flat bevel of `slab` is too plain for."""

from __future__ import annotations

import numpy as np

from vita.sim.shapes import Point2, Solid, loft, stadium


def casing(start: Point2, end: Point2, r0: float, r1: float, low: float, high: float, edge: float) -> Solid:
    """A round-ended, possibly tapering plate in the xy plane from `low` to `high`, around two points with
    radii r0 and r1; its rims are quarter circles of radius `edge` [m]."""
    outline = stadium(start, end, r0, r1)
    # The first half of the outline goes around the end, the second around the start.
    around_end, around_start = np.split(outline, 2)
    outwards = np.concatenate([(around_end - end) / r1, (around_start - start) / r0])
    bend = np.linspace(0.0, np.pi / 2, 4)
    inset, rise = edge * (1 - np.sin(bend)), edge * (1 - np.cos(bend))
    levels = [(i, low + z) for i, z in zip(inset, rise, strict=True)]
    levels += [(i, high - z) for i, z in zip(inset[::-1], rise[::-1], strict=True)]
    rings = [np.column_stack([outline - i * outwards, np.full(len(outline), z)]) for i, z in levels]
    return loft(np.array(rings))
