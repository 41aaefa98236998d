"""Composing a task by clicking: which click means what. Pure logic, without viser.

A tracker is asked for with each click (for a line that sticks to an image edge: with its second click),
so that a bad spot is refused at once, where it was clicked. The constraint follows when every tracker
of it is seen in a snapshot; a refused tracker puts the composer back to the click that failed, with the
reason in the prompt and, where there is one, a hint at the nearest good place.
"""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Concatenate, ParamSpec

from vita import commands as c
from vita.constraints import MIN_LINE_PX
from vita.snapshot import Snapshot
from vita.ui.mode import following
from vita.ui.refusals import HINT_S, Hint, Refusals
from vita.ui.renames import Renames
from vita.ui.words import KIND, Kind, placing

SELECT, TRACKER = "select", "tracker"
PATIENCE_TICKS, PATIENCE_S = 4, 0.8
Uv = tuple[float, float]
P = ParamSpec("P")


def _alone(method: Callable[Concatenate[Composer, P], None]) -> Callable[Concatenate[Composer, P], None]:
    """One at a time: clicks come in one thread, snapshots in another."""

    @functools.wraps(method)
    def locked(self: Composer, *args: P.args, **kwargs: P.kwargs) -> None:
        with self._lock:
            method(self, *args, **kwargs)

    return locked


