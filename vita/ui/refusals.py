"""What the engine would not do, as the composer needs it: whose click, why, and what would do instead."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from vita import commands as c
from vita.snapshot import Snapshot
from vita.types import Notice

HINT_S = 20.0
"""So long a good place stays offered after a refusal [s]."""
Placement = c.AddTracker | c.MoveTracker


@dataclass(frozen=True)
class Hint:
    """Where a refused tracker could hold on."""

    camera: str
    uv: tuple[float, float]
    command: Placement
    """What was refused, at that place."""
    until: float


@dataclass(frozen=True)
class News:
    """The refusals that a snapshot brought."""

    reasons: Mapping[str, str] = field(default_factory=dict)
    """Tracker name to reason."""
    offer: tuple[str, Placement] | None = None
    """The camera, and what would have been taken."""
    text: str = ""
    """Reason of the last refusal that concerns a click."""


class Refusals:
    """Reads each notice once. What was said before the page opened is old news."""

    def __init__(self) -> None:
        self._heard: int | None = None

    def forget(self, snapshot: Snapshot) -> None:
        """What has been said up to now concerns an earlier click."""
        self._heard = _newest(snapshot)

    def news(self, snapshot: Snapshot, names: Iterable[str]) -> News:
        """The new refusals; `names` are the trackers that have been asked for and not been seen yet."""
        heard = _newest(snapshot) if self._heard is None else self._heard
        self._heard = max(heard, _newest(snapshot))
        reasons: dict[str, str] = {}
        offer, text = None, ""
        for notice in snapshot.notices:
            if notice.id <= heard or notice.level == "info":
                continue
            mine = [name for name in names if repr(name) in notice.text]
            reasons.update(dict.fromkeys(mine, notice.text))
            offered = _offer(notice, snapshot)
            offer = offered or offer
            if mine or offered:
                text = notice.text
        return News(reasons, offer, text)


def _offer(notice: Notice, snapshot: Snapshot) -> tuple[str, Placement] | None:
    command = notice.instead
    if isinstance(command, c.AddTracker):
        return command.camera, command
    if isinstance(command, c.MoveTracker):
        cameras = {spec.name: spec.camera for spec in snapshot.scenario.tracker}
        return (cameras[command.name], command) if command.name in cameras else None
    return None


def _newest(snapshot: Snapshot) -> int:
    return max((notice.id for notice in snapshot.notices), default=0)
