"""Where the servo expects the features after its next step, drawn over the images."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vita.snapshot import Snapshot
from vita.types import Array
from vita.ui.marks import RING, Strokes
from vita.ui.words import Rgb

APPEAR_PX, VANISH_PX = 1.5, 0.8
"""A prediction is shown once it is so far away, and until it is nearer than this: one bound would flicker."""
GHOST: Rgb = (168, 85, 247)
RING_PX, RIM_PX, POINTER_PX = 7.0, 14.0, 11.0
"""Radius of the ring, reach of a tracker's marker, length of a short step's pointer [screen pixels]."""
_HEAD = np.array([[-6.5, 4.0], [-6.5, -4.0]])


class Ghosts:
    """Which predictions one window shows."""

    def __init__(self) -> None:
        self._shown: dict[str, Array] = {}

    def update(self, snapshot: Snapshot) -> Mapping[str, Array]:
        """Tracker name to (k, 2, 2): from here to there, for every point of the tracker."""
        shown = {}
        for name, there in snapshot.ghost.items():
            feature = snapshot.features.get(name)
            there = np.asarray(there, float).reshape(-1, 2)
            if feature is None or not feature.ok:
                continue
            here = np.asarray(feature.points, float)
            if here.shape != there.shape or not (np.isfinite(here).all() and np.isfinite(there).all()):
                continue
            least = VANISH_PX if name in self._shown else APPEAR_PX
            if np.linalg.norm(there - here, axis=1).max() >= least:
                shown[name] = np.stack([here, there], axis=1)
        self._shown = shown
        return shown


def draw_ghost(strokes: Strokes, steps: Array, unit: float) -> None:
    """Dashed arrows from here to there (k, 2, 2) with a ring at their ends. A step that the marker would
    hide is a pointer at the marker's rim instead: which way, but not how far. A line is drawn as it will lie.

    `unit` is image pixels per screen pixel.
    """
    short = float(np.linalg.norm(steps[:, 1] - steps[:, 0], axis=1).max()) < RIM_PX * unit
    for here, there in steps:
        length = float(np.linalg.norm(there - here))
        along = (there - here) / max(length, 1e-9)
        if short:
            tip = here + (RIM_PX + POINTER_PX) * unit * along
            strokes.line(here + RIM_PX * unit * along, tip, GHOST)
        else:
            tip = there - RING_PX * unit * along
            strokes.add(there + RING_PX * unit * RING[::2], GHOST)
            strokes.dashes(here, tip, 4 * unit, GHOST)
        if length > 1e-9:
            turn = np.array([[along[0], along[1]], [-along[1], along[0]]])
            strokes.add(np.stack([np.broadcast_to(tip, (2, 2)), tip + unit * _HEAD @ turn], axis=1), GHOST)
    if len(steps) == 2 and not short:
        strokes.dashes(steps[0, 1], steps[1, 1], 4 * unit, GHOST)
