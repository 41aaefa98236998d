"""What the watchdogs had to do since vita was started, counted from the states. Pure, without viser."""

from __future__ import annotations

from collections import Counter

from vita.snapshot import Snapshot
from vita.ui.words import safe

LATE = ("images_late", "camera_skew", "frozen_feed")
"""Reasons that pictures gave."""
NAMES: dict[str, tuple[str, str]] = {
    "hold": ("held", "The arm was held, by Stop or by a monitor."),
    "fault": ("faults", "Stops that somebody had to acknowledge."),
    "estop": ("emergency stops", "Pressed, or made by the simulation's own check."),
    "offline": ("offline", "The simulation ended or did not answer for a second."),
    "late": ("late pictures", "Held because pictures came late, apart, or not at all."),
    "left": ("driver left", "Held because the page that drove was closed."),
}


class Tally:
    """Counts each entry into a state once."""

    def __init__(self, now: Snapshot) -> None:
        self.counts: Counter[str] = Counter()
        self._last = now.status.state, now.status.reason

    def note(self, snapshot: Snapshot) -> None:
        state, reason = entered = snapshot.status.state, snapshot.status.reason
        if entered == self._last:
            return
        self._last = entered
        if state in NAMES:
            self.counts[state] += 1
        if reason in LATE:
            self.counts["late"] += 1
        if reason == "driver_left":
            self.counts["left"] += 1

    def html(self, pages: int, dropped: int | None) -> str:
        """`pages` that are open, and the steps that the gate dropped, if it can be asked."""
        shown = [(self.counts[key], name, about) for key, (name, about) in NAMES.items()]
        if dropped is not None:
            about = "Commands that the gate did not carry out: not numbers, too old, or made before a stop."
            shown.append((dropped, "dropped steps", about))
        shown.append((pages, "open pages" if pages != 1 else "open page", "Pages that are looking now."))
        cells = "".join(
            f'<span title="{safe(about)}"><b class="num">{count}</b> {name}</span>'
            for count, name, about in shown
        )
        title = "<h4>Since vita was started</h4>"
        return f'<div class="vita" id="vita-tally">{title}<div class="tally">{cells}</div></div>'
