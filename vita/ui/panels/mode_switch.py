"""The switch between the two modes."""

from __future__ import annotations

from vita import commands as c
from vita.errors import NotNow
from vita.snapshot import Snapshot
from vita.types import MOVING_STATES
from vita.ui import style
from vita.ui.mode import ABOUT, LABELS, WAIT
from vita.ui.panels.base import Desk, Html
from vita.ui.words import safe


class ModeSwitch:
    """Two halves of one pill; the one in force is filled.

    viser's own button group has no pressed state, so that the halves are labels of hidden buttons.
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._pill = Html(desk.gui)
        self._buttons = {mode: desk.gui.add_button(label) for mode, label in LABELS.items()}
        for mode, button in self._buttons.items():
            button.on_click(desk.guard(lambda event, mode=mode: self.choose(mode)))
            command = desk.gui.add_command(f"Mode: {LABELS[mode]}", description=ABOUT[mode])
            command.on_trigger(desk.guard(lambda event, mode=mode: self.choose(mode)))

    def css(self) -> str:
        return style.hidden(self._buttons.values())

    def choose(self, mode: str) -> None:
        """Ask for a mode; the one in force is left alone."""
        snapshot = self._desk.snapshot()
        if mode == snapshot.scenario.mode:
            return
        if snapshot.status.state in MOVING_STATES:
            raise NotNow(WAIT)
        self._desk.composer.put_away()
        self._desk.submit(c.SetMode(mode))

    def update(self, snapshot: Snapshot) -> None:
        moving, now = snapshot.status.state in MOVING_STATES, snapshot.scenario.mode
        halves = ""
        for mode, button in self._buttons.items():
            if button.disabled != moving:
                button.disabled = moving
            on = " on" if mode == now else ""
            hint = WAIT if moving and not on else ABOUT[mode]
            halves += (
                f'<label class="half{on}" for="{button._impl.uuid}" title="{safe(hint)}">'
                f"{safe(LABELS[mode])}</label>"
            )
        off = " off" if moving else ""
        self._pill.show(f'<div class="vita mode{off}" id="vita-mode">{halves}</div>')
