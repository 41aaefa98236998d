"""Settings that people change while the engine lives: checked, then in force from the next period on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from vita import commands as cmd
from vita.errors import BadInput, NotNow, UnknownName
from vita.scenario.names import MODES
from vita.servo.config import Limits
from vita.servo.limits import apply_limits, change_joint_limit, change_setting
from vita.types import Status

if TYPE_CHECKING:
    from vita.engine import Engine


def set_mode(engine: Engine, mode: str) -> None:
    """Choose what Start does. Raises `BadInput` where the scene has not got what the mode needs."""
    if mode not in MODES:
        raise UnknownName("mode", mode, MODES, "mode")
    if mode == "uvs":
        engine.following = None
        return
    from vita.following import Following  # With its eyes; the other mode does without them.

    engine.following = Following(engine.rig, engine.present())


def put_limits(engine: Engine, limits: Limits) -> None:
    """Put limits in force, in the rig and for whoever plans within them."""
    joints = apply_limits(engine.rig.robot_joints, limits)
    step, higher = engine.last_step, limits.speed_rad_s / engine.limits.speed_rad_s
    if engine.moving and step is not None and higher > 1.0:
        # The step under way is a share of the limits: it is not to become faster with them.
        engine.rig.command(replace(step, speed_scale=step.speed_scale / higher))
    engine.rig.set_limits(joints, limits.acceleration_rad_s2)
    engine.limits = limits
    if engine.following is not None:
        engine.following.take_limits()


def _set_mode(engine: Engine, command: cmd.SetMode) -> None:
    set_mode(engine, command.mode)
    for controller in {engine.controller, engine.active}:
        controller.status = Status()


def _set_impedance(engine: Engine, command: cmd.SetImpedance) -> None:
    config = change_setting(engine.impedance, command.field, command.value, "impedance")
    following = engine.following
    if following is not None:
        from vita.following import LIVE

        if command.field not in LIVE and engine.moving:
            raise NotNow(f"stop the arm first; {command.field} cannot be changed while it moves")
        following.configure(config, command.field)
    engine.impedance = config


def _set_servo(engine: Engine, command: cmd.SetServo) -> None:
    config = change_setting(engine.controller.config, command.field, command.value, "servo")
    previous, engine.controller.config = engine.controller.config, config
    try:
        engine.servoing.check_joints()
    except BadInput:
        engine.controller.config = previous
        raise
    if config.joints != previous.joints:
        if engine.controller.moving:
            engine.controller.config = previous
            raise NotNow("stop the arm first; joints cannot be chosen while it moves")
        engine.controller.forget()


def _set_limits(engine: Engine, command: cmd.SetLimits) -> None:
    put_limits(engine, change_setting(engine.limits, command.field, command.value, "limits"))


def _set_joint_limit(engine: Engine, command: cmd.SetJointLimit) -> None:
    put_limits(engine, change_joint_limit(engine.limits, engine.rig.robot_joints, command))


SETTINGS: dict[type, Callable[[Any, Any], None]] = {
    cmd.SetMode: _set_mode,
    cmd.SetImpedance: _set_impedance,
    cmd.SetServo: _set_servo,
    cmd.SetLimits: _set_limits,
    cmd.SetJointLimit: _set_joint_limit,
}
"""Command to what carries it out."""
