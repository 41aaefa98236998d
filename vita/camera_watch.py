"""Watches the pictures of a rig's cameras: missing, black, of the wrong size, late, out of step or frozen.

A camera that sends nothing usable must not end anything: its picture is replaced by a blank one, its
trackers see nothing, the arm holds, and the camera is asked again until it comes back. Whether to go on
then is for people to say.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vita.feeds import FrozenFeeds
from vita.types import Image, Observation, Status, frozen

log = logging.getLogger("vita.cameras")

PERIOD_S = 1 / 30
LATE_PERIODS = 3.0
"""A picture that is older than this, by the rig's own clock, shows where the arm was."""
SKEW_PERIODS = 1.5
"""Pictures that were taken further apart do not belong together."""
DARK = 10
"""A picture without anything brighter is black, as that of a camera without power [grey levels]."""
FRESH_PERIODS = 10
"""So long must all be well before people are offered to go on."""
ASK_AGAIN_S = (1.0, 2.0, 4.0, 8.0, 16.0, 30.0)
"""Pauses between two attempts to reach a camera; the last one is kept [s]."""
CAMERA_REASONS = ("camera_lost", "images_late", "camera_skew", "frozen_feed")

Reopen = Callable[[str], None]


@dataclass(frozen=True)
class Trouble:
    """Why the arm may not move on what the cameras show; the words for `vita.servo.reasons`."""

    reason: str
    facts: Mapping[str, object]
    cameras: tuple[str, ...]


@dataclass
class _Asking:
    """The attempts to reach one camera."""

    since: float
    tries: int = 0

    def due(self, now: float) -> bool:
        pauses = [ASK_AGAIN_S[min(i, len(ASK_AGAIN_S) - 1)] for i in range(self.tries + 1)]
        return now - self.since >= sum(pauses) - 1e-9


