"""The markers of the stereo-impedance mode on the pictures: outlines, their first corners, and names."""

from __future__ import annotations

import numpy as np

from vita.snapshot import Snapshot
from vita.ui.impedance_words import BY_CAMERAS
from vita.ui.layout import Cell
from vita.ui.marks import RING, Drawing, Strokes, loop
from vita.ui.tags import Tag
from vita.ui.words import GREEN, Rgb

COLORS: dict[str, Rgb] = {"tool": BY_CAMERAS, "target": GREEN}


def draw_markers(camera: str, cell: Cell, snapshot: Snapshot, unit: float) -> Drawing:
    """The overlay of one view. `unit` is image pixels per screen pixel."""
    drawing = Drawing(Strokes(), Strokes(), [])
    view, config = snapshot.impedance, snapshot.scenario.impedance
    if camera not in (config.left, config.right):
        return drawing
    numbers = {"tool": config.tool_marker, "target": config.target_marker}
    for row, (marker, number) in enumerate(numbers.items()):
        corners = view.corners.get((camera, marker))
        if corners is None or not np.isfinite(corners).all():
            # Said where nothing else is: what is not seen has no place of its own.
            at = 8.0 * unit, cell.size[1] - (12.0 + 20.0 * row) * unit
            drawing.tags.append(Tag(f"unseen {marker}", f"{marker} {number} not seen", at, "name"))
            continue
        corners = np.asarray(corners, float)
        drawing.bold.add(loop(corners), COLORS[marker])
        drawing.bold.add(corners[0] + 3.0 * unit * RING[::2], COLORS[marker])
        lowest = corners[int(np.argmax(corners[:, 1]))]
        drawing.tags.append(
            Tag(f"marker {marker}", f"{marker} {number}", (float(lowest[0]), float(lowest[1])), "value")
        )
    return drawing
