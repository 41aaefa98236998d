"""The plot of the camera baseline: thesis figure 5.10."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vita.experiments.baseline_turns import DELTA_DEG, FIRST_DEG, GAIN, Turn
from vita.experiments.charts import COLOURS, legend_below, line, log_scale, panels
from vita.experiments.scene import METHODS
from vita.types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLOTTED = "gaussian"
SHADES = {
    "condition": ("#444444", "at the start"),
    "goal_condition": ("#2a9d6f", "at the goal"),
    "view_condition": ("#b0569c", "of the views alone"),
}
"""Colour and name of each condition number."""


def figure_5_10(turns: Mapping[tuple[str, str], Turn]) -> Figure:
    """The thesis' panels over the angle: medians over the first camera's places, and their range."""
    figure, axes = panels(2, 2, (10.0, 6.6), sharex=True)
    (condition, lost), (steps, distance) = axes
    for method in METHODS:
        t, colour = turns[method, PLOTTED], COLOURS[method]
        lost.plot(t.angle_deg, 100 * t.diverged.mean(0), color=colour, linewidth=1.3)
        for panel, values in ((steps, t.steps), (distance, t.distance_mm)):
            _band(panel, t.angle_deg, values, colour)
    for field, (colour, _) in SHADES.items():
        _band(condition, t.angle_deg, getattr(t, field), colour)
    log_scale(condition)
    log_scale(distance)
    for panel, label in (
        (condition, "condition number"), (lost, "diverged [% of the places]"),
        (steps, "steps to under 10 px"), (distance, "final 3D error [mm]"),
    ):  # fmt: skip
        panel.set_title(label, fontsize=10, loc="left")
        panel.set_xlim(0, 360)
        panel.set_xticks(range(0, 361, 45))
    steps.set_ylim(bottom=0)
    lost.set_ylim(-3, 103)
    for panel in (steps, distance):
        panel.set_xlabel("angle between the cameras [deg]", fontsize=9)
    figure.suptitle(
        f"Thesis figure 5.10: {PLOTTED} tracker, Δ = {DELTA_DEG:g}°, λ = {GAIN:g}; median and range over "
        f"{len(FIRST_DEG)} places of the first camera",
        fontsize=11,
    )
    named = [line("plain", color=colour, label=name) for colour, name in SHADES.values()]
    legend_below(figure, [*(line(method) for method in METHODS), *named], 5)
    return figure


def _band(panel: Any, angles: Array, values: Array, colour: str) -> None:
    """The median over the first axis as a line, least to most as a band; gaps where all runs diverge."""
    kept = np.isfinite(values).any(0)
    filled = np.where(kept, values, 0.0)
    low, middle, high = (
        np.where(kept, f(filled, axis=0), np.nan) for f in (np.nanmin, np.nanmedian, np.nanmax)
    )
    panel.fill_between(angles, low, high, color=colour, alpha=0.18, linewidth=0)
    panel.plot(angles, middle, color=colour, linewidth=1.4)