@dataclass
class CameraWatch:
    """`take` once per observation, at rest too; `trouble` while the arm is meant to move."""

    sizes: Mapping[str, tuple[int, int]]
    """Camera name to the (width, height) that its pictures must have."""
    reopen: Reopen | None = None
    """Tries to reach a camera again, without waiting for it; None where the rig does so by itself."""
    unusable: dict[str, str] = field(default_factory=dict)
    """Camera name to why its picture of now cannot be used."""
    _asking: dict[str, _Asking] = field(default_factory=dict)
    _feeds: FrozenFeeds = field(default_factory=FrozenFeeds)
    _late: Trouble | None = None
    _number: int = -1
    _repeats: int = 0
    _held: tuple[str, ...] = ()
    _fresh: int = 0
    _offered: bool = False

    # ---- every observation ---------------------------------------------------------------------

    def take(self, seen: Observation) -> Observation:
        """The observation with a blank picture for every camera whose own cannot be used."""
        self.unusable = {}
        for name, size in self.sizes.items():
            why = _why_unusable(seen.frames.get(name), size)
            if why:
                self.unusable[name] = why
        self._ask(seen.stamp)
        self._repeats = self._repeats + 1 if seen.number <= self._number else 0
        self._number = max(self._number, seen.number)
        if self.unusable:
            blanks = {name: _blank(self.sizes[name]) for name in self.unusable}
            seen = replace(seen, frames={**seen.frames, **blanks})
        return seen

    def failed(self, seen: Observation, failure: Exception) -> Observation:
        """`seen` without pictures, because reading them raised; a `camera` of the failure narrows it down."""
        name = getattr(failure, "camera", None)
        gone = (name,) if name in self.sizes else tuple(self.sizes)
        if not set(gone) <= set(self._asking):
            log.warning("reading a camera failed: %s: %s", type(failure).__name__, failure)
        return replace(seen, frames={key: frame for key, frame in seen.frames.items() if key not in gone})

    def _ask(self, now: float) -> None:
        """Reach for the cameras that are gone, with longer and longer pauses."""
        self._asking = {name: asked for name, asked in self._asking.items() if name in self.unusable}
        for name in self.unusable:
            asking = self._asking.setdefault(name, _Asking(now))
            if not asking.due(now):
                continue
            asking.tries += 1
            try:
                if self.reopen is not None:
                    self.reopen(name)
            except Exception as failure:
                log.warning("camera %r cannot be reached: %s", name, failure)

    # ---- while the arm moves -------------------------------------------------------------------

    def begin(self) -> None:
        """A new run: what was frozen before must show a new picture first."""
        self._feeds = self._feeds.again()
        self._held, self._fresh, self._offered = (), 0, False

    def trouble(self, seen: Observation, cameras: Collection[str]) -> Trouble | None:
        """Why the arm may not move on this observation, which has been through `take`; the gravest first."""
        frozen_feeds = self._feeds.update(seen, [n for n in cameras if n not in self.unusable])
        found = self._lost(cameras) or self._out_of_time(seen, cameras)
        if found is None and frozen_feeds:
            found = Trouble("frozen_feed", {"culprit": _names(frozen_feeds)}, tuple(frozen_feeds))
        if found is not None:
            self._held, self._fresh, self._offered = found.cameras, 0, False
        return found

    def _lost(self, cameras: Collection[str]) -> Trouble | None:
        gone = sorted(n for n in cameras if n in self.unusable)
        if not gone:
            return None
        why = "; ".join(dict.fromkeys(self.unusable[n] for n in gone))
        return Trouble("camera_lost", {"culprit": _names(gone), "why": why}, tuple(gone))

    def _out_of_time(self, seen: Observation, cameras: Collection[str]) -> Trouble | None:
        """Pictures that are too old, or that were not taken together."""
        ages = {n: seen.stamp - seen.stamps.get(n, seen.stamp) + self._repeats * PERIOD_S for n in cameras}
        late = sorted(n for n, age in ages.items() if not age <= LATE_PERIODS * PERIOD_S + 1e-9)
        if late:
            worst = max(ages[n] for n in late)
            return Trouble("images_late", {"late": _names(late), "ms": 1e3 * worst}, tuple(late))
        skew = max(ages.values(), default=0.0) - min(ages.values(), default=0.0)
        if skew > SKEW_PERIODS * PERIOD_S + 1e-9:
            apart = tuple(sorted(ages, key=lambda n: ages[n]))
            return Trouble("camera_skew", {"ms": 1e3 * skew, "culprit": _names(apart)}, apart)
        return None

    # ---- at rest -------------------------------------------------------------------------------

    def offer(self, seen: Observation, status: Status) -> str:
        """What to tell people once when the cameras that stopped the arm are well again; empty otherwise."""
        if status.state != "hold" or status.reason not in CAMERA_REASONS or self._offered or not self._held:
            return ""
        well = self._lost(self._held) is None and self._out_of_time(seen, self._held) is None
        well = well and not self._feeds.still_frozen(seen).intersection(self._held)
        self._fresh = self._fresh + 1 if well else 0
        if self._fresh < FRESH_PERIODS:
            return ""
        self._offered = True
        if status.reason in ("images_late", "camera_skew"):
            return "The pictures come in time again. Press Start to go on."
        return f"Camera {_names(self._held)} is back. Press Start to go on."


def _why_unusable(frame: object, size: tuple[int, int]) -> str:
    """What is wrong with a picture; empty when it can be used."""
    if frame is None:
        return "there is none"
    if not isinstance(frame, np.ndarray) or frame.dtype != np.uint8:
        return f"it is no picture but {getattr(frame, 'dtype', type(frame).__name__)} data"
    width, height = size
    if frame.shape != (height, width, 3):
        got = " x ".join(map(str, frame.shape[1::-1] + frame.shape[2:])) or "nothing"
        return f"it has {got} values and not {width} x {height} x 3"
    if int(frame[::8, ::8].max()) <= DARK and int(frame.max()) <= DARK:
        return "it is black"
    return ""


def _blank(size: tuple[int, int]) -> Image:
    return frozen(np.zeros((size[1], size[0], 3)), np.uint8)


def _names(cameras: Collection[str]) -> str:
    return ", ".join(repr(name) for name in cameras)
