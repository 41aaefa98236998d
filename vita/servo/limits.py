"""Live changes of settings and limits: check, then a new frozen value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from vita.errors import BadInput, UnknownName
from vita.servo.config import JointLimit, Limits
from vita.servo.gate import MARGIN_RAD
from vita.types import Joint

Config = TypeVar("Config")


class JointLimitChange(Protocol):
    """What `change_joint_limit` reads; the command `SetJointLimit` has these."""

    @property
    def joint(self) -> int: ...
    @property
    def lower_deg(self) -> float | None: ...
    @property
    def upper_deg(self) -> float | None: ...
    @property
    def speed_rad_s(self) -> float | None: ...


def change_setting(config: Config, field: str, value: object, path: str) -> Config:
    """`config` with one field changed. Raises `UnknownName` or `BadInput`; checks type and range."""
    known = {f.name: f for f in fields(config)}  # type: ignore[arg-type]
    if field not in known or (field == "joint" and path == "limits"):
        raise UnknownName("setting", field, known, path)
    if "low" in known[field].metadata:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise BadInput(f"expected a number, got {value!r}", f"{path}.{field}")
        value = float(value)
    changes: dict[str, Any] = {field: value}
    return replace(config, **changes)  # type: ignore[type-var]


def change_joint_limit(limits: Limits, joints: Sequence[Joint], change: JointLimitChange) -> Limits:
    """`limits` with one joint's overrides changed; None keeps what was there."""
    index = change.joint
    if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(joints):
        raise BadInput(f"there is no joint {index!r}; choose 0 to {len(joints) - 1}", "limits.joint")
    path = f"limits.joint[{index}]"
    values = {k: getattr(change, k) for k in ("lower_deg", "upper_deg", "speed_rad_s")}
    for key, value in values.items():
        if value is not None and (isinstance(value, bool) or not np.isfinite(value)):
            raise BadInput(f"expected a finite number, got {value!r}", f"{path}.{key}")
    if values["speed_rad_s"] is not None and not 0.0 < values["speed_rad_s"] <= 10.0:
        raise BadInput(f"{values['speed_rad_s']} is outside 0 to 10 rad/s", f"{path}.speed_rad_s")
    old = next((o for o in limits.joint if o.joint == index), JointLimit(index))
    new = replace(old, **{k: float(v) for k, v in values.items() if v is not None})
    lower = joints[index].lower if new.lower_deg is None else np.deg2rad(new.lower_deg)
    upper = joints[index].upper if new.upper_deg is None else np.deg2rad(new.upper_deg)
    if not lower < upper:
        raise BadInput(
            f"the lower limit ({np.rad2deg(lower):.1f} deg) must be below the upper "
            f"({np.rad2deg(upper):.1f} deg)",
            path,
        )
    return replace(limits, joint=(*(o for o in limits.joint if o.joint != index), new))


def apply_limits(joints: Sequence[Joint], limits: Limits) -> tuple[Joint, ...]:
    """The robot's own `joints` with `limits` in force; a rig never widens one beyond them."""
    override = {o.joint: o for o in limits.joint}
    result = []
    for index, joint in enumerate(joints):
        o = override.get(index, JointLimit(index))
        result.append(
            Joint(
                joint.name,
                joint.lower if o.lower_deg is None else float(np.deg2rad(o.lower_deg)),
                joint.upper if o.upper_deg is None else float(np.deg2rad(o.upper_deg)),
                limits.speed_rad_s if o.speed_rad_s is None else o.speed_rad_s,
            )
        )
    return tuple(result)


def within_gate(joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """The joints as the servo may use them behind the gate, which stays `MARGIN_RAD` inside limits."""
    return tuple(Joint(j.name, j.lower + MARGIN_RAD, j.upper - MARGIN_RAD, j.max_speed) for j in joints)
