"""Whether a widget may take a value: its own record says so, not the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import viser

from vita.errors import BadInput
from vita.ui.safe import number
from vita.ui.wire import TEXT_MAX

SLACK = 1e-6
"""Of a range: a browser's arithmetic may end a hair beyond."""


def accept(handle: Any, value: object) -> None:
    """Raises `BadInput` for what this widget cannot hold; the sentence names it and what it takes."""
    label = str(getattr(handle, "label", "") or "this input")
    if getattr(handle, "disabled", False):
        raise BadInput("not available now", label)
    if isinstance(handle, (viser.GuiButtonHandle, viser.GuiCheckboxHandle)):
        if not isinstance(value, bool):
            raise BadInput("expected true or false", label)
    elif isinstance(handle, (viser.GuiDropdownHandle, viser.GuiButtonGroupHandle)):
        if value not in handle.options:
            raise BadInput(f"{str(value)[:40]!r} is not one of its choices", label)
    elif isinstance(handle, viser.GuiTextHandle):
        if not isinstance(value, str) or len(value) > TEXT_MAX:
            raise BadInput(f"expected a text of at most {TEXT_MAX} characters", label)
    elif isinstance(handle, (viser.GuiSliderHandle, viser.GuiNumberHandle)):
        _within(value, handle.min, handle.max, label)
    elif isinstance(handle, viser.GuiMultiSliderHandle):
        values = _several(value, len(handle.value), label)
        for item in values:
            _within(item, handle.min, handle.max, label)
        if sorted(values) != list(values):
            raise BadInput("expected its ends in order", label)
    elif isinstance(handle, (viser.GuiVector2Handle, viser.GuiVector3Handle)):
        size = len(handle.value)
        lows, highs = handle.min or (None,) * size, handle.max or (None,) * size
        for item, low, high in zip(_several(value, size, label), lows, highs, strict=True):
            _within(item, low, high, label)
    elif isinstance(handle, (viser.GuiRgbHandle, viser.GuiRgbaHandle)):
        for item in _several(value, len(handle.value), label):
            _within(item, 0, 255, label)
    else:
        raise BadInput("takes no value from a page", label)


def _within(value: object, low: float | None, high: float | None, label: str) -> None:
    low, high = (-1e9 if low is None else low), (1e9 if high is None else high)
    slack = SLACK * max(high - low, SLACK)
    if isinstance(value, float) and not math.isfinite(value):
        raise BadInput(f"expected a number from {low:g} to {high:g}", label)
    try:
        number(value, low - slack, high + slack, label)
    except BadInput:
        raise BadInput(f"{str(value)[:20]} is outside {low:g} to {high:g}", label) from None


def _several(value: object, size: int, label: str) -> Sequence[Any]:
    if not isinstance(value, list) or len(value) != size:
        raise BadInput(f"expected {size} numbers", label)
    return value
