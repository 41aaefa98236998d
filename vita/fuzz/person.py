"""A person at the page, as far as a script can be one: presses what its labels say, and reads the state."""

from __future__ import annotations

import re
from collections.abc import Callable

from vita.errors import UnknownName
from vita.fuzz.client import Client, Widget

_CHIP = re.compile(r'id="vita-run">.*?class="chip"[^>]*>([^<]*)<', re.DOTALL)
_TRY = re.compile(
    r'class="num dim id">(\w+)</span>(?:(?!class="num dim id").)*?for="([^"]+)" title="Make it', re.DOTALL
)
_RATES = re.compile(r"control <b>(\d+) Hz")
STATES = {
    "Offline": "offline", "Ready": "idle", "Learning": "learning", "Moving": "servoing",
    "Moving at half speed": "servoing", "Stopped": "hold", "Done": "done", "Fault": "fault",
    "Emergency stop": "estop",
}  # fmt: skip
"""Word on the page's chip to the state that it stands for."""
GROUP = "Kinds of faults"
START, YES, SCENE = "Start (Space)", "Ends the emergency stop", "Put the simulated arm"
"""How the hints of the buttons begin that change their labels, or share them."""


class Person:
    """Somebody with a page. `storage` is what the browser keeps, to come back as the same person."""

    def __init__(self, address: tuple[str, int], storage: dict[str, str] | None = None) -> None:
        self.storage = {} if storage is None else storage
        self.page = Client(address, storage=self.storage, timeout_s=20.0)

    def close(self) -> None:
        self.page.close()

    # What the page says.

    @property
    def state(self) -> str:
        """The state on the chip; empty before the page has shown one."""
        match = _CHIP.search(self._raw())
        return STATES.get(match[1], match[1]) if match else ""

    @property
    def loop_hz(self) -> float:
        """How often the servo works, as the page says it; 0 when it does not."""
        match = _RATES.search(self._raw())
        return float(match[1]) if match else 0.0

    @property
    def asked(self) -> bool:
        """Whether the page asks if a Reset is safe."""
        return bool(self._hinted(YES).props.get("visible", True))

    @property
    def faults(self) -> dict[str, str]:
        """Row to button of the faults that can be tried now."""
        return dict(_TRY.findall(self._raw()))

    def wait(self, condition: Callable[[], object], what: str, timeout_s: float = 20.0) -> None:
        self.page.wait(condition, f"{what} (the page says {self.state!r})", timeout_s)

    def _raw(self) -> str:
        widgets = list(self.page.widgets.values())
        return "\n".join(str(w.props.get("content", "")) for w in widgets if w.kind == "GuiHtmlMessage")

    # What the person does.

    def start(self) -> None:
        """Start, Acknowledge, Reset or Restart: one button, as its label says."""
        self._press(START)

    def reset_scene(self) -> None:
        self._press(SCENE)

    def say_yes(self) -> None:
        """Answer the question of an emergency stop's Reset."""
        self._press(YES)

    def take_over(self) -> None:
        """Drive, where another page did."""
        for widget in list(self.page.widgets.values()):
            if widget.label == "Take over" and widget.props.get("visible", True):
                self.page.send_value(widget.uuid, True)

    def show_faults(self, group: int) -> None:
        """Turn to a group of faults by its number; its buttons appear a moment later."""
        widget = self._hinted(GROUP)
        options = list(widget.props["options"])
        self.page.send_value(widget.uuid, options[group % len(options)])

    def try_fault(self, row: str) -> bool:
        """Press the Try of a row; False when the page does not show it now."""
        button = self.faults.get(row)
        if button is not None:
            self.page.send_value(button, True)
        return button is not None

    def _press(self, hint: str) -> None:
        self.page.send_value(self._hinted(hint).uuid, True)

    def _hinted(self, hint: str) -> Widget:
        for widget in list(self.page.widgets.values()):
            if str(widget.props.get("hint") or "").startswith(hint):
                return widget
        raise UnknownName("widget with the hint", hint, ())
