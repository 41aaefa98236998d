"""Which state follows which: one table of what happens and where that leads.

Every event has a cell for every state. A cell is where the event leads, or the sentence with which it is
refused, which names the next step. The engine looks here before it does anything, so that no handler has to
know the rules:

- Only `start` leads to motion.
- `stop`, `estop` and `robot_lost` lead out of motion from every state, and change nothing the second time.
- A fault is left by `acknowledge` and an emergency stop by `reset`, both for idle: neither moves the arm.

An emergency stop lies above everything, and `offline` above the states of the servo: a fault that lay
beneath is there again when the robot is back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from vita import commands as cmd
from vita.errors import NotNow
from vita.types import MOVING_STATES, State

STATES: Final[tuple[State, ...]] = (
    "offline", "idle", "learning", "servoing", "hold", "done", "fault", "estop",
)  # fmt: skip

Cell = tuple[State, ...] | str
"""The states to which an event may lead, the usual one first; or why it is refused."""

RESTART = "the simulation is not there: press Restart first"
ACKNOWLEDGE = "acknowledge the fault first; then press Start again"
ACKNOWLEDGE_FIRST = "acknowledge the fault first; then try again"
RESET = "the emergency stop is in force: press Reset and confirm, then Start"
RESET_FIRST = "the emergency stop is in force: press Reset and confirm, then try again"
NO_ESTOP = "no emergency stop is in force"
STAYS = None
"""Short for: the state stays as it is."""


def _row(*cells: Cell | State | None) -> dict[State, Cell]:
    """One cell for each of `STATES`, in their order; a single state's name stands for the tuple of it."""
    row: dict[State, Cell] = {}
    for state, cell in zip(STATES, cells, strict=True):
        row[state] = (state,) if cell is None else (cell,) if cell in STATES else cell  # type: ignore[assignment]
    return row


def _moving(refusal: str) -> tuple[str, str]:
    """An event that is refused in both moving states."""
    return refusal, refusal


_GO: Cell = ("learning", "servoing")
"""To servoing at once where nothing needs to be learned."""
_TO_HOLD: tuple[State, State] = ("hold", "hold")

TABLE: Mapping[str, Mapping[State, Cell]] = {
    # What people ask for.          offline, idle, learning, servoing, hold, done, fault, estop
    "start": _row(RESTART, _GO, STAYS, STAYS, _GO, _GO, ACKNOWLEDGE, RESET),
    "stop": _row(STAYS, STAYS, *_TO_HOLD, STAYS, STAYS, STAYS, STAYS),
    "estop": _row(*["estop"] * 8),  # type: ignore[list-item]
    "acknowledge": _row(
        RESTART, STAYS, *_moving("there is nothing to acknowledge: the arm moves"), "idle", "idle", "idle",
        RESET,
    ),
    "reset": _row(*[NO_ESTOP] * 7, ("idle", "offline")),
    "reset unconfirmed": _row(*[NO_ESTOP] * 7, "say that it is safe (confirm), then Reset"),
    "edit": _row(
        RESTART, STAYS, *_moving("stop the arm first; a task cannot be edited while it moves"), "idle",
        "idle", STAYS, STAYS,
    ),
    "load": _row(
        "idle", STAYS, *_moving("stop the arm first; then open the task"), "idle", "idle", ACKNOWLEDGE_FIRST,
        RESET_FIRST,
    ),
    "reset_arm": _row(
        "idle", STAYS, *_moving("stop the arm first"), "idle", "idle", ACKNOWLEDGE_FIRST, RESET_FIRST
    ),
    "mode": _row(
        RESTART, STAYS, *_moving("stop the arm first; the mode cannot be changed while it moves"), "idle",
        "idle", ACKNOWLEDGE_FIRST, RESET_FIRST,
    ),
    "setting": _row(*[STAYS] * 8),
    "limits": _row(RESTART, *[STAYS] * 7),
    "perform": _row(RESTART, *[STAYS] * 7),
    "inject": _row(RESTART, *[STAYS] * 7),
    "mend": _row(*[STAYS] * 8),
    # What happens.
    "driver_left": _row(STAYS, STAYS, *_TO_HOLD, STAYS, STAYS, STAYS, STAYS),
    "robot_lost": _row(*["offline"] * 7, STAYS),  # type: ignore[list-item]
    "robot_back": _row(("hold", "fault"), *[STAYS] * 7),
    "failed": _row(STAYS, *["fault"] * 6, STAYS),  # type: ignore[list-item]
    "held": _row(STAYS, STAYS, *_TO_HOLD, *[STAYS] * 4),
    "reached": _row(STAYS, STAYS, "done", "done", *[STAYS] * 4),
    "learned": _row(STAYS, STAYS, "servoing", *[STAYS] * 5),
    "unlearned": _row(*[STAYS] * 3, "learning", *[STAYS] * 4),
}
"""Event to state to cell. `load` and `reset_arm` lead out of offline by a new engine (`vita.runner`)."""

EVENTS: Final[tuple[str, ...]] = tuple(TABLE)

_EDITS = (
    cmd.AddTracker, cmd.MoveTracker, cmd.RenameTracker, cmd.DeleteTracker, cmd.AddConstraint,
    cmd.DeleteConstraint, cmd.SetWeight, cmd.SetPriority, cmd.ClearTask, cmd.Undo, cmd.Redo,
)  # fmt: skip
_EVENT_OF: dict[type, str] = {
    cmd.Start: "start", cmd.Halt: "stop", cmd.Acknowledge: "acknowledge", cmd.Inject: "inject",
    cmd.Mend: "mend", cmd.SetMode: "mode", cmd.SetServo: "setting", cmd.SetImpedance: "setting",
    cmd.SetLimits: "limits", cmd.SetJointLimit: "limits", cmd.ResetArm: "reset_arm", cmd.LoadTask: "load",
    cmd.Perform: "perform", **dict.fromkeys(_EDITS, "edit"),
}  # fmt: skip

CLICKS = frozenset(
    {"start", "acknowledge", "reset", "reset unconfirmed", "edit", "load", "reset_arm", "mode"}
)
"""Events that mean what they mean only in the state in which they were asked for. Settings and limits are
values, and a script's actions happen when they happen: they are never stale."""


def event_of(command: object) -> str | None:
    """What a command asks for; None when it is none."""
    if isinstance(command, cmd.Reset):
        return "reset" if command.confirm is True else "reset unconfirmed"
    return _EVENT_OF.get(type(command))


def following(event: str, state: State) -> tuple[State, ...]:
    """The states to which `event` may lead from `state`. Raises `NotNow` where it is refused."""
    cell = TABLE[event][state]
    if isinstance(cell, str):
        raise NotNow(cell)
    return cell


def permits_motion(state: State) -> bool:
    """Whether the arm may move in this state."""
    return state in MOVING_STATES
