"""Where each tracker has been in the last two seconds, for a fading line behind it."""

from __future__ import annotations

from collections import deque

import numpy as np

from vita.snapshot import Snapshot
from vita.types import Array

SPAN_S = 2.0
LEAST_PX = 2.0
"""A tracker that has moved less than this has no trail: it would only be noise around the marker."""
JUMP_PX = 60.0
"""Further than a picture's motion: somebody has put the tracker elsewhere."""
LONGEST = 80
"""So many places are kept at most, whatever the rate of the pictures."""


class Trails:
    """The places of one window's trackers, taken from the snapshots that it shows."""

    def __init__(self) -> None:
        self._places: dict[str, deque[tuple[float, float, float]]] = {}

    def add(self, snapshot: Snapshot) -> None:
        """Remember where the trackers of `snapshot` are. Goals that were drawn have no trail."""
        now = snapshot.stamp
        moving = {t.name for t in snapshot.scenario.tracker if t.kind != "fixed"}
        for name in [n for n in self._places if n not in moving]:
            del self._places[name]
        for name in moving:
            feature = snapshot.features.get(name)
            places = self._places.setdefault(name, deque(maxlen=LONGEST))
            if feature is not None and feature.ok and np.isfinite(feature.uv).all():
                u, v = float(feature.uv[0]), float(feature.uv[1])
                if places:
                    before, last_u, last_v = places[-1]
                    if now < before or max(abs(u - last_u), abs(v - last_v)) > JUMP_PX:
                        places.clear()
                places.append((now, u, v))
            while places and places[0][0] < now - SPAN_S:
                places.popleft()

    def of(self, name: str) -> Array:
        """(k, 2) the trail of a tracker [px], oldest first; empty while it rests."""
        places = self._places.get(name, ())
        us, vs = [place[1] for place in places], [place[2] for place in places]
        if len(us) < 2 or max(max(us) - min(us), max(vs) - min(vs)) < LEAST_PX:
            return np.zeros((0, 2))
        return np.array([us, vs]).T
