"""State, Start and Stop: the part of the page that never scrolls away."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import viser

from vita import commands as c
from vita.snapshot import Snapshot
from vita.types import MOVING_STATES
from vita.ui import impedance_words, style
from vita.ui.findings import verdict
from vita.ui.mode import following
from vita.ui.panels.base import Desk, Html
from vita.ui.panels.mode_switch import ModeSwitch
from vita.ui.words import CHIP, DEGRADED, GREEN, RED, explain, hexed, pixels, safe

SPACE_GUARD_S = 0.5
START_LABELS = {"offline": "Restart", "fault": "Acknowledge", "estop": "Reset"}

RATES_PERIOD_S = 1.0
RATES_HINT = (
    "Control: how often the servo reads the cameras and commands the arm. "
    "Pictures: how often this page shows new ones, which never slows the control. "
    "Simulation: simulated seconds per second; below 1 the machine cannot keep up."
)


def rates(snapshot: Snapshot, pictures_hz: float) -> str:
    """The small line that says how fast everything runs."""
    timing = snapshot.timing
    return (
        f'<div class="vita rates num" title="{safe(RATES_HINT)}">'
        f"<span>control <b>{timing.loop_hz:.0f} Hz</b></span>"
        f"<span>pictures <b>{pictures_hz:.0f} Hz</b></span>"
        f"<span>simulation <b>{timing.real_time_factor:.2f}×</b></span></div>"
    )


def warned(snapshot: Snapshot) -> str:
    """What to do before Start when the doctor has found something wrong with the task, else nothing."""
    said, level = verdict(snapshot.findings, len(snapshot.scenario.constraint))
    return f"{said} in the task: read it below its constraints." if level in ("warning", "bad") else ""


class RunPanel:
    """Start also restarts a lost simulation and acknowledges a fault; its label says which."""

    def __init__(
        self, desk: Desk, switch: Callable[[Any], None], pictures_hz: Callable[[], float]
    ) -> None:
        self._desk, self._pictures_hz = desk, pictures_hz
        self._stopped_at = -10.0
        gui = desk.gui
        self._sheet = Html(gui)
        self._mode = ModeSwitch(desk)
        self._status = Html(gui)
        self._start = gui.add_button("Start", icon=viser.Icon.PLAYER_PLAY, hint="Start (Space)")
        self._stop = gui.add_button(
            "Stop", icon=viser.Icon.PLAYER_STOP, color=RED, hint="Stop the arm at once (Space or Esc)"
        )
        self._rates = Html(gui)
        self._rates_at = 0.0
        self._switch = gui.add_button("Cameras or 3D world", hint="V")
        self._sheet.show(
            style.sheet(
                style.BASE, style.HEIGHTS, style.side_by_side((self._start, self._stop), 2),
                style.big(self._start, GREEN), style.big(self._stop, RED), style.hidden((self._switch,)),
                self._mode.css(),
            )
        )
        self._start.on_click(desk.guard(lambda event: self.start(from_button=True)))
        self._stop.on_click(desk.guard(lambda event: self.stop()))
        self._switch.on_click(desk.guard(switch))

    def start(self, from_button: bool = False) -> None:
        """Start, or what Start stands for in this state."""
        # Space on a focused Start button reaches us twice: as the hotkey, which stops, and as a click.
        if from_button and time.monotonic() - self._stopped_at < SPACE_GUARD_S:
            return
        state = self._desk.snapshot().status.state
        if state == "offline":
            self._desk.submit(c.ResetArm())
        elif state in ("fault", "estop"):
            self._desk.submit(c.Acknowledge())
        else:
            self._desk.composer.put_away()
            self._desk.submit(c.Start())

    def stop(self) -> None:
        """The runner's flag: it waits behind nothing."""
        self._stopped_at = time.monotonic()
        self._desk.stop()

    def toggle(self) -> None:
        """Space."""
        if self._desk.snapshot().status.state in MOVING_STATES:
            self.stop()
        else:
            self.start()

    def update(self, snapshot: Snapshot) -> None:
        state, scenario = snapshot.status.state, snapshot.scenario
        self._mode.update(snapshot)
        text, color = DEGRADED if snapshot.status.degraded else CHIP.get(state, (state, RED))
        if following(snapshot):
            text, color = impedance_words.chip(snapshot) or CHIP.get(state, (state, RED))
        reason, figure = self._reason(snapshot), ""
        if following(snapshot):
            figure = impedance_words.errors(snapshot.impedance)
        elif scenario.constraint:
            figure = pixels(snapshot.error.norm)
        error = f'<span class="num dim">error <b class="ink">{figure}</b></span>' if figure else ""
        extra = ""
        if snapshot.progress and snapshot.status.message and not following(snapshot):
            extra = f'<div class="dim">{safe(snapshot.progress)}</div>'
        self._status.show(
            f'<div class="vita" id="vita-run"><div class="row">'
            f'<span class="chip" style="background:{hexed(color)}">{safe(text)}</span>'
            f'<span class="grow"></span>'
            f'{error}<label class="link" for="{self._switch._impl.uuid}" title="Cameras or 3D world (V)">'
            f"⇄ 3D</label></div>{safe(reason)}{extra}</div>"
        )
        now = time.monotonic()
        if now - self._rates_at >= RATES_PERIOD_S:
            self._rates_at = now
            self._rates.show(rates(snapshot, self._pictures_hz()))
        label = START_LABELS.get(state, "Start")
        if self._start.label != label:
            self._start.label = label
        task = following(snapshot) or bool(scenario.constraint)
        ready = state in START_LABELS or (task and state not in MOVING_STATES)
        if self._start.disabled == ready:
            self._start.disabled = not ready

    def _reason(self, snapshot: Snapshot) -> str:
        """The sentence under the chip."""
        if following(snapshot):
            return impedance_words.explain(snapshot)
        state, scenario = snapshot.status.state, snapshot.scenario
        if state == "idle" and self._desk.composer.kind is not None and not scenario.constraint:
            return "Composing: the next click is named below."
        reason = explain(
            snapshot.status, len(scenario.tracker), len(scenario.constraint), snapshot.progress
        )
        if state == "idle" and not snapshot.status.message:
            reason = warned(snapshot) or reason
        return reason
