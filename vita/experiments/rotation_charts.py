"""The plots of the camera rotation: thesis figures 5.8 and 5.9, and the whole sweep at a glance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from vita.experiments.charts import COLOURS, legend_below, line, log_scale, panels
from vita.experiments.rotation_cells import Cell
from vita.experiments.scene import METHODS
from vita.experiments.thesis_rotation import DELTAS_DEG, GAINS, PLACEMENTS, PRINTED, TRACKERS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = {"figure_5_8": ("integer", 6, 0.5), "figure_5_9": ("perfect", 8, 0.5)}
"""File name to tracker, Delta and lambda."""
MARKERS = dict(zip(GAINS, ("o", "s", "^", "D"), strict=True))


def figures(cells: Mapping[tuple, Cell]) -> dict[str, Figure]:
    made = {
        name: _by_angle([cells["near", method, *setting] for method in METHODS], name)
        for name, setting in FIGURES.items()
    }
    return {"overview": _overview(cells)} | made


def _by_angle(cells: list[Cell], name: str) -> Figure:
    """Image error, 3D error, condition number and steps over the placement, as in the thesis."""
    figure, axes = panels(2, 2, (10.0, 6.6), sharex=True)
    (image, distance), (condition, steps) = axes
    for c in cells:
        style = {"color": COLOURS[c.method], "linewidth": 1.3}
        kept = ~c.diverged
        for panel, values in (
            (image, c.true_px), (distance, 1e3 * c.distance_m), (steps, c.steps)
        ):  # fmt: skip
            panel.plot(c.angle_deg, np.where(kept, values, np.nan), **style)
    condition.plot(cells[0].angle_deg, cells[0].condition, color="#444444", linewidth=1.3)
    for panel, label in (
        (image, "final true image error [px]"), (distance, "final 3D error [mm]"),
        (condition, "condition number of the first Jacobian"), (steps, "steps to under 10 px"),
    ):  # fmt: skip
        panel.set_title(label, fontsize=10, loc="left")
    for panel in (image, distance):
        log_scale(panel)
    steps.set_ylim(bottom=0)
    condition.set_ylim(bottom=0)
    for panel in (condition, steps):
        panel.set_xlabel("placement of the cameras around the target [deg]", fontsize=9)
        panel.set_xlim(0, 360)
        panel.set_xticks(range(0, 361, 60))
    c = cells[0]
    number = name.removeprefix("figure_").replace("_", ".")
    figure.suptitle(
        f"Thesis figure {number}: {c.tracker} tracker, Δ = {c.delta_deg}°, λ = {c.gain:g}", fontsize=11
    )
    legend_below(figure, [line(method) for method in METHODS], 2)
    return figure


def _overview(cells: Mapping[tuple, Cell]) -> Figure:
    """Diverged runs, steps and 3D error over Delta, one column for each tracker."""
    figure, axes = panels(3, 3, (11.0, 9.0), sharex=True, sharey="row")
    for column, tracker in enumerate(TRACKERS):
        lost, steps, distance = axes[:, column]
        for gain in GAINS:
            printed = [PRINTED[tracker, delta, gain] for delta in DELTAS_DEG]
            dots = {"color": COLOURS["thesis"], "marker": MARKERS[gain], "linestyle": ":", "linewidth": 1.0}
            lost.plot(DELTAS_DEG, [100 * r.diverged / PLACEMENTS for r in printed], markersize=4, **dots)
            distance.plot(DELTAS_DEG, [1e3 * r.distance_m for r in printed], markersize=4, **dots)
            for method in METHODS:
                some = [cells["near", method, tracker, delta, gain] for delta in DELTAS_DEG]
                style = {"color": COLOURS[method], "marker": MARKERS[gain], "markersize": 4, "linewidth": 1.2}
                lost.plot(DELTAS_DEG, [100 * c.diverged.mean() for c in some], **style)
                steps.plot(DELTAS_DEG, [c.mean_steps for c in some], **style)
                distance.plot(DELTAS_DEG, [c.mean_distance_mm for c in some], **style)
        lost.set_title(f"{tracker} tracker", fontsize=10)
        distance.set_xlabel("exploration size Δ [deg]", fontsize=9)
        distance.set_xticks(DELTAS_DEG)
        log_scale(distance)
    for panel, label in zip(
        axes[:, 0], ("diverged [% of placements]", "steps to under 10 px", "final 3D error [mm]"), strict=True
    ):
        panel.set_ylabel(label, fontsize=9)
    axes[1, 0].set_ylim(bottom=0)
    marks = [line("plain", marker=MARKERS[gain], color="#444444", label=f"λ = {gain:g}") for gain in GAINS]
    lines = [line("thesis", linestyle=":"), line("plain"), line("default")]
    legend_below(figure, [*lines, *marks], 7)
    return figure
