"""Inputs for settings with a range, made from the fields' own words and ranges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import Field
from typing import Any

import numpy as np

from vita.scenario.schema import Scenario
from vita.ui.panels.base import Desk
from vita.ui.safe import number


class Numbers:
    """Sliders, and number fields where a range is too wide for one, that follow what is in force."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self.inputs: dict[tuple[str, str], Any] = {}
        """(part of the scenario, field) to its input."""

    def add(
        self, group: str, field: Field[Any], command: Callable[[str, float], object],
        widest: float = 100.0,
    ) -> None:
        """An input for a field of `scenario.GROUP`; a change submits `command(field, value)`.

        A range that goes beyond `widest` gets a number field.
        """
        meta = field.metadata
        if "low" not in meta:
            return
        unit = f" [{meta['unit']}]" if meta["unit"] else ""
        span = f"{meta['low']:g} to {meta['high']:g} {meta['unit']}".strip()
        hint = f"{meta['doc']} {span}."
        low, high, start = float(meta["low"]), float(meta["high"]), float(field.default)  # type: ignore
        label = meta["label"] + unit
        if high / max(low, 1e-3) > 5000 or high > widest:
            handle = self._desk.gui.add_number(
                label, start, min=low, max=high, step=_step(start or (high - low) / 10), hint=hint
            )
        else:
            step = _step(high - low) / 10
            if widest > 100.0 and abs(low / step - round(low / step)) > 1e-6:
                step /= 2  # Else no round value could be reached from the lower end.
            handle = self._desk.gui.add_slider(
                label, min=low, max=high, step=step, initial_value=start, hint=hint
            )
        handle.on_update(self._desk.guard(self._setter(field.name, low, high, command)))
        self.inputs[group, field.name] = handle

    def show(self, scenario: Scenario) -> None:
        """Follow the settings in force."""
        for (group, field), handle in self.inputs.items():
            value = float(getattr(getattr(scenario, group), field))
            if abs(float(handle.value) - value) > 1e-9:
                handle.value = value

    def _setter(
        self, name: str, low: float, high: float, command: Callable[[str, float], object]
    ) -> Callable[[Any], None]:
        def changed(event: Any) -> None:
            self._desk.submit(command(name, number(event.target.value, low, high, name)))

        return changed


def _step(span: float) -> float:
    """A round step of about a tenth of `span`."""
    return float(10.0 ** np.floor(np.log10(max(span, 1e-6) / 5.0)))
