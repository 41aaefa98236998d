"""State, Start and Stop: the part of the page that never scrolls away."""

from __future__ import annotations

import glob
import io
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import viser

from vita import commands as c
from vita.errors import BadInput, NotNow
from vita.snapshot import Snapshot
from vita.types import MOVING_STATES
from vita.ui import impedance_words, style
from vita.ui.findings import verdict
from vita.ui.mode import following
from vita.ui.panels.base import Desk, Html
from vita.ui.panels.mode_switch import ModeSwitch
from vita.ui.words import CHIP, DEGRADED, GREEN, RED, explain, hexed, pixels, safe

SPACE_GUARD_S = 0.5
CLEAR_GUARD_S = 0.8
"""So long after Acknowledge, Reset or Restart the button does nothing [s]: the second click of a double
click would find it called Start."""
START_LABELS = {"offline": "Restart", "fault": "Acknowledge", "estop": "Reset"}

YES = "Yes, it is safe: reset"
ASK = "Is everybody out of the arm's reach, and its way clear? Reset moves nothing; Start is a second act."
ASK_S = 20.0
"""So long the question of Reset stands [s]."""
ESTOP_HINT = "Stop at once and latch: nobody can start before Reset (Shift+Space). Every page may press it."
LEAVES_EVIDENCE = ("fault", "estop", "offline")

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
        self._stopped_at, self._asked_at, self._cleared_at = -10.0, -60.0, -10.0
        gui = desk.gui
        self._sheet = Html(gui)
        self._mode = ModeSwitch(desk)
        # Stop comes first: it stands at one place, however much there is to say below.
        self._start = gui.add_button("Start", icon=viser.Icon.PLAYER_PLAY, hint="Start (Space)")
        self.stop_button = gui.add_button(
            "Stop", icon=viser.Icon.PLAYER_STOP, color=RED, hint="Stop the arm at once (Space or Esc)"
        )
        self.estop_button = gui.add_button("Emergency stop", color=RED, hint=ESTOP_HINT)
        self._status = Html(gui)
        self._yes = gui.add_button(YES, visible=False, hint="Ends the emergency stop. The arm does not move.")
        self.who = gui.add_folder(None)
        """Each page shows here who drives (`vita.ui.visitors`)."""
        self._rates = Html(gui)
        self._rates_at = 0.0
        self._switch = gui.add_button("Cameras or 3D world", hint="V")
        self._fetch = gui.add_button("Download the evidence")
        self._sheet.show(
            style.sheet(
                style.BASE, style.HEIGHTS,
                style.side_by_side((self._start, self.stop_button, self.estop_button), 3),
                style.big(self._start, GREEN), style.big(self.stop_button, RED),
                style.latching(self.estop_button), style.filled(self._yes, GREEN),
                style.hidden((self._switch, self._fetch)), self._mode.css(),
            )
        )
        self._start.on_click(desk.guard(lambda event: self.start(from_button=True)))
        self.stop_button.on_click(desk.anyone(lambda event: self.stop()))
        self.estop_button.on_click(desk.anyone(lambda event: self.estop()))
        self._yes.on_click(desk.guard(lambda event: self.reset()))
        self._switch.on_click(desk.anyone(switch))
        self._fetch.on_click(desk.anyone(self._do_fetch))

    def start(self, from_button: bool = False) -> None:
        """Start, or what Start stands for in this state."""
        # Space on a focused Start button reaches us twice: as the hotkey, which stops, and as a click.
        if from_button and time.monotonic() - self._stopped_at < SPACE_GUARD_S:
            return
        if time.monotonic() - self._cleared_at < CLEAR_GUARD_S:
            return
        status = self._desk.snapshot().status
        state = status.state
        if state in START_LABELS:
            self._cleared_at = time.monotonic()
        if state == "offline" or status.reason == "controller_stopped":
            self._desk.submit(c.ResetArm())
        elif state == "fault":
            self._desk.submit(c.Acknowledge())
        elif state == "estop":
            self._asked_at = time.monotonic()
        else:
            self._desk.composer.put_away()
            self._desk.submit(c.Start())

    def stop(self) -> None:
        """The runner's flag: it waits behind nothing."""
        self._stopped_at = time.monotonic()
        self._desk.stop()

    def estop(self) -> None:
        """Stop and latch: nothing is asked, nothing is waited for."""
        self._stopped_at = time.monotonic()
        self._asked_at = -60.0
        self._desk.estop()

    def reset(self) -> None:
        """The second click of Reset, which says that it is safe. The arm does not move by it."""
        if not self._asking(self._desk.snapshot()):
            raise NotNow("press Reset first")
        self._asked_at, self._cleared_at = -60.0, time.monotonic()
        self._desk.submit(c.Reset(confirm=True))

    def _asking(self, snapshot: Snapshot) -> bool:
        """Whether somebody was asked a moment ago if it is safe."""
        return snapshot.status.state == "estop" and time.monotonic() - self._asked_at < ASK_S

    def update(self, snapshot: Snapshot) -> None:
        state, asking = snapshot.status.state, self._asking(snapshot)
        self._mode.update(snapshot)
        lines = f"<div>{safe(ASK if asking else self._reason(snapshot))}</div>"
        if snapshot.progress and snapshot.status.message and not following(snapshot) and not asking:
            lines += f'<div class="dim">{safe(snapshot.progress)}</div>'
        self._status.show(
            f'<div class="vita" id="vita-run"><div class="row">{_chip(snapshot)}<span class="grow"></span>'
            f'{_error(snapshot)}<label class="link" for="{self._switch._impl.uuid}" '
            f'title="Cameras or 3D world (V)">⇄ 3D</label></div>{lines}{self._evidence(snapshot)}</div>'
        )
        now = time.monotonic()
        if now - self._rates_at >= RATES_PERIOD_S:
            self._rates_at = now
            self._rates.show(rates(snapshot, self._pictures_hz()))
        label = START_LABELS.get(state, "Start")
        if snapshot.status.reason == "controller_stopped":
            label = START_LABELS["offline"]  # Nobody would answer an acknowledgement.
        if self._start.label != label:
            self._start.label = label
        task = following(snapshot) or bool(snapshot.scenario.constraint)
        ready = state in START_LABELS or (task and state not in MOVING_STATES)
        if self._start.disabled == ready:
            self._start.disabled = not ready
        if self._yes.visible != asking:
            self._yes.visible = asking

    def _evidence(self, snapshot: Snapshot) -> str:
        """Where the last ten seconds before a fault are, while the fault lasts."""
        if not snapshot.evidence or snapshot.status.state not in LEAVES_EVIDENCE:
            return ""
        name = safe(Path(snapshot.evidence).name)
        return (
            f'<div class="evidence" title="Open it with: vita replay {safe(snapshot.evidence)}">'
            f'<span class="grow">Evidence: {name}</span>'
            f'<label class="link" for="{self._fetch._impl.uuid}">Download</label></div>'
        )

    def _do_fetch(self, event: Any) -> None:
        name, content = packed(Path(self._desk.snapshot().evidence))
        event.client.send_file_download(f"{name}.zip", content, save_immediately=True)
        self._desk.tell(event.client, "info", f"Unpack {name}.zip and open it with: vita replay {name}.npz")

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


