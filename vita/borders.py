"""Notices features that are about to leave the picture, before their trackers lose them.

A tracker needs some surroundings, so one at the very border is not to be believed, and one that comes near
it is driven slowly: there is time to stop, or to move the camera.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vita.types import Feature

WIDTH_PX = 640.0
"""Width of the picture for which the distances below are meant; others have them in proportion [px]."""
LEAVING_PX, LOST_PX = 24.0, 8.0
"""So near the border a feature is leaving, or lost."""
BACK_PX = 4.0
"""So much further in must it come before that is over."""


class Borders:
    """Judges the features of points; those of lines reach the border by their nature."""

    def __init__(self) -> None:
        self._leaving: set[str] = set()
        self._lost: set[str] = set()

    def judge(
        self, features: Mapping[str, Feature], sizes: Mapping[str, tuple[int, int]]
    ) -> tuple[dict[str, Feature], tuple[str, ...]]:
        """The features, with those at the border marked lost, and the names of those that are leaving.

        `sizes` names each tracker that is to be judged, with its picture's (width, height).
        """
        out = dict(features)
        for name, (width, height) in sizes.items():
            feature = features[name]
            if not feature.ok or feature.segment is not None:
                self._leaving.discard(name)
                continue
            u, v = feature.uv
            room = min(u, v, width - 1 - u, height - 1 - v) * WIDTH_PX / width
            _update(self._leaving, name, room, LEAVING_PX)
            if _update(self._lost, name, room, LOST_PX):
                out[name] = replace(feature, status="lost", score=0.0, detail="at the border of the picture")
        self._lost.intersection_update(sizes)
        self._leaving.intersection_update(sizes)
        return out, tuple(name for name in sizes if name in self._leaving - self._lost)


def _update(which: set[str], name: str, room: float, least: float) -> bool:
    """Whether `name` is nearer the border than `least`, or was and has not come back far enough yet."""
    near = bool(np.isfinite(room)) and room < least + (BACK_PX if name in which else 0.0)
    (which.add if near else which.discard)(name)
    return near
