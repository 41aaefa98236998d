"""Scenario files: TOML text to a valid `Scenario` and back, without loss.

The law is `loads(dumps(x)) == x` for every valid scenario. Files come from anywhere, so a hostile
one must be refused quickly, with its name and a line or a path.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import tomllib
from pathlib import Path
from typing import Any

from vita.errors import BadInput
from vita.scenario.emit import document
from vita.scenario.schema import Scenario
from vita.scenario.typed import plain
from vita.scenario.validate import from_plain, validate

MAX_BYTES = 1_000_000
_DEEP_KEY = re.compile(r"""^[ \t]*\[{0,2}[ \t]*(?:[\w"'-]+[ \t]*\.[ \t]*){16}""", re.MULTILINE)
"""Dotted keys deeper than any scenario's: their cost in the parser grows with their square."""


def load(path_or_name: str | os.PathLike[str]) -> Scenario:
    """The scenario of a file, or of a shipped one by its name."""
    from vita.scenario.library import find

    path = find(path_or_name)
    return _scenario(_read(path), str(path), path.parent)


def loads(text: str, source: str = "<text>") -> Scenario:
    """The scenario of a TOML text; `source` names it in messages."""
    return _scenario(text, source)


def _scenario(text: str, source: str, folder: Path | None = None) -> Scenario:
    try:
        table = parse(text)
        scene = table.get("scene")
        if folder is not None and isinstance(scene, dict) and isinstance(scene.get("robot"), str):
            scene["robot"] = _robot_beside(scene["robot"], folder)
        return from_plain(table)
    except BadInput as error:
        error.args = (f"{source}: {error}",)  # its `path` keeps pointing into the file
        raise


def _robot_beside(robot: str, folder: Path) -> str:
    """A URDF is named relative to the file; in memory it must not depend on where one stands."""
    if not robot.lower().endswith((".urdf", ".xml")) or "\0" in robot or len(robot) > 1000:
        return robot
    beside = folder / robot
    return str(beside.resolve()) if beside.is_file() else robot


def save(scenario: Scenario, path: str | os.PathLike[str]) -> None:
    """Write a scenario file in one stroke: a reader sees the old file or the new one, never a part."""
    data = dumps(scenario).encode("utf-8")
    target = Path(path)
    if target.is_symlink():  # replace what the link points at, not the link
        target = target.resolve()
    temporary = target.with_name(f".{target.name[:64]}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise BadInput(f"cannot write the file: {error.strerror or error}", str(path)) from None


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
        raise BadInput(f"larger than {MAX_BYTES // 1_000_000} MB, which no scenario file is")
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
        raise BadInput(f"a value cannot be read{_long_number(text)}") from None


def _long_number(text: str) -> str:
    """Where the number of a thousand digits stands that Python refuses to read."""
    match = re.search(r"[0-9_]{1000,}", text)
    line = text.count("\n", 0, match.start()) + 1 if match else 0
    return f": line {line} holds a number of too many digits" if match else ""


def _read(path: Path) -> str:
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise BadInput(f"cannot read the file: {error.strerror or error}", str(path)) from None
    if len(data) > MAX_BYTES:
        raise BadInput(f"larger than {MAX_BYTES // 1_000_000} MB, which no scenario file is", str(path))
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise BadInput("line 1: the file is UTF-16; save it as UTF-8", str(path))
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise BadInput(f"line {line}: not a text file in UTF-8", str(path)) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise BadInput(f"line {line}: holds a zero byte, so it is not a text file", str(path))
    return text
