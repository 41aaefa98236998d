"""Plots of the tracker-noise experiment (thesis figure 5.17)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from vita.experiments.charts import COLOURS, NAMES, legend_below, panels
from vita.experiments.tracker_noise_jobs import NOISE_NAMES, Case, Curve
from vita.experiments.tracker_noise_scene import RIG_NAMES, RIGS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAIR = ("plain", "default")
LEAST = 1e-3
"""Nothing below is shown [mm or px]: it is zero to anybody."""


def by_distance(curves: Mapping[Case, Curve], noises: Sequence[str], what: str) -> Figure:
    """Median error over the distance, `what` = mm or px: a row for each tracker, a column for each rig."""
    shown = [noise for noise in noises if noise != "perfect"]
    figure, axes = panels(len(shown), len(RIGS), (10.0, 2.6 * len(shown) + 0.6), sharex=True, sharey=True)
    handles: dict[str, Any] = {}
    for row, noise in enumerate(shown):
        for column, rig in enumerate(RIGS):
            panel = axes[row, column]
            for method in PAIR:
                one = curves[Case(rig, noise, method)]
                values = one.median_mm if what == "mm" else one.px
                (handles[method],) = panel.plot(
                    one.distances, values.clip(LEAST), "o-", color=COLOURS[method], markersize=3,
                    linewidth=1.2, label=NAMES[method],
                )  # fmt: skip
            if row == 0:
                panel.set_title(RIG_NAMES[rig], fontsize=9)
            if row == len(shown) - 1:
                panel.set_xlabel("distance of the cameras [m]", fontsize=9)
            panel.set_yscale("log")
            panel.yaxis.set_major_formatter("{x:g}")
        unit = "3D error [mm]" if what == "mm" else "image error [px]"
        axes[row, 0].set_ylabel(f"{NOISE_NAMES[noise].replace(', ', ',' + chr(10))}\n{unit}", fontsize=8)
    legend_below(figure, list(handles.values()), 2)
    return figure


def single_camera(curves: Mapping[Case, Curve]) -> Figure:
    """One camera with 0.3 px: how many runs are lost, at a small and a large lambda."""
    gains = sorted({case.gain for case in curves if (case.rig, case.noise) == ("single", "gaussian03")})
    figure, axes = panels(1, len(gains), (9.0, 3.6), sharey=True)
    handles: dict[str, Any] = {}
    for panel, gain in zip(axes[0], gains, strict=True):
        mark = panel.axvline(0.6, color=COLOURS["thesis"], linestyle="--", label="thesis: diverges from here")
        handles["thesis"] = mark
        for method in PAIR:
            one = curves[Case("single", "gaussian03", method, gain)]
            share = 100.0 * one.diverged / one.trials
            (handles[method],) = panel.plot(
                one.distances, share, "o-", color=COLOURS[method], markersize=4, label=NAMES[method]
            )
        panel.set_title(f"one camera, Gaussian 0.3 px, lambda = {gain:g}", fontsize=9)
        panel.set_xlabel("distance of the camera [m]", fontsize=9)
    axes[0, 0].set_ylabel("runs that diverge [%]", fontsize=9)
    legend_below(figure, list(handles.values()), 3)
    return figure
