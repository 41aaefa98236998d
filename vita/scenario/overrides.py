"""`--set servo.gain=0.3`: change single values of a scenario, checked like a file's."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from vita.errors import BadInput, UnknownName
from vita.scenario.schema import Scenario
from vita.scenario.toml_io import parse
from vita.scenario.typed import plain, shown
from vita.scenario.validate import from_plain

_STEP = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)((?:\[[^\[\]]*\])*)")


def override(scenario: Scenario, assignments: Sequence[str]) -> Scenario:
    """The scenario with `KEY=VALUE` assignments applied, e.g. `camera[0].fov_deg=60`.

    Keys are the file's; things in a list go by position or by name (`tracker[tip_l].size_px`).
    Values are TOML; text needs no quotes and a list no brackets. All are applied before the
    result is checked, so that values which only fit together can be set together.
    """
    table = plain(scenario)
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not equals or not key.strip():
            raise BadInput(f"expected KEY=VALUE such as servo.gain=0.3, got {shown(assignment)}", "--set")
        _put(table, key.strip(), _value(value.strip()))
    try:
        return from_plain(table)
    except BadInput as error:
        if assignments:
            error.args = (f"with --set {' --set '.join(a[:80] for a in assignments)}: {error}",)
        raise


def _value(given: str) -> Any:
    """The value of a text as TOML has it, else as a list without brackets, else as bare text."""
    for text in (given, f"[{given}]" if "," in given else ""):
        if text and "\n" not in text:
            try:
                return parse(f"value = {text}")["value"]
            except BadInput:
                continue
    return given


def _put(table: dict[str, Any], key: str, value: Any) -> None:
    """Set `key` in the plain table. Tables on the way are made; things in lists must exist."""
    at: Any = table
    steps = _split(key)
    for i, step in enumerate(steps[:-1]):
        path = _path(steps[: i + 1])
        if isinstance(at, list):
            at = at[_position(at, step, path)]
        elif isinstance(at, dict):
            at = at.setdefault(step, [] if i + 1 < len(steps) and steps[i + 1].startswith("[") else {})
        else:
            raise BadInput(f"{_path(steps[:i])} has no parts", key)
    if isinstance(at, list):
        at[_position(at, steps[-1], key)] = value
    elif isinstance(at, dict) and not steps[-1].startswith("["):
        at[steps[-1]] = value
    else:
        raise BadInput(f"{_path(steps[:-1])} has no such part", key)


def _split(key: str) -> list[str]:
    """`camera[0].size[1]` as `camera`, `[0]`, `size`, `[1]`."""
    steps: list[str] = []
    for part in re.split(r"\.(?![^\[]*\])", key):  # a dot inside brackets belongs to a name
        match = _STEP.fullmatch(part)
        if match is None:
            raise BadInput(f"{shown(key)} is not a key such as servo.gain or camera[0].fov_deg", "--set")
        steps.append(match[1])
        steps += re.findall(r"\[[^\[\]]*\]", match[2])
    return steps


def _path(steps: Sequence[str]) -> str:
    return ".".join(steps).replace(".[", "[")


def _position(items: list[Any], step: str, path: str) -> int:
    """Where in a list `[2]` or `[name]` points."""
    if not step.startswith("["):
        raise BadInput(f"say which one, e.g. {path.rsplit('.', 1)[0]}[0].{step}", path)
    wanted = step[1:-1].strip()
    names = [item.get("name") for item in items if isinstance(item, dict)]
    if wanted in names:
        return names.index(wanted)
    if wanted.isascii() and wanted.isdigit() and len(wanted) < 6 and int(wanted) < len(items):
        return int(wanted)
    choices = [str(name) for name in names if name] or [str(i) for i in range(len(items))]
    raise UnknownName("entry", wanted[:80], choices, path)
