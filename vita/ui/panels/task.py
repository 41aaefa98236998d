"""Composing the task: tools, the prompt, and the lists of trackers and constraints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import viser

from vita import commands as c
from vita.errors import BadInput, UnknownName
from vita.snapshot import Snapshot
from vita.task import LEAST_PRIORITY
from vita.ui import style
from vita.ui.compose import SELECT, TRACKER
from vita.ui.panels import lists
from vita.ui.panels.base import Desk, Html
from vita.ui.panels.rows import RowButtons
from vita.ui.panels.selected import selected_card
from vita.ui.safe import number, short_text
from vita.ui.words import (
    FOLLOW,
    GOAL_AUTO,
    GOAL_FIXED,
    GREEN,
    GREY,
    INK,
    KINDS,
    LINE_EDGE,
    LINE_POINTS,
    TEAL,
    follow_label,
    hexed,
    safe,
)
from vita.vision import TRACKER_KINDS

TAKE_HINT = "Use the nearest good place"
HINT = """<div class="vita"><div class="card hint"><b>Make the arm move</b><ol>
<li>Pick <b>Point → Point</b> above.</li>
<li>Click the card on the arm, then the orange ball. In both views.</li>
<li>Press <b>Start</b>.</li></ol></div></div>"""
COLORS = {**{kind.key: kind.color for kind in KINDS}, TRACKER: GREEN, SELECT: INK}


class TaskPanel:
    def __init__(self, desk: Desk, show_me: Callable[[Any], None]) -> None:
        self._desk, composer = desk, desk.composer
        self._constraint: str | None = None
        self._place_kinds = {follow_label(kind): kind for kind in TRACKER_KINDS}
        self._follow_kinds = {
            label: kind for label, kind in self._place_kinds.items() if kind not in ("fixed", "line")
        }
        self._editing: str | None = None
        gui, guard = desk.gui, desk.guard
        Html(gui, style.TABS_MARK)
        self._sheet = Html(gui)
        self._tools: dict[str, viser.GuiButtonHandle] = {}
        for kind in KINDS:
            self._tools[kind.key] = gui.add_button(kind.label, hint=kind.meaning)
        self._tools[TRACKER] = gui.add_button("Tracker", hint="Place single trackers.")
        self._tools[SELECT] = gui.add_button("Select", hint="Select and move markers.")
        for key, button in self._tools.items():
            button.on_click(guard(lambda event, key=key: desk.composer.arm(key)))
        self._prompt = Html(gui)
        self._take = gui.add_button(TAKE_HINT)
        self._take.on_click(guard(lambda event: composer.accept(desk.snapshot())))
        self._show_me = gui.add_button(
            "Show me an example", icon=viser.Icon.SPARKLES,
            hint="Loads a finished task; then press Start.",
        )
        self._show_me.on_click(guard(show_me))
        self._goal = gui.add_dropdown(
            "Goal", (GOAL_FIXED, GOAL_AUTO),
            hint="Whether a goal stays at its pixel or follows the image there.",
        )
        self._goal.on_update(guard(self._set_goal))
        self._follow = self._kinds(self._follow_kinds, lambda kind: setattr(composer, "follow", kind))
        self._place = self._kinds(self._place_kinds, lambda kind: setattr(composer, "place", kind))
        self._line = gui.add_dropdown(
            "Line", (LINE_POINTS, LINE_EDGE), visible=False,
            hint="Through two points that are followed, or along the image edge between the two clicks.",
        )
        self._line.on_update(guard(self._set_line))
        self._constraints, self._trackers = Html(gui), Html(gui)
        self._name = gui.add_text("Name", "", visible=False, hint="A new name for the selected tracker.")
        self._name.on_update(guard(self._rename))
        self._weight = gui.add_number("Weight", 1.0, min=0.01, max=100.0, step=0.1, visible=False)
        self._weight.on_update(guard(self._set_weight))
        self._priority = gui.add_number(
            "Priority", 1, min=1, max=LEAST_PRIORITY, step=1, visible=False,
            hint="1 is the most important; a higher number acts only where lower ones leave the arm free.",
        )
        self._priority.on_update(guard(self._set_priority))
        self._undo = gui.add_button("Undo", icon=viser.Icon.ARROW_BACK_UP, hint="Ctrl+Z")
        self._redo = gui.add_button("Redo", icon=viser.Icon.ARROW_FORWARD_UP, hint="Ctrl+Y")
        self._clear = gui.add_button(
            "Clear", icon=viser.Icon.TRASH, hint="Delete the whole task; Undo brings it back."
        )
        self._reset = gui.add_button(
            "Reset", icon=viser.Icon.HOME,
            hint="Put the simulated arm and scene back to the start (Shift+R).",
        )
        self._reset.on_click(guard(lambda event: desk.submit(c.ResetArm())))
        self._undo.on_click(guard(lambda event: desk.submit(c.Undo())))
        self._redo.on_click(guard(lambda event: desk.submit(c.Redo())))
        self._clear.on_click(guard(lambda event: desk.submit(c.ClearTask())))
        self._messages = Html(gui)
        self._tracker_rows = RowButtons(
            gui, guard, self._select, lambda name: desk.submit(c.DeleteTracker(name))
        )
        self._constraint_rows = RowButtons(
            gui, guard, self._choose, lambda name: desk.submit(c.DeleteConstraint(name))
        )

    def update(self, snapshot: Snapshot) -> None:
        composer, scenario = self._desk.composer, snapshot.scenario
        empty = not scenario.tracker and not scenario.constraint
        if self._show_me.visible != empty:
            self._show_me.visible = empty
        kind = composer.kind
        self._prompt.show(HINT if empty and not composer.composing else self._prompted(snapshot))
        for handle, shown in (
            (self._goal, kind is not None and "goal" in kind.roles),
            (self._follow, kind is not None),
            (self._place, composer.tool == TRACKER),
            (self._line, kind is not None and bool(kind.lines)),
        ):
            if handle.visible != shown:
                handle.visible = shown
        self._trackers.show(lists.trackers(snapshot, composer.selected, self._tracker_rows.ids))
        self._constraints.show(
            lists.constraints(snapshot, self._constraint, self._constraint_rows.ids)
        )
        self._edit_fields(snapshot)
        for button, enabled in ((self._undo, snapshot.can_undo), (self._redo, snapshot.can_redo),
                                (self._clear, not empty)):
            if button.disabled == enabled:
                button.disabled = not enabled
        self._messages.show(lists.messages(snapshot))
        self._sheet.show(
            style.sheet(
                style.side_by_side(list(self._tools.values()), 3),
                *(style.tool(b, COLORS[k], composer.tool == k) for k, b in self._tools.items()),
                style.filled(self._show_me, TEAL),
                style.side_by_side((self._undo, self._redo, self._clear, self._reset), 4),
                style.plain((self._undo, self._redo, self._clear, self._reset)),
                style.inputs_side_by_side((self._goal, self._follow, self._line)),
                style.hidden((self._take,)), self._tracker_rows.css(), self._constraint_rows.css(),
            )
        )

    def _prompted(self, snapshot: Snapshot) -> str:
        """What to do next, or the card of the selected tracker; and what to do after a refusal."""
        composer = self._desk.composer
        kind, selected = composer.kind, composer.selected
        note = f'<div class="warn">{safe(composer.note)}</div>' if composer.note else ""
        if composer.hint is not None:
            note += f'<label class="take" for="{self._take._impl.uuid}">{TAKE_HINT}</label>'
        if selected is not None and not composer.composing:
            extra = f'<div class="vita"><div class="card">{note}</div></div>' if composer.hint else ""
            return selected_card(snapshot, selected) + extra
        color = kind.color if kind else TEAL if composer.composing else GREY
        title, ask = composer.prompt(tuple(cam.name for cam in snapshot.scenario.camera))
        return (
            f'<div class="vita"><div class="card prompt" style="border-left-color:{hexed(color)}">'
            f"<b>{safe(title)}</b> <span>{safe(ask)}</span>{note}</div></div>"
        )

    def _kinds(self, kinds: Mapping[str, str], choose: Callable[[str], None]) -> Any:
        """A dropdown of tracker kinds, each by its name for people; the hint tells them apart."""
        about = "\n".join(f"{name}: {FOLLOW[kind][1]}" for name, kind in kinds.items() if kind in FOLLOW)
        handle = self._desk.gui.add_dropdown("Follow by", tuple(kinds), visible=False, hint=about)

        def chosen(event: Any) -> None:
            if event.target.value not in kinds:
                raise UnknownName("tracker kind", event.target.value, kinds)
            choose(kinds[event.target.value])

        handle.on_update(self._desk.guard(chosen))
        return handle

    def _edit_fields(self, snapshot: Snapshot) -> None:
        selected = self._desk.composer.selected
        if self._name.visible != (selected is not None):
            self._name.visible = selected is not None
        typed = self._desk.composer.renames.typed(selected)
        if selected is not None and selected != self._editing and not typed:
            self._name.value = selected
        self._editing = selected
        spec = next((k for k in snapshot.scenario.constraint if k.name == self._constraint), None)
        if self._weight.visible != (spec is not None):
            self._weight.visible = self._priority.visible = spec is not None
        if spec is None:
            self._constraint = None

    def _select(self, name: str) -> None:
        composer = self._desk.composer
        if composer.composing:
            composer.put_away()
        composer.selected = None if composer.selected == name else name

    def _choose(self, name: str) -> None:
        self._constraint = None if self._constraint == name else name
        for spec in self._desk.snapshot().scenario.constraint:
            if spec.name == name:
                self._weight.value, self._priority.value = float(spec.weight), int(spec.priority)

    def _set_goal(self, event: Any) -> None:
        choice = event.target.value
        if choice not in (GOAL_FIXED, GOAL_AUTO):
            raise BadInput(f"choose {GOAL_FIXED} or {GOAL_AUTO}", "goal")
        self._desk.composer.goal = "fixed" if choice == GOAL_FIXED else "auto"

    def _set_line(self, event: Any) -> None:
        choice = event.target.value
        if choice not in (LINE_POINTS, LINE_EDGE):
            raise BadInput(f"choose {LINE_POINTS} or {LINE_EDGE}", "line")
        self._desk.composer.edge = choice == LINE_EDGE

    def _rename(self, event: Any) -> None:
        if not str(event.target.value).strip():
            return  # on the way to another name
        new = short_text(event.target.value, "name")
        if any(t.name == new for t in self._desk.snapshot().scenario.tracker):
            if new != self._desk.composer.selected:
                raise BadInput(f"{new!r} is taken", "name")
            return
        self._desk.composer.rename(new)

    def _set_weight(self, event: Any) -> None:
        if self._constraint is not None:
            value = number(event.target.value, 0.01, 100.0, "weight")
            self._desk.submit(c.SetWeight(self._constraint, value))

    def _set_priority(self, event: Any) -> None:
        if self._constraint is not None:
            value = round(number(event.target.value, 1, LEAST_PRIORITY, "priority"))
            self._desk.submit(c.SetPriority(self._constraint, value))

