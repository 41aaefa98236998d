"""Scenario files: TOML text to a valid `Scenario` and back, without loss.

The law is `loads(dumps(x)) == x` for every valid scenario. Files come from anywhere, so a hostile
one must be refused quickly, with its name and a line or a path.
"""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path
from typing import Any

from vita.errors import BadInput
from vita.scenario import disk
from vita.scenario.disk import MAX_BYTES
from vita.scenario.emit import document
from vita.scenario.migrate import migrated, version_of
from vita.scenario.schema import SCHEMA, Scenario
from vita.scenario.seal import check_seal, sealed
from vita.scenario.typed import plain
from vita.scenario.validate import from_plain, newer, validate

_DEEP_KEY = re.compile(r"""^[ \t]*\[{0,2}[ \t]*(?:[\w"'-]+[ \t]*\.[ \t]*){16}""", re.MULTILINE)
"""Dotted keys deeper than any scenario's: their cost in the parser grows with their square."""

_LONG_NUMBER = re.compile(r"[0-9_]{5000}")
"""More digits than any text of a scenario may have characters."""
_MOST = {"=": 6000, "[": 5000, "{": 5000, ",": 12_000}
"""So often at most may a sign appear. Parsing takes some 10 us for each, and a hostile megabyte of them
should not keep anybody waiting."""


def load(path_or_name: str | os.PathLike[str]) -> Scenario:
    """The scenario of a file, or of a shipped one by its name."""
    from vita.scenario.library import find

    path = find(path_or_name)
    return _scenario(disk.decoded(disk.read(path), str(path)), str(path), path.parent)


def loads(text: str | bytes, source: str = "<text>") -> Scenario:
    """The scenario of a TOML text; `source` names it in messages."""
    return _scenario(disk.decoded(text, source) if isinstance(text, bytes) else text, source)


def _scenario(text: str, source: str, folder: Path | None = None) -> Scenario:
    try:
        check_seal(text)
        table = migrated(parse(text))
        scene = table.get("scene")
        if folder is not None and isinstance(scene, dict) and isinstance(scene.get("robot"), str):
            scene["robot"] = _robot_beside(scene["robot"], folder)
        follow = table.get("impedance")
        if folder is not None and isinstance(follow, dict) and isinstance(follow.get("rig_file"), str):
            follow["rig_file"] = _beside(follow["rig_file"], folder)
        return from_plain(table)
    except BadInput as error:
        error.args = (f"{source}: {error}",)  # its `path` keeps pointing into the file
        raise


def _robot_beside(robot: str, folder: Path) -> str:
    """A URDF is named relative to the file; in memory it must not depend on where one stands."""
    if not robot.lower().endswith((".urdf", ".xml")) or "\0" in robot or len(robot) > 1000:
        return robot
    return _beside(robot, folder)


def _beside(name: str, folder: Path) -> str:
    if not name or "\0" in name or len(name) > 1000:
        return name
    beside = folder / name
    return str(beside.resolve()) if beside.is_file() else name


def save(scenario: Scenario, path: str | os.PathLike[str]) -> None:
    """Write a scenario file in one stroke: a reader sees the old file or the new one, never a part.

    A file of a newer version is not written over; one of an older version is kept beside as `.bak`.
    """
    data = sealed(dumps(scenario)).encode("utf-8")
    target = Path(path)
    there = version(target)
    if there is not None and there > SCHEMA:
        raise BadInput(f"not saved: the file there was {newer(there)}, or save under another name", str(path))
    if there is not None and there < SCHEMA:
        _keep(target)
    disk.replace_file(target, data)


def version(path: Path) -> int | None:
    """The version of the format that a file is written in; None when it is no such file."""
    try:
        return version_of(parse(disk.decoded(disk.read(path), str(path)))) if path.is_file() else None
    except (BadInput, OSError):
        return None


def _keep(path: Path) -> None:
    """A copy beside the file; the first one stays, because it is the original."""
    backup = path.with_name(path.name + ".bak")
    if not backup.exists():
        disk.replace_file(backup, disk.read(path))


def dumps(scenario: Scenario) -> str:
    """The TOML text of a valid scenario; keys that hold their default are left out."""
    table: dict[str, Any] = plain(validate(scenario))
    first = {key: table.pop(key) for key in ("schema", "title", "description", "seed") if key in table}
    return document(first | table)


def parse(text: str) -> dict[str, Any]:
    """TOML text to plain tables. Everything that the parser cannot take is `BadInput`."""
    if text.startswith("\ufeff"):
        raise BadInput("line 1: the file starts with a byte-order mark; save it as plain UTF-8 without one")
    if len(text) > MAX_BYTES:
        raise BadInput(f"larger than {MAX_BYTES // 1000} kB, which no scenario file is")
    for sign, most in _MOST.items():
        if text.count(sign) > most:
            raise BadInput(f"more than {most} times the sign {sign!r}, which no scenario file needs")
    if long := _LONG_NUMBER.search(text):
        line = text.count("\n", 0, long.start()) + 1
        raise BadInput(f"line {line} holds a number of too many digits")
    if deep := _DEEP_KEY.search(text):
        line = text.count("\n", 0, deep.start()) + 1
        raise BadInput(f"line {line}: the tables are nested too deeply")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"not valid TOML: {str(error)[:300]}") from None
    except RecursionError:
        raise BadInput("the lists or tables are nested too deeply") from None
    except (ValueError, OverflowError):  # Python refuses whole numbers beyond 4300 digits, some dates, ...
        match = re.search(r"[0-9_]{1000,}", text)
        line = text.count("\n", 0, match.start()) + 1 if match else 0
        why = f": line {line} holds a number of too many digits" if match else ""
        raise BadInput(f"a value cannot be read{why}") from None
