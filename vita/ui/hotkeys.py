"""Keys and the command palette (Ctrl+K). W A S D Q E belong to viser's camera; the arrows are taken from it
(`vita.ui.pointer`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from vita import commands as c
from vita.ui.compose import SELECT, TRACKER
from vita.ui.permits import Guard
from vita.ui.words import KINDS

if TYPE_CHECKING:
    from vita.ui.app import App


URGENT = ("Emergency stop", "Cancel, or stop the arm")
"""They pass any flood of messages."""


def add_hotkeys(app: App) -> None:
    gui, composer, actions = app.server.gui, app.composer, app.actions

    def key(
        label: str, hotkey: Any, do: Callable[[Any], Any], modifier: Any = None, text: str = "",
        guard: Guard = app.guard,
    ) -> None:
        command = gui.add_command(label, hotkey=hotkey, modifier=modifier, description=text or None)
        command.on_trigger(guard(do))
        if label in URGENT:
            app.door.always(command)

    # These three check for themselves: stopping is everybody's.
    key("Start or stop", "space", actions.toggle, guard=app.anyone)
    key("Emergency stop", "space", lambda event: app.run.estop(), "shift", guard=app.anyone)
    key("Cancel, or stop the arm", "escape", actions.escape, guard=app.anyone)
    key("Undo", "Z", lambda event: actions.submit(c.Undo()), "cmd/ctrl")
    key("Redo", "Y", lambda event: actions.submit(c.Redo()), "cmd/ctrl")
    key("Delete the selected tracker", "delete", actions.delete)
    key("Delete the selected tracker (Backspace)", "backspace", actions.delete)
    key("Fit the views", "F", actions.fit, guard=app.anyone)
    key("Cameras or 3D world", "V", actions.switch, guard=app.anyone)
    for number in range(4):
        key(
            f"Camera {number + 1} large", str(number + 1), lambda event, n=number: actions.fit(event, n),
            guard=app.anyone,
        )
    for letter, kind in zip("PLMB", KINDS, strict=True):
        key(kind.label, letter, lambda event, k=kind.key: composer.arm(k), text=kind.meaning)
    key("Place trackers", "T", lambda event: composer.arm(TRACKER))
    key("Select", "X", lambda event: composer.arm(SELECT))
    for name, du, dv in (("left", -1, 0), ("right", 1, 0), ("up", 0, -1), ("down", 0, 1)):
        for step, modifier, words in ((1.0, None, "a pixel"), (0.1, "shift", "a tenth of a pixel")):
            key(
                f"Nudge {name} by {words}", f"arrow{name}",
                lambda event, u=du * step, v=dv * step: actions.nudge(event, u, v), modifier,
                text="Moves the selected tracker.",
            )
    key("Reset the simulated arm", "R", lambda event: actions.submit(c.ResetArm()), "shift")
