"""State, Start and Stop: the part of the page that never scrolls away."""

from __future__ import annotations

import time

import viser

from vita import commands as c
from vita.snapshot import Snapshot
from vita.types import MOVING_STATES
from vita.ui import style
from vita.ui.panels.base import Desk, Html
from vita.ui.words import CHIP, GREEN, RED, explain, hexed, pixels, safe

SPACE_GUARD_S = 0.5


class RunPanel:
    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._stopped_at = -10.0
        gui = desk.gui
        self._sheet = Html(gui)
        self._status = Html(gui)
        self._start = gui.add_button("Start", icon=viser.Icon.PLAYER_PLAY, hint="Start (Space)")
        self._stop = gui.add_button(
            "Stop", icon=viser.Icon.PLAYER_STOP, color=RED, hint="Stop the arm at once (Space or Esc)"
        )
        self._acknowledge = gui.add_button("Acknowledge the fault", visible=False)
        self._restart = gui.add_button("Restart the simulation", icon=viser.Icon.REFRESH, visible=False)
        self._restart.on_click(desk.guard(lambda event: desk.submit(c.ResetArm())))
        self._sheet.show(
            style.sheet(
                style.BASE, style.HEIGHTS, style.side_by_side((self._start, self._stop), 2), style.big(self._start, GREEN),
                style.big(self._stop, RED), style.plain((self._acknowledge, self._restart)),
            )
        )
        self._start.on_click(desk.guard(lambda event: self.start(from_button=True)))
        self._stop.on_click(desk.guard(lambda event: self.stop()))
        self._acknowledge.on_click(desk.guard(lambda event: desk.submit(c.Acknowledge())))

    def start(self, from_button: bool = False) -> None:
        # Space on a focused Start button reaches us twice: as the hotkey, which stops, and as a click.
        if from_button and time.monotonic() - self._stopped_at < SPACE_GUARD_S:
            return
        self._desk.composer.put_away()
        self._desk.submit(c.Start())

    def stop(self) -> None:
        self._stopped_at = time.monotonic()
        self._desk.stop()

    def toggle(self) -> None:
        """Space."""
        if self._desk.snapshot().status.state in MOVING_STATES:
            self.stop()
        else:
            self.start()

    def update(self, snapshot: Snapshot) -> None:
        state = snapshot.status.state
        text, color = CHIP.get(state, (state, RED))
        moving = state in MOVING_STATES
        scenario = snapshot.scenario
        reason = explain(
            snapshot.status, len(scenario.tracker), len(scenario.constraint), snapshot.progress
        )
        error = ""
        if scenario.constraint:
            error = f'<span class="num dim">error <b style="color:#18202c">{pixels(snapshot.error.norm)}</b></span>'
        extra = ""
        if snapshot.progress and snapshot.status.message:
            extra = f'<div class="dim">{safe(snapshot.progress)}</div>'
        self._status.show(
            f'<div class="vita" id="vita-run" style="min-height:60px"><div class="row" style="margin-bottom:4px">'
            f'<span class="chip" style="background:{hexed(color)}">{safe(text)}</span>'
            f'<span class="grow"></span>{error}</div>{safe(reason)}{extra}</div>'
        )
        ready = bool(scenario.constraint) and not moving and state not in ("fault", "estop", "offline")
        if self._start.disabled == ready:
            self._start.disabled = not ready
        gone = state == "offline"
        if self._restart.visible != gone:
            self._restart.visible = gone
        broken = state in ("fault", "estop")
        if self._acknowledge.visible != broken:
            self._acknowledge.visible = broken
