"""The stereo-impedance mode: what goes on, how near everything is, things to move, and the tuning."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import Field, fields
from typing import Any

import viser

from vita import commands as c
from vita.errors import NotNow
from vita.impedance.config import ImpedanceConfig
from vita.impedance.view import ImpedanceView
from vita.servo.config import Limits
from vita.snapshot import Snapshot
from vita.ui import style
from vita.ui.dragging import Mover, movable
from vita.ui.gauges import LEAST_BAR, LEVEL_COLOR
from vita.ui.impedance_words import (
    STEPS,
    Row,
    calibration,
    cameras,
    degrees,
    lacks_markers,
    millimetres,
    rows,
    step,
    unseen,
)
from vita.ui.panels.base import Desk, Html
from vita.ui.panels.settings import Numbers
from vita.ui.words import TEAL, hexed, safe

GROUPS: dict[str, tuple[str, ...]] = {
    "Spring": ("mass_kg", "stiffness", "damping", "pull_n", "feed_forward", "top_speed"),
    "Keep clear": (
        "push_n", "steepness", "table_m", "base_m", "people_m", "stop_m", "around", "singular_deg",
        "singular_n", "singular_steepness",
    ),
    "Orientation": ("turn_stiffness", "turn_damping"),
    "Calibration": ("wiggle_m", "moved_mm"),
    "Done": ("done_mm", "done_deg", "patience_s", "timeout_s"),
}
"""Folders of the tuning tab; a setting that none of them names goes to the last."""
OPEN = ("Spring",)
SWITCHES = {
    "Orientation": ("turn", "Turn with the target", "Off: only the position is followed."),
    "Done": ("follow", "Go on following", "Off: the run ends once the tool rests at the target."),
}
"""Folder to its setting that is on or off, with the words for it."""
NOTHING = "(nothing can be moved)"
TURN_DEG, RAISE_M = 10.0, 0.05
DRAG_HINT = "Or drag it in a 3D view; with Shift it goes up and down."


def figures(view: ImpedanceView, config: ImpedanceConfig) -> str:
    """Steps, errors and what is known of the cameras, as HTML."""
    now = step(view)
    steps = "".join(
        f'<span class="{"now" if index == now else "past" if index < now else ""}">{index + 1} {name}</span>'
        for index, name in enumerate(STEPS)
    )
    known = view.T_base_left is not None
    learned = f"known from {calibration(view)}" if known else "not learned yet"
    if not known and view.pairs:
        learned = calibration(view)
    hidden = unseen(view, config, "target")
    seen = "seen by both cameras"
    if len(hidden) == 1:
        seen = f"seen by {cameras([name for name in (config.left, config.right) if name not in hidden])} only"
    elif hidden:
        known_before = math.isfinite(view.target_age_s)
        seen = f"not seen, last {view.target_age_s:.1f} s ago" if known_before else "not seen yet"
    return (
        f'<div class="vita" id="vita-stereo"><div class="steps">{steps}</div>'
        f'<div class="facts num"><span>Error</span><b>{millimetres(view.error_mm)}</b>'
        f"<b>{degrees(view.error_deg)}</b>"
        f'<span>Cameras</span><b class="wide">{safe(learned)}</b>'
        f'<span>Target</span><b class="wide">{safe(seen)}</b></div></div>'
    )


def force_bars(shown: tuple[Row, ...]) -> str:
    """The forces as HTML: each with its arrow's colour, a bar, a distance and a word."""
    html = ""
    for row in shown:
        color, share = hexed(LEVEL_COLOR[row.level]), max(min(row.share, 1.0), LEAST_BAR)
        html += (
            f'<div class="gauge" title="{safe(row.force.hint)}"><span><i class="dot" '
            f'style="background:{hexed(row.force.color)}"></i> {safe(row.force.label)}</span>'
            f'<span class="track"><i style="width:{100 * share:.0f}%;background:{color}"></i></span>'
            f'<b class="num">{safe(row.value)}</b>'
            f'<span class="word num" style="color:{color}">{safe(row.word)}</span></div>'
        )
    return (
        '<div class="vita" id="vita-forces"><h4><span>Forces on the virtual mass</span>'
        '<span class="dim">dots: arrows in 3D</span></h4>'
        f'<div class="gauges forces">{html}</div></div>'
    )


