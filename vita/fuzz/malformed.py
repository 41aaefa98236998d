"""Frames that no page sends."""

from __future__ import annotations

import math
from typing import Any

import msgspec.msgpack

from vita.fuzz.client import CAMERA

pack = msgspec.msgpack.encode

HUGE_BYTES = 51 * 2**20
MALFORMED: dict[str, bytes | str] = {
    "text": "hello",
    "empty": b"",
    "garbage": b"\xc1\xff\x00garbage",
    "no map": pack([1, 2, 3]),
    "no type": pack({"uuid": "x"}),
    "unknown type": pack({"type": "NoSuchMessage"}),
    "what only the server says": pack({"type": "RunJavascriptMessage", "source": "alert(1)"}),
    "missing field": pack({key: value for key, value in CAMERA.items() if key != "fov"}),
    "extra field": pack({**CAMERA, "extra": 1}),
    "deep nesting": b"\x82\xa4type\xb0GuiUpdateMessage\xa7updates" + b"\x91" * 100_000,
    "wrong arity": pack({**CAMERA, "position": (1.0, 2.0)}),
    "not a number": pack({**CAMERA, "wxyz": (math.nan, 0.0, 0.0, 0.0)}),
}
"""Name to payload: bytes for a binary frame, str for a text frame. A frame of `HUGE_BYTES` is one more."""


def injections(uuid: str) -> dict[str, bytes]:
    """What would take the life out of a widget, were a page allowed to set it."""
    wanted: list[dict[str, Any]] = [
        {"removed": True}, {"update_cb": []}, {"sync_cb": None}, {"is_button": False},
        {"value": True, "props": {}}, {},
    ]  # fmt: skip
    return {
        f"set {', '.join(updates) or 'nothing'}": pack(
            {"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}
        )
        for updates in wanted
    }
