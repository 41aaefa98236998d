"""Tuning: every setting of `ServoConfig` and `Limits`, made from the fields' own words and ranges."""

from __future__ import annotations

from dataclasses import Field, fields
from typing import Any

import numpy as np

from vita import commands as c
from vita.scenario.schema import Scenario
from vita.servo.config import Limits, ServoConfig
from vita.snapshot import Snapshot
from vita.types import Joint
from vita.ui import style
from vita.ui.panels.base import Desk, Html
from vita.ui.panels.choices import Choice
from vita.ui.panels.settings import Numbers
from vita.ui.safe import number

GROUPS: dict[str, tuple[str, ...]] = {
    "Method": ("estimator", "alpha", "forgetting", "policy", "damping", "secondary"),
    "Gain": ("gain", "moving_goal"),
    "Exploration": ("explore_deg", "explore_px"),
    "Done": ("tolerance_px", "timeout_s"),
}
"""Folders of the tab; a setting that none of them names goes to the last."""
OPEN = ("Method", "Gain")
UNUSED: dict[str, tuple[str, tuple[str, ...]]] = {
    "alpha": ("estimator", ("kalman", "robust", "rls", "history")),
    "forgetting": ("estimator", ("kalman", "robust", "broyden", "thesis", "history")),
    "damping": ("policy", ("uncertainty",)),
}
"""Setting to the choice, and to those kinds of it that the setting does nothing for. It is hidden then,
and keeps its value; kinds that are new to the page show everything."""


def applies(setting: str, servo: ServoConfig) -> bool:
    """Whether a setting does anything with the kinds that are chosen."""
    choice, kinds = UNUSED.get(setting, ("", ()))
    return not choice or getattr(servo, choice) not in kinds


class ServoPanel:
    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        gui = desk.gui
        Html(gui, style.TABS_MARK)
        self._numbers = Numbers(desk)
        self._inputs = self._numbers.inputs
        self._choices: dict[str, Choice] = {}
        settings = {f.name: f for f in fields(ServoConfig) if f.metadata}
        grouped = {name for names in GROUPS.values() for name in names}
        for title, names in GROUPS.items():
            others = [n for n in settings if n not in grouped] if title == list(GROUPS)[-1] else []
            with gui.add_folder(title, expand_by_default=title in OPEN):
                for name in (*names, *others):
                    self._servo_setting(settings[name])
        with gui.add_folder("Speed", expand_by_default=False):
            for field in fields(Limits):
                self._numbers.add("limits", field, c.SetLimits)
        self._joint_folder = gui.add_folder("Joints")
        self._joint_rows: list[_JointRow] = []

    def update(self, snapshot: Snapshot) -> None:
        servo = snapshot.scenario.servo
        for field, choice in self._choices.items():
            choice.show(getattr(servo, field))
        self._numbers.show(snapshot.scenario)
        for (group, field), handle in self._inputs.items():
            shown = group != "servo" or applies(field, servo)
            if handle.visible != shown:
                handle.visible = shown
        if len(self._joint_rows) != len(snapshot.joints):
            for row in self._joint_rows:
                row.remove()
            with self._joint_folder:
                self._joint_rows = [
                    _JointRow(self._desk, index, joint) for index, joint in enumerate(snapshot.joints)
                ]
        for row, joint in zip(self._joint_rows, snapshot.joints, strict=True):
            row.update(joint, snapshot.scenario)

    def _servo_setting(self, field: Field[Any]) -> None:
        if "choices" in field.metadata:
            self._choices[field.name] = Choice(self._desk, field)
        else:
            self._numbers.add("servo", field, c.SetServo)


class _JointRow:
    """One joint: whether the servo may use it, and its limits."""

    def __init__(self, desk: Desk, index: int, joint: Joint) -> None:
        self._desk, self._index = desk, index
        gui = desk.gui
        self._folder = gui.add_folder(joint.name, expand_by_default=False)
        with self._folder:
            self._use = gui.add_checkbox("Servo uses it", True, hint="Off keeps this joint still.")
            self._range = gui.add_multi_slider(
                "Range [deg]", min=-360.0, max=360.0, step=0.5, min_range=1.0,
                initial_value=(float(np.degrees(joint.lower)), float(np.degrees(joint.upper))),
                hint="The gate keeps the joint within these.",
            )
            self._speed = gui.add_slider(
                "Speed [rad/s]", min=0.01, max=3.0, step=0.01,
                initial_value=float(np.clip(joint.max_speed, 0.01, 3.0)), hint="This joint's top speed.",
            )
        self._use.on_update(desk.guard(self._used))
        self._range.on_update(desk.guard(self._ranged))
        self._speed.on_update(desk.guard(self._sped))

    def remove(self) -> None:
        self._folder.remove()

    def update(self, joint: Joint, scenario: Scenario) -> None:
        used = scenario.servo.joints
        inside = used is None or self._index in used
        if self._use.value != inside:
            self._use.value = inside
        limits = (round(float(np.degrees(joint.lower)), 3), round(float(np.degrees(joint.upper)), 3))
        if max(abs(a - b) for a, b in zip(limits, self._range.value, strict=True)) > 0.01:
            self._range.value = limits
        speed = float(np.clip(joint.max_speed, 0.01, 3.0))
        if abs(self._speed.value - speed) > 1e-6:
            self._speed.value = speed

    def _used(self, event: Any) -> None:
        snapshot = self._desk.snapshot()
        count = len(snapshot.joints)
        used = set(snapshot.scenario.servo.joints or range(count))
        (used.add if bool(event.target.value) else used.discard)(self._index)
        if not used:
            self._use.value = True
            self._desk.tell(event.client, "warning", "The servo needs at least one joint.")
            return
        self._desk.submit(c.SetServo("joints", None if len(used) == count else tuple(sorted(used))))

    def _ranged(self, event: Any) -> None:
        low, high = (number(v, -360.0, 360.0, "range") for v in event.target.value)
        self._desk.submit(c.SetJointLimit(self._index, lower_deg=low, upper_deg=high))

    def _sped(self, event: Any) -> None:
        value = number(event.target.value, 0.01, 3.0, "speed")
        self._desk.submit(c.SetJointLimit(self._index, speed_rad_s=value))