class StereoPanel:
    """What goes on, and the things that can be moved."""

    def __init__(self, desk: Desk, mover: Mover, show_me: Callable[[Any], None]) -> None:
        self._desk, self._mover = desk, mover
        gui, guard = desk.gui, desk.guard
        Html(gui, style.TABS_MARK)
        self._show_me = gui.add_button(
            "Show me an example", icon=viser.Icon.SPARKLES, visible=False,
            hint="Loads Follow target; then press Start.",
        )
        self._show_me.on_click(guard(show_me))
        self._figures, self._forces = Html(gui), Html(gui)
        Html(gui, f'<div class="vita"><h4>Move things</h4><div class="dim">{DRAG_HINT}</div></div>')
        self._things: Any = gui.add_dropdown("Move", (NOTHING,), hint="What the buttons below move.")
        self._things.on_update(guard(self._choose))
        self._buttons: dict[str, viser.GuiButtonHandle] = {}

        def press(label: str, hint: str, do: Callable[[str], None]) -> None:
            button = gui.add_button(label, hint=hint)
            button.on_click(guard(lambda event: do(self._thing())))
            self._buttons[label] = button

        degree = f"{TURN_DEG:g} degrees"
        press("Turn left", f"{degree} about the vertical", lambda name: mover.turn_by(name, 2, TURN_DEG))
        press("Turn right", f"{degree} about the vertical", lambda name: mover.turn_by(name, 2, -TURN_DEG))
        press("Up", "5 cm", lambda name: mover.raise_by(name, RAISE_M))
        press("Tilt", f"{degree} about its own y axis", lambda name: mover.turn_by(name, 1, TURN_DEG))
        press("Tilt back", f"{degree} about its own y axis", lambda name: mover.turn_by(name, 1, -TURN_DEG))
        press("Down", "5 cm", lambda name: mover.raise_by(name, -RAISE_M))
        reset = gui.add_button(
            "Reset", icon=viser.Icon.HOME, hint="Put the simulated arm and scene back to the start (Shift+R)."
        )
        reset.on_click(guard(lambda event: desk.submit(c.ResetArm())))
        buttons = tuple(self._buttons.values())
        Html(gui, style.sheet(
            style.side_by_side(buttons, 3), style.plain((*buttons, reset)), style.filled(self._show_me, TEAL)
        ))

    def update(self, snapshot: Snapshot) -> None:
        lost = lacks_markers(snapshot)
        if self._show_me.visible != lost:
            self._show_me.visible = lost
        view, config = snapshot.impedance, snapshot.scenario.impedance
        self._figures.show(figures(view, config))
        self._forces.show(force_bars(rows(view, config)))
        names = movable(snapshot) or (NOTHING,)
        if tuple(self._things.options) != names:
            self._things.options = names
        if self._mover.selected not in names:
            self._mover.selected = None if names == (NOTHING,) else names[0]
        shown = self._mover.selected or NOTHING
        if self._things.value != shown:
            self._things.value = shown
        for button in self._buttons.values():
            if button.disabled != (names == (NOTHING,)):
                button.disabled = names == (NOTHING,)

    def _choose(self, event: Any) -> None:
        if event.target.value in movable(self._desk.snapshot()):
            self._mover.selected = event.target.value

    def _thing(self) -> str:
        if self._mover.selected is None:
            raise NotNow("nothing in this scene can be moved")
        return self._mover.selected


class TuningPanel:
    """Every setting of `ImpedanceConfig` that has a range, and the speed limits."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        gui = desk.gui
        Html(gui, style.TABS_MARK)
        self._numbers = Numbers(desk)
        self._switches: dict[str, viser.GuiCheckboxHandle] = {}
        settings = {f.name: f for f in fields(ImpedanceConfig) if f.metadata}
        grouped = {name for names in GROUPS.values() for name in names}
        for title, names in GROUPS.items():
            others = [n for n in settings if n not in grouped] if title == list(GROUPS)[-1] else []
            with gui.add_folder(title, expand_by_default=title in OPEN):
                if title in SWITCHES:
                    self._switch(*SWITCHES[title])
                for name in (*names, *others):
                    self._setting(settings[name])
        with gui.add_folder("Speed", expand_by_default=False):
            for field in fields(Limits):
                self._numbers.add("limits", field, c.SetLimits)

    def update(self, snapshot: Snapshot) -> None:
        self._numbers.show(snapshot.scenario)
        for name, handle in self._switches.items():
            value = bool(getattr(snapshot.scenario.impedance, name))
            if handle.value != value:
                handle.value = value

    def _setting(self, field: Field[Any]) -> None:
        self._numbers.add("impedance", field, c.SetImpedance, widest=1000.0)

    def _switch(self, name: str, label: str, hint: str) -> None:
        handle = self._desk.gui.add_checkbox(label, True, hint=hint)
        handle.on_update(
            self._desk.guard(lambda event: self._desk.submit(c.SetImpedance(name, bool(event.target.value))))
        )
        self._switches[name] = handle
