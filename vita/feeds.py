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
        self._crept: dict[str, float] = {}

    def update(self, seen: Observation, cameras: Collection[str]) -> list[str]:
        """The names among `cameras` whose feed is frozen as of this observation."""
        moved = 0.0 if self._q is None else float(np.abs(seen.q - self._q).max())
        for name in cameras:
            frame, last = seen.frames[name], self._frames.get(name)
            self._frames[name] = frame
            if last is None:
                continue
            if not np.array_equal(frame, last):
                self._same[name], self._crept[name] = 0, 0.0
                if moved > MOVED_RAD:
                    self._follows.add(name)
                continue
            # Slow motion adds up: a servo that creeps on behind a frozen picture must be noticed too.
            self._crept[name] = self._crept.get(name, 0.0) + moved
            if self._crept[name] > MOVED_RAD * (self._same.get(name, 0) + 1):
                self._same[name] = self._same.get(name, 0) + 1
        self._q = seen.q
        return sorted(n for n in self._follows.intersection(cameras) if self._same.get(n, 0) >= FROZEN_FRAMES)

    def still_frozen(self, seen: Observation) -> set[str]:
        """Of the frozen ones, those whose picture is even now the one with which they stopped."""
        frozen = {n for n, count in self._same.items() if count >= FROZEN_FRAMES}
        return {n for n in frozen if np.array_equal(seen.frames[n], self._frames[n])}

    def again(self) -> FrozenFeeds:
        """For the next run. A camera that stopped stays known as one that can show the arm, because a
        feed that is frozen from the first picture on would otherwise never be judged."""
        fresh = FrozenFeeds()
        fresh._follows = {n for n in self._follows if self._same.get(n, 0) >= FROZEN_FRAMES}
        return fresh
