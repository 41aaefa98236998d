"""Plots of the side-by-side experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vita.experiments.charts import legend_below, panels
from vita.experiments.side_by_side_runs import Reach

Cells = Mapping[tuple[str, str], Sequence[Reach]]
COLOURS = {
    "uvs": "#d9822b",
    "uvs, to 0.3 px": "#e8b27a",
    "uvs, goal tied to the target": "#9c5b16",
    "stereo, learning, drawn": "#1f6fb4",
    "stereo, learning, taught": "#7fb2dc",
    "stereo, calibrated, drawn": "#3a8f5c",
    "stereo, calibrated, taught": "#93c9a8",
    "stereo, calibrated, tool unseen": "#8a8a8a",
}
LEAST_MM = 0.1


def distances(cells: Cells, near_mm: float) -> Any:
    """Where each run ends, by method and by what is wrong."""
    troubles = list(dict.fromkeys(trouble for trouble, _ in cells))
    figure, axes = panels(1, len(troubles), (14.0, 4.6), sharey=True)
    for panel, trouble in zip(axes[0], troubles, strict=True):
        mine = [method for method in COLOURS if (trouble, method) in cells]
        for place, method in enumerate(mine):
            mm = np.maximum([run.mm for run in cells[trouble, method]], LEAST_MM)
            spread = np.linspace(-0.2, 0.2, len(mm)) if len(mm) > 1 else np.zeros(1)
            panel.plot(place + spread, mm, "o", color=COLOURS[method], markersize=4, alpha=0.8)
            bar = [place - 0.35, place + 0.35]
            panel.plot(bar, [np.median(mm)] * 2, color=COLOURS[method], linewidth=2.0)
        panel.axhline(near_mm, color="#b03a48", linewidth=0.9, linestyle="--")
        panel.set_yscale("log")
        panel.set_xticks([])
        panel.set_title(trouble.replace(", ", ",\n"), fontsize=9, loc="left")
    axes[0, 0].set_ylabel("tool from its goal at the end [mm]; bar: median; dashed: arrived", fontsize=8)
    legend_below(figure, _handles(cells), 4)
    return figure


def ways(cells: Cells) -> Any:
    """Distance from the goal over time, of the first task."""
    troubles = list(dict.fromkeys(trouble for trouble, _ in cells))
    figure, axes = panels(2, 4, (14.0, 6.4), sharey=True)
    for panel, trouble in zip(axes.flat, troubles, strict=False):
        for method in COLOURS:
            for run in cells.get((trouble, method), ())[:1]:
                mm = np.maximum(run.gap_mm, LEAST_MM)
                panel.plot(run.stamp, mm, color=COLOURS[method], linewidth=1.1)
        panel.set_yscale("log")
        panel.set_title(trouble, fontsize=9, loc="left")
        panel.set_xlabel("time from Start [s]", fontsize=8)
    for panel in axes.flat[len(troubles) :]:
        panel.set_axis_off()
    axes[0, 0].set_ylabel("tool from its goal [mm]", fontsize=8)
    legend_below(figure, _handles(cells), 4)
    return figure


def _handles(cells: Cells) -> list[Any]:
    from matplotlib.lines import Line2D

    used = {method for _, method in cells}
    return [Line2D([], [], color=c, label=m, linewidth=2.0) for m, c in COLOURS.items() if m in used]
