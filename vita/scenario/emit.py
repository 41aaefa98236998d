"""A small TOML writer for people's eyes: vectors on one line, one table per thing.

The usual writers spread every vector over several lines, which makes a task file four times as
long; this one knows no more of TOML than a scenario needs.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_ESCAPES = {"\b": "\\b", "\t": "\\t", "\n": "\\n", "\f": "\\f", "\r": "\\r", '"': '\\"', "\\": "\\\\"}
_WIDTH = 100


def document(table: Mapping[str, Any]) -> str:
    """The TOML text of a plain table: its scalars first, then its tables and lists of tables."""
    lines = [f"{_key(k)} = {_value(v, k)}" for k, v in table.items() if not is_block(v)]
    for key, value in table.items():
        if not is_block(value):
            continue
        many = isinstance(value, list)
        for block in value if many else [value]:
            lines += ["", f"[[{_key(key)}]]" if many else f"[{_key(key)}]"]
            lines += [f"{_key(k)} = {_value(v, k)}" for k, v in block.items()]
    return "\n".join(lines) + "\n"


def is_block(value: Any) -> bool:
    """Whether a value is written as a table of its own, after all plain ones."""
    if isinstance(value, Mapping):
        return True
    return isinstance(value, list) and bool(value) and all(isinstance(v, Mapping) for v in value)


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _text(key)


def _text(value: str) -> str:
    out = []
    for c in value:
        if c in _ESCAPES:
            out.append(_ESCAPES[c])
        elif ord(c) < 32 or ord(c) == 127:
            out.append(f"\\u{ord(c):04x}")
        else:
            out.append(c)
    return '"' + "".join(out) + '"'


def _value(value: Any, key: str = "") -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)  # repr is the shortest text that reads back as the same number
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    items = [_value(v) for v in value]
    line = f"[{', '.join(items)}]"
    if is_block(value) and (len(items) > 1 or len(key) + len(line) > _WIDTH):
        return "[\n" + "".join(f"    {item},\n" for item in items) + "]"
    return line
