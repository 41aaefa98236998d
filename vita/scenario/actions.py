"""The script's actions and their arguments, as the file may give them."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from vita.errors import BadInput, UnknownName
from vita.impedance.config import ImpedanceConfig
from vita.scenario.schema import ScriptSpec, Vector3
from vita.scenario.typed import check_keys, convert, hints_of, join, shown
from vita.servo.config import Limits, ServoConfig


@dataclass(frozen=True)
class Action:
    """What an action takes."""

    arguments: Mapping[str, Any]
    """Argument name to type."""
    required: tuple[str, ...] = ()
    one_of: tuple[str, ...] = ()
    """At least one of these must be there."""
    choices: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Argument name to the words that it may be."""


PATHS = ("circle", "line", "wave")
"""Ways on which an object can be carried; see `vita.sim.motions`."""


ACTIONS: dict[str, Action] = {
    "start": Action({}),
    "stop": Action({}),
    "set": Action({"field": str, "value": object}, ("field", "value")),
    "move_camera": Action(
        {"camera": str, "look_from": Vector3, "look_at": Vector3, "turn_deg": float},
        ("camera",),
        ("look_from", "look_at", "turn_deg"),
    ),
    "freeze_camera": Action({"camera": str, "for_s": float}, ("camera",)),
    "unfreeze_camera": Action({"camera": str}, ("camera",)),
    "black_camera": Action({"camera": str, "for_s": float}, ("camera",)),
    "cover": Action(
        {"camera": str, "at": tuple[float, float], "size_px": float, "for_s": float}, ("camera", "at")
    ),
    "uncover": Action({"camera": str}, ("camera",)),
    "lose_tracker": Action({"tracker": str, "for_s": float}, ("tracker",)),
    "push_robot": Action({"dq_deg": tuple[float, ...]}, ("dq_deg",)),
    "lock_joint": Action({"joint": int}, ("joint",)),
    "unlock_joints": Action({}),
    "drag_target": Action(
        {"object": str, "xyz": Vector3, "rpy_deg": Vector3, "over_s": float}, ("object",), ("xyz", "rpy_deg")
    ),
    "carry": Action(
        {"object": str, "path": str, "radius_m": float, "length_m": float, "speed_m_s": float,
         "turn_deg_s": float, "for_s": float},
        ("object", "path"),
        choices={"path": PATHS},
    ),
}
_SETTINGS = {"servo": ServoConfig, "limits": Limits, "impedance": ImpedanceConfig}


def checked_action(entry: ScriptSpec, path: str) -> ScriptSpec:
    """The entry with its arguments in their types; raises `BadInput` with the culprit's path."""
    if entry.do not in ACTIONS:
        raise UnknownName("action", entry.do[:64], ACTIONS, join(path, "do"))
    action = ACTIONS[entry.do]
    given = {key: value for key, value in entry.arguments.items() if value is not None}
    if given and not action.arguments:
        culprit = next(iter(given))
        raise BadInput(f"{entry.do!r} takes no arguments", join(path, culprit))
    check_keys(given, tuple(action.arguments), path, f"argument of {entry.do!r}")
    for name in action.required:
        if name not in given:
            raise BadInput(f"{entry.do!r} needs the key {name!r}", path)
    if action.one_of and not any(name in given for name in action.one_of):
        raise BadInput(f"{entry.do!r} needs one of {', '.join(action.one_of)}", path)
    if entry.do == "set":
        field, value = setting_of(given["field"], given["value"], path)
        return dataclasses.replace(entry, arguments={"field": field, "value": value})
    typed = {name: convert(action.arguments[name], value, join(path, name)) for name, value in given.items()}
    for name, words in action.choices.items():
        if name in typed and typed[name] not in words:
            raise UnknownName(name, typed[name][:64], words, join(path, name))
    return dataclasses.replace(entry, arguments=typed)


def setting_of(field: object, value: object, path: str) -> tuple[str, Any]:
    """A setting's full name (`servo.gain`) and its checked value. A bare name is found in any table."""
    names = {f"{table}.{name}": (cls, name) for table, cls in _SETTINGS.items() for name in hints_of(cls)}
    del names["limits.joint"]  # a list of tables has no place in a script
    if not isinstance(field, str):
        raise BadInput(f"expected text in quotes, got {shown(field)}", join(path, "field"))
    full = next((f"{t}.{field}" for t in _SETTINGS if f"{t}.{field}" in names), field)
    if full not in names:
        raise UnknownName("setting", field[:64], _near(field, names), join(path, "field"))
    cls, name = names[full]
    typed = convert(hints_of(cls)[name], value, join(path, "value"))
    try:
        cls(**{name: typed})
    except BadInput as error:
        raise BadInput(str(error), join(path, "value")) from None
    return full, typed


def _near(field: str, names: Iterable[str]) -> list[str]:
    """The settings of the table that was meant: the one that is named, or that of the closest setting."""
    table = field.partition(".")[0]
    if table not in _SETTINGS:
        full = {name.partition(".")[2]: name for name in names}
        close = difflib.get_close_matches(field, [*names, *full], n=1)
        table = full.get(close[0], close[0]).partition(".")[0] if close else ""
    return [name for name in names if name.startswith(f"{table}." if table else "")]
