"""Plain tables (dicts, lists, numbers, text) to the frozen dataclasses of the schema, and back.

The dataclasses' type hints are the only description of the file format: this module follows
them, so that a new field in `schema.py` is read, written and checked without a line here.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

from vita.errors import BadInput, UnknownName

T = TypeVar("T")
LARGEST_WHOLE = 2**63 - 1
"""TOML's own bound on whole numbers; also keeps numbers printable."""
ALWAYS = ("schema", "scene", "robot")
"""Keys that are written even with their default: a task belongs to a robot."""


def join(path: str, key: object) -> str:
    """The path of `key` within `path`, e.g. `camera[1]` and `fov_deg` give `camera[1].fov_deg`."""
    key = str(key)
    if not key or not key.isprintable() or len(key) > 64:
        key = repr(key[:64])
    return f"{path}.{key}" if path else key


def shown(value: object) -> str:
    """A short description of a wrong value for a message, safe for values of any size."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value) if abs(value) <= LARGEST_WHOLE else "a whole number beyond 64 bits"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str):
        return repr(value if len(value) <= 60 else value[:60] + "...")
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    return f"a {type(value).__name__}"


def whole(value: object, path: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise BadInput(f"expected a whole number, got {shown(value)}", path)
    if abs(value) > LARGEST_WHOLE:
        raise BadInput("the number is too large", path)
    return value


def number(value: object, path: str) -> float:
    """A finite float; whole numbers are taken too, truth values and text are not."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise BadInput(f"expected a number, got {shown(value)}", path)
    if isinstance(value, int):
        return float(whole(value, path))
    if not math.isfinite(value):
        raise BadInput(f"{value!r} is not a finite number", path)
    return float(value) + 0.0  # -0.0 is read as 0.0, so that no angle depends on the sign of nothing


def text(value: object, path: str) -> str:
    if not isinstance(value, str):
        raise BadInput(f"expected text in quotes, got {shown(value)}", path)
    try:
        value.encode("utf-8")
    except UnicodeEncodeError:
        raise BadInput("the text holds half a surrogate pair, which no file can hold", path) from None
    return value


def truth(value: object, path: str) -> bool:
    if not isinstance(value, bool):
        raise BadInput(f"expected true or false, got {shown(value)}", path)
    return value


_SCALARS = {float: number, int: whole, str: text, bool: truth}


def convert(hint: Any, value: object, path: str) -> Any:
    """`value` as the type `hint`, or `BadInput` with the path of the culprit."""
    if hint in _SCALARS:
        return _SCALARS[hint](value, path)
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        (inner,) = (arm for arm in typing.get_args(hint) if arm is not type(None))
        return convert(inner, value, path)
    if typing.get_origin(hint) is tuple:
        return _items(typing.get_args(hint), value, path)
    if dataclasses.is_dataclass(hint):
        return build(typing.cast(type, hint), value, path)
    raise TypeError(f"{path}: the schema uses the type {hint}, which files cannot hold")


def _items(arms: tuple[Any, ...], value: object, path: str) -> tuple:
    """A tuple from a list: of any length for `tuple[X, ...]`, of the one length otherwise."""
    many = len(arms) == 2 and arms[1] is Ellipsis
    if not isinstance(value, (list, tuple)):
        wanted = "a list" if many else f"a list of {len(arms)}"
        raise BadInput(f"expected {wanted}, got {shown(value)}", path)
    if not many and len(value) != len(arms):
        raise BadInput(f"expected {len(arms)} values, got {len(value)}", path)
    hints: Sequence[Any] = [arms[0]] * len(value) if many else arms
    return tuple(convert(h, v, f"{path}[{i}]") for i, (h, v) in enumerate(zip(hints, value, strict=True)))


@cache
def hints_of(cls: type) -> dict[str, Any]:
    """Field name to resolved type, in the order of the file's keys."""
    hints = typing.get_type_hints(cls)
    return {f.name: hints[f.name] for f in dataclasses.fields(cls)}


def check_keys(table: Mapping[str, object], choices: Sequence[str], path: str, what: str = "key") -> None:
    """Raise `UnknownName` on the first key that is not among `choices`."""
    for key in table:
        if key not in choices:
            raise UnknownName(what, str(key)[:64], choices, join(path, key))


def build(cls: type[T], table: object, path: str = "") -> T:
    """A `cls` from a table. Unknown, missing and mistyped keys raise `BadInput` with their path."""
    if not isinstance(table, Mapping):
        raise BadInput(f"expected a table, got {shown(table)}", path)
    hints = hints_of(cls)
    rest = _rest(cls)
    own = [name for name in hints if name != rest]
    extra = {key: value for key, value in table.items() if rest and key not in own and _taken(cls, rest, key)}
    table = {key: value for key, value in table.items() if key not in extra}
    check_keys(table, own, path)
    values: dict[str, Any] = {}
    for f in dataclasses.fields(typing.cast(Any, cls)):
        if f.name in table:
            values[f.name] = convert(hints[f.name], table[f.name], join(path, f.name))
        elif f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING:
            raise BadInput(f"the key {f.name!r} is missing", path)
    if rest:
        values[rest] = extra
    return cls(**values)


def _rest(cls: type) -> str:
    """The field that takes the keys which are no fields themselves, if there is one: a script entry's
    belong to its action, a scenario's `x-` keys to other programs."""
    return next((f.name for f in dataclasses.fields(typing.cast(Any, cls)) if "prefix" in f.metadata), "")


def _taken(cls: type, rest: str, key: str) -> bool:
    """Whether the field `rest` takes this key."""
    (prefix,) = (f.metadata["prefix"] for f in dataclasses.fields(typing.cast(Any, cls)) if f.name == rest)
    return str(key).startswith(prefix)


def plain(value: object, path: str = "") -> Any:
    """The reverse of `build`: dicts, lists and scalars, without the keys that hold their default."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        table: dict[str, Any] = {}
        for f in dataclasses.fields(value):
            item = getattr(value, f.name)
            if "prefix" in f.metadata:
                table.update({k: plain(v, join(path, k)) for k, v in item.items()})
            elif item is not None and (f.name in ALWAYS or not _is_default(f, item)):
                table[f.name] = plain(item, join(path, f.name))
        return table
    if isinstance(value, Mapping):
        return {str(k): plain(v, join(path, k)) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v, f"{path}[{i}]") for i, v in enumerate(value)]
    if hasattr(value, "tolist"):  # numpy numbers and arrays come from people's scripts
        return typing.cast(Any, value).tolist()
    return value


def _is_default(f: dataclasses.Field, item: object) -> bool:
    if f.default is dataclasses.MISSING:
        return False
    try:
        return type(item) is type(f.default) and bool(item == f.default)
    except (TypeError, ValueError):  # numpy arrays compare elementwise
        return False