def packed(evidence: Path) -> tuple[str, bytes]:
    """Name and ZIP archive of the files of a recording, of which `evidence` is one. Raises `BadInput`."""
    archive = io.BytesIO()
    try:
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as pack:
            for path in sorted(evidence.parent.glob(f"{glob.escape(evidence.stem)}.*")):
                pack.write(path, path.name)
    except OSError as error:
        raise BadInput(f"cannot be read: {error.strerror or error}", evidence.name) from None
    if not pack.namelist():
        raise BadInput("is not there any more; only the newest recordings are kept", evidence.name)
    return evidence.stem, archive.getvalue()


def _chip(snapshot: Snapshot) -> str:
    state = snapshot.status.state
    text, color = DEGRADED if snapshot.status.degraded else CHIP.get(state, (state, RED))
    if following(snapshot):
        text, color = impedance_words.chip(snapshot) or CHIP.get(state, (state, RED))
    return f'<span class="chip" style="background:{hexed(color)}">{safe(text)}</span>'


def _error(snapshot: Snapshot) -> str:
    figure = ""
    if following(snapshot):
        figure = impedance_words.errors(snapshot.impedance)
    elif snapshot.scenario.constraint:
        figure = pixels(snapshot.error.norm)
    return f'<span class="num dim">error <b class="ink">{figure}</b></span>' if figure else ""
