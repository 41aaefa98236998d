"""Composing a task by clicking: which click means what. Pure logic, without viser.

A tracker is asked for with each click, so that a bad spot is refused at once, where it was clicked.
The constraint follows when every tracker of it is seen in a snapshot; a refused tracker puts the
composer back to the click that failed, with the reason in the prompt.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from vita import commands as c
from vita.snapshot import Snapshot
from vita.ui.words import KIND, Kind

SELECT, TRACKER = "select", "tracker"
PATIENCE_TICKS, PATIENCE_S = 4, 0.8


@dataclass
class Picked:
    """One click of the constraint that is being composed."""

    name: str
    uv: tuple[float, float]
    fresh: bool
    """Whether the click made the tracker; only those are deleted when the person cancels."""
    tick: int = 0
    asked_at: float = 0.0
    seen: bool = False


@dataclass
class Composer:
    """The tool in the person's hand and what has been clicked with it so far."""

    submit: Callable[[object], None]
    clock: Callable[[], float] = time.monotonic
    tool: str = SELECT
    """`select`, `tracker` or the key of a constraint kind."""
    goal: str = "fixed"
    """Tracker kind of new goal features: `fixed` or `auto`."""
    place: str = "auto"
    """Tracker kind of the plain tracker tool."""
    camera: str | None = None
    picked: list[Picked] = field(default_factory=list)
    selected: str | None = None
    note: str = ""
    """One sentence about the last click that went wrong."""
    finished: int = 0
    """Constraints made since the tool was armed."""
    finished_in: str = ""
    _names: set[str] = field(default_factory=set)
    _latest_notice: int = 0

    # What the page shows.

    @property
    def kind(self) -> Kind | None:
        return KIND.get(self.tool)

    @property
    def composing(self) -> bool:
        """Whether Esc should put the tool away instead of stopping the arm."""
        return self.tool != SELECT

    def prompt(self, cameras: tuple[str, ...]) -> tuple[str, str]:
        """(title, sentence) of what to do next."""
        kind = self.kind
        if self.tool == TRACKER:
            what = "that follows the image" if self.place == "auto" else "that stays where it is"
            return "Tracker", f"Click in a view to place a tracker {what}. Esc when done."
        if kind is None:
            if self.selected:
                return "Select", f"{self.selected}: drag it to move it, Delete removes it."
            return "Select", "Click or drag a marker, or pick a constraint."
        number, total = len(self.picked) + 1, len(kind.roles)
        if number > total:
            return kind.label, "One moment ..."
        if number == 1 and self.finished:
            others = [name for name in cameras if name != self.finished_in]
            where = f"Now the same in {others[0]}." if others and self.finished == 1 else "Another one?"
            return kind.label, f"{where} 1 of {total}: {kind.asks[0]} Esc when finished."
        return kind.label, f"{number} of {total}: {kind.asks[number - 1]}"

    # What people do.

    def arm(self, tool: str) -> None:
        """Take a tool in hand. The tool in hand again puts it away."""
        same = tool == self.tool
        self.put_away()
        self.tool = SELECT if same else tool
        if self.tool != SELECT:
            self.selected = None

    def put_away(self) -> None:
        """Esc: forget the clicks of the unfinished constraint and what they made."""
        for pick in self.picked:
            if pick.fresh:
                self.submit(c.DeleteTracker(pick.name))
                self._names.discard(pick.name)
        self.picked, self.camera, self.note = [], None, ""
        self.tool, self.finished, self.finished_in = SELECT, 0, ""

    def click(self, snapshot: Snapshot, camera: str, uv: tuple[float, float], hit: str | None) -> None:
        """A click at pixel `uv` of `camera`, on the marker `hit` if there is one within reach."""
        self.note = ""
        kind = self.kind
        if self.tool == SELECT:
            self.selected = hit
        elif self.tool == TRACKER:
            if hit is None:
                self._place(snapshot, camera, uv, self.place, "T" if self.place == "auto" else "G")
            else:
                self.note = f"{hit} is already there. Use Select to move it."
        elif kind is not None and len(self.picked) < len(kind.roles):
            if self.picked and camera != self.camera:
                self.note = f"All clicks of one constraint belong in one view: go on in {self.camera}."
                return
            if hit is not None and any(pick.name == hit for pick in self.picked):
                self.note = f"{hit} is already used in this constraint. Click another place."
                return
            moving = kind.roles[len(self.picked)] == "moving"
            if hit is None:
                made = self._place(
                    snapshot, camera, uv, "auto" if moving else self.goal, "T" if moving else "G"
                )
                self.picked.append(Picked(made, uv, True, snapshot.tick, self.clock()))
            else:
                self.picked.append(Picked(hit, uv, False, seen=True))
            self.camera = camera

    def reconcile(self, snapshot: Snapshot) -> None:
        """Compare with what the engine made of it; completes the constraint or steps back."""
        known = {t.name for t in snapshot.scenario.tracker}
        self._names -= known
        if self.selected is not None and self.selected not in known:
            self.selected = None
        kind = self.kind
        if kind is None or not self.picked:
            return
        for index, pick in enumerate(self.picked):
            pick.seen = pick.seen or pick.name in known
            gone = pick.seen and pick.name not in known
            late = self.clock() - pick.asked_at > PATIENCE_S and snapshot.tick > pick.tick + PATIENCE_TICKS
            if gone or (not pick.seen and late):
                self.picked = self.picked[:index]
                self._names.discard(pick.name)
                self.note = "" if gone else "That spot was refused; see the message. Click another place."
                if not self.picked:
                    self.camera = None
                return
        if len(self.picked) == len(kind.roles) and all(pick.seen for pick in self.picked):
            self.submit(c.AddConstraint(kind.key, tuple(pick.name for pick in self.picked)))
            self.finished += 1
            self.finished_in = self.camera or ""
            self.picked, self.camera = [], None

    def _place(
        self, snapshot: Snapshot, camera: str, uv: tuple[float, float], kind: str, letter: str
    ) -> str:
        taken = {t.name for t in snapshot.scenario.tracker} | self._names
        number = 1
        while f"{letter}{number}" in taken:
            number += 1
        name = f"{letter}{number}"
        self._names.add(name)
        self.submit(c.AddTracker(camera, (float(uv[0]), float(uv[1])), kind, name))
        return name
