"""What people ask of the engine, carried out: a function for each command.

When something may be asked is in `vita.states`; the engine has looked there before it comes here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from vita import commands as cmd
from vita.errors import BadInput
from vita.faults import inject
from vita.scenario.schema import Scenario
from vita.tuning import SETTINGS, put_limits, set_mode
from vita.types import Status

if TYPE_CHECKING:
    from vita.engine import Engine


def _start(engine: Engine, command: cmd.Start) -> None:
    engine.cameras.begin()
    engine.mode.start(command)


def _acknowledge(engine: Engine, _: cmd.Acknowledge) -> None:
    if engine.status.state == "fault":
        engine.active.forget()
    engine.active.status = Status()


def _edit(engine: Engine, command: Any) -> None:
    engine.editor.apply(command, engine.observation)
    for controller in (engine.controller, engine.active):
        if controller.status.state in ("done", "hold"):
            controller.status = Status()


def _load(engine: Engine, command: cmd.LoadTask) -> None:
    scenario = command.scenario
    if not engine.editor.same_scene(scenario):
        raise BadInput("this task needs another scene or other cameras; open it with a new rig")
    _back_to_start(engine, scenario)
    engine.controller.config, engine.impedance = scenario.servo, scenario.impedance
    put_limits(engine, scenario.limits)
    set_mode(engine, scenario.mode)


def _back_to_start(engine: Engine, scenario: Scenario) -> None:
    """Arm at the scenario's start pose and every tracker placed afresh; one undoable edit."""
    engine.rig.hard_reset(engine.editor.start_pose(scenario))
    engine.observation = engine.rig.observe()
    engine.editor.load(scenario, engine.observation)
    for controller in {engine.controller, engine.active}:
        controller.forget()
        controller.status = Status()


def _perform(engine: Engine, command: cmd.Perform) -> None:
    arguments = dict(command.arguments)
    if command.action == "lose_tracker":
        engine.editor.task.slot(str(arguments.get("tracker")))
        for_s = float(arguments.get("for_s", np.inf))  # type: ignore[arg-type]
        engine.lost_until[str(arguments["tracker"])] = engine.observation.stamp + for_s
    else:
        engine.rig.perform(command.action, **arguments)


EDITS = (
    cmd.AddTracker, cmd.MoveTracker, cmd.RenameTracker, cmd.DeleteTracker, cmd.AddConstraint,
    cmd.DeleteConstraint, cmd.SetWeight, cmd.SetPriority, cmd.ClearTask, cmd.Undo, cmd.Redo,
)  # fmt: skip
ORDERS: dict[type, Callable[[Any, Any], None]] = {
    cmd.Start: _start,
    cmd.Halt: lambda engine, _: engine.stop(),
    cmd.Acknowledge: _acknowledge,
    cmd.Reset: lambda engine, _: engine.lift_estop(),
    cmd.Inject: lambda engine, command: inject(command.fault, engine.site),
    cmd.Mend: lambda engine, _: engine.tap.mend(),
    **SETTINGS,
    cmd.ResetArm: lambda engine, _: _back_to_start(engine, engine.editor.to_save()),
    cmd.LoadTask: _load,
    cmd.Perform: _perform,
    **dict.fromkeys(EDITS, _edit),
}
"""Command to what carries it out."""
