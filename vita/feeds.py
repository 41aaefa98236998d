"""Notices a camera that keeps sending the same picture while the arm moves.

It is the worst of the vision faults: every tracker says ok, the error stands still, and the servo
pushes on. A picture that is the same to the bit while the joints move means that the feed is frozen,
unless this camera does not see the arm at all; so only a camera whose picture has followed the
arm's motion before is judged.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from vita.types import Array, Image, Observation

FROZEN_FRAMES = 3
MOVED_RAD = 1e-3
"""Joint motion between two frames that must show in the picture of a camera that sees the arm."""


class FrozenFeeds:
    """Watches the feeds of one run."""

    def __init__(self) -> None:
        self._q: Array | None = None
        self._frames: dict[str, Image] = {}
        self._follows: set[str] = set()
        self._same: dict[str, int] = {}

    def update(self, seen: Observation, cameras: Collection[str]) -> list[str]:
        """The names among `cameras` whose feed is frozen as of this observation."""
        moved = self._q is not None and float(np.abs(seen.q - self._q).max()) > MOVED_RAD
        for name in cameras:
            frame = seen.frames[name]
            last = self._frames.get(name)
            self._frames[name] = frame
            if last is None or not moved:
                continue
            if np.array_equal(frame, last):
                self._same[name] = self._same.get(name, 0) + 1
            else:
                self._same[name] = 0
                self._follows.add(name)
        self._q = seen.q
        return sorted(n for n in self._follows if self._same.get(n, 0) >= FROZEN_FRAMES)