@dataclass
class Picked:
    """One tracker of the constraint that is being composed."""

    name: str
    ends: tuple[Uv, ...]
    """The clicked pixel; both ends of a line."""
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
    """Tracker kind of new goal features: `fixed`, or `auto` for those that follow the image."""
    follow: str = "auto"
    """Tracker kind of new features that follow the image."""
    place: str = "auto"
    """Tracker kind of the plain tracker tool."""
    edge: bool = False
    """Whether the two clicks of a line make one tracker that sticks to the image edge between them."""
    camera: str | None = None
    picked: list[Picked] = field(default_factory=list)
    first: Uv | None = None
    """One end of a line whose other end has not been clicked yet."""
    selected: str | None = None
    note: str = ""
    """One sentence about the last click that went wrong."""
    hint: Hint | None = None
    finished: int = 0
    """Constraints made since the tool was armed."""
    finished_in: str = ""
    asleep: bool = False
    """Whether nothing can be composed, because the other mode is in force."""
    renames: Renames = field(default_factory=Renames)
    _names: set[str] = field(default_factory=set)
    _refusals: Refusals = field(default_factory=Refusals)
    _lock: threading.RLock = field(default_factory=threading.RLock, repr=False, compare=False)  # type: ignore

    # What the page shows.

    @property
    def kind(self) -> Kind | None:
        return KIND.get(self.tool)

    @property
    def composing(self) -> bool:
        """Whether Esc should put the tool away instead of stopping the arm."""
        return self.tool != SELECT

    @property
    def points(self) -> int:
        """How many of the constraint's points have been clicked."""
        return sum(len(pick.ends) for pick in self.picked) + (self.first is not None)

    def prompt(self, cameras: tuple[str, ...]) -> tuple[str, str]:
        """(title, sentence) of what to do next."""
        kind = self.kind
        if self.tool == TRACKER:
            return "Tracker", f"{placing(self.place, self.first is not None)} Esc when done."
        if kind is None:
            if self.selected:
                return "Select", f"{self.selected}: drag it to move it, Delete removes it."
            return "Select", "Click or drag a marker, or pick a constraint."
        number, total = self.points + 1, len(kind.roles)
        if number > total:
            return kind.label, "One moment ..."
        ask = kind.asks[number - 1]
        if self.edge and (number - 1 in kind.lines or self.first is not None):
            ask += " The line sticks to the edge between the two clicks."
        if number == 1 and self.finished:
            others = [name for name in cameras if name != self.finished_in]
            where = f"Now the same in {others[0]}." if others and self.finished == 1 else "Another one?"
            return kind.label, f"{where} 1 of {total}: {ask} Esc when finished."
        return kind.label, f"{number} of {total}: {ask}"

    # What people do.

    @_alone
    def arm(self, tool: str) -> None:
        """Take a tool in hand. The tool in hand again puts it away."""
        same = tool == self.tool
        self.put_away()
        self.tool = SELECT if same or self.asleep else tool
        if self.tool != SELECT:
            self.selected = None

    @_alone
    def put_away(self) -> None:
        """Esc: forget the clicks of the unfinished constraint and what they made."""
        for pick in self.picked:
            if pick.fresh:
                self.submit(c.DeleteTracker(pick.name))
                self._names.discard(pick.name)
        self.picked, self.first, self.camera, self.note, self.hint = [], None, None, "", None
        self.tool, self.finished, self.finished_in = SELECT, 0, ""

    @_alone
    def click(self, snapshot: Snapshot, camera: str, uv: Uv, hit: str | None) -> None:
        """A click at pixel `uv` of `camera`, on the marker `hit` if there is one within reach."""
        self.note, self.hint = "", None
        if self.asleep:
            return
        self._refusals.forget(snapshot)
        uv = float(uv[0]), float(uv[1])
        kind = self.kind
        if self.tool == SELECT:
            self.selected = hit
        elif (self.picked or self.first) and camera != self.camera:
            what = "line" if self.tool == TRACKER else "constraint"
            self.note = f"All clicks of one {what} belong in one view: go on in {self.camera}."
        elif self.first is not None:
            self._end_line(snapshot, camera, self.first, uv)
        elif self.tool == TRACKER:
            if self.place == "line":
                self.first, self.camera = uv, camera
            elif hit is not None:
                self.note = f"{hit} is already there. Use Select to move it."
            else:
                self._place(snapshot, camera, uv, self.place, "G" if self.place == "fixed" else "T")
        elif kind is not None and self.points < len(kind.roles):
            self._pick(snapshot, kind, camera, uv, hit)

    @_alone
    def accept(self, snapshot: Snapshot) -> None:
        """Take the good place that was offered after a refusal."""
        hint, self.hint = self.hint, None
        if hint is None:
            return
        if isinstance(hint.command, c.MoveTracker) or self.tool == SELECT:
            self.submit(hint.command)
        else:
            self.click(snapshot, hint.camera, hint.uv, None)

    @_alone
    def rename(self, new: str) -> None:
        """Ask for another name of the selected marker, which stays selected."""
        if self.selected is not None and new != self.selected:
            self.submit(c.RenameTracker(self.renames.ask(self.selected, new), new))

    def _pick(self, snapshot: Snapshot, kind: Kind, camera: str, uv: Uv, hit: str | None) -> None:
        """The next click of a constraint."""
        begins_line = self.points in kind.lines
        feature = snapshot.features.get(hit) if hit is not None else None
        segment = feature.segment if feature is not None else None
        if hit is not None and any(pick.name == hit for pick in self.picked):
            self.note = f"{hit} is already used in this constraint. Click another place."
            return
        if hit is not None and segment is not None:
            if not begins_line:
                self.note = f"{hit} is a whole line, and a point is asked for here. Click another place."
                return
            ends = tuple((float(u), float(v)) for u, v in segment)
            self.picked.append(Picked(hit, ends, False, seen=True))
        elif begins_line and self.edge:
            self.first = uv
        elif hit is not None:
            self.picked.append(Picked(hit, (uv,), False, seen=True))
        else:
            moving = kind.roles[self.points] == "moving"
            tracker = self.follow if moving or self.goal == "auto" else self.goal
            self._place(snapshot, camera, uv, tracker, "T" if moving else "G")
        self.camera = camera

    def _end_line(self, snapshot: Snapshot, camera: str, first: Uv, uv: Uv) -> None:
        """The second click of a line that sticks to an edge."""
        if (uv[0] - first[0]) ** 2 + (uv[1] - first[1]) ** 2 < MIN_LINE_PX**2:
            self.note = "The two ends of a line must be further apart. Click its other end."
            return
        self.first = None
        if self.tool == TRACKER:
            self.camera = None
        self._place(snapshot, camera, first, "line", "L", uv)

    # What became of it.

    @_alone
    def reconcile(self, snapshot: Snapshot) -> None:
        """Compare with what the engine made of it; completes the constraint or steps back."""
        if following(snapshot) and not self.asleep:
            self.put_away()
            self.selected = None
        self.asleep = following(snapshot)
        known = {t.name for t in snapshot.scenario.tracker}
        self._names -= known
        if self.selected is not None and self.selected not in known:
            self.selected = self.renames.follow(self.selected, known)
        if self.hint is not None and self.clock() > self.hint.until:
            self.hint = None
        refused = self._hear(snapshot)
        kind = self.kind
        if kind is None or not self.picked:
            return
        for index, pick in enumerate(self.picked):
            pick.seen = pick.seen or pick.name in known
            gone = pick.seen and pick.name not in known
            late = self.clock() - pick.asked_at > PATIENCE_S and snapshot.tick > pick.tick + PATIENCE_TICKS
            if gone or pick.name in refused or (not pick.seen and late):
                self._step_back(index, known)
                if not gone:
                    self.note = refused.get(pick.name) or "That spot was refused; see the message."
                    self.note += " Click another place."
                return
        if self.points == len(kind.roles) and not self.first and all(pick.seen for pick in self.picked):
            self.submit(c.AddConstraint(kind.key, tuple(pick.name for pick in self.picked)))
            self.finished += 1
            self.finished_in = self.camera or ""
            self.picked, self.camera = [], None

    def _hear(self, snapshot: Snapshot) -> Mapping[str, str]:
        """Tracker name to reason of the refusals that are new in this snapshot; takes the offer."""
        news = self._refusals.news(snapshot, self._names)
        self._names.difference_update(news.reasons)
        if news.offer is not None:
            camera, command = news.offer
            self.hint = Hint(camera, command.uv, command, self.clock() + HINT_S)
        if self.tool in (SELECT, TRACKER) and news.text:
            self.note = news.text
        return news.reasons

    def _step_back(self, index: int, known: set[str]) -> None:
        """Back to the click of the `index`-th tracker; later clicks are taken back with it."""
        for pick in self.picked[index:]:
            self._names.discard(pick.name)
        for pick in self.picked[index + 1 :]:
            if pick.fresh and pick.name in known:
                self.submit(c.DeleteTracker(pick.name))
        self.picked, self.first = self.picked[:index], None
        if not self.picked:
            self.camera = None

    def _place(
        self, snapshot: Snapshot, camera: str, uv: Uv, kind: str, letter: str, to: Uv | None = None
    ) -> None:
        """Ask for a tracker; in a constraint it becomes the next of its points."""
        taken = {t.name for t in snapshot.scenario.tracker} | self._names
        number = 1
        while f"{letter}{number}" in taken:
            number += 1
        name = f"{letter}{number}"
        self._names.add(name)
        if self.kind is not None:
            ends = (uv,) if to is None else (uv, to)
            self.picked.append(Picked(name, ends, True, snapshot.tick, self.clock()))
        self.submit(c.AddTracker(camera, uv, kind, name, to))

