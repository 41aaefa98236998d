"""The plots of the `estimators` experiment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vita.experiments.charts import legend_below, panels
from vita.experiments.estimators_cases import READINGS, ROBOTS, TASKS, cases

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vita.experiments.estimators import Outcomes

NOISES = {
    "gaussian": ("#1f6fb4", "o", "Gaussian noise, 0.2 px"),
    "impulsive": ("#d9822b", "D", "the same with 1 % wild readings of 10 px"),
}
SHOWN = {
    "default": ("#1f6fb4", "-"),
    "robust+uncertainty": ("#7a4fb5", "-"),
    "thesis": ("#8a8a8a", "-"),
    "thesis-broyden": ("#8a8a8a", "--"),
    "ibvs-rough": ("#d9822b", "-"),
    "floor": ("#2a8f5b", "-"),
}
"""Methods whose courses are drawn: colour and line."""
GROUPS = {
    "estimators": "Estimators, with the default policy",
    "policies": "Policies, with the default estimator",
    "references": "To compare with",
}
FLOOR_PX = 0.05
"""Lower end of the axes: under the tracker noise there is nothing to see [px]."""


def methods_figure(found: Mapping[tuple[str, str, str], Outcomes]) -> Figure:
    """Every method in a row: how often, how fast, how closely, how well it knew the Jacobian."""
    ran = {key for key, *_ in found}
    chosen = [case for case in cases() if case.key in ran]
    rows, y = [], 0.0
    for before, case in zip((None, *chosen[:-1]), chosen, strict=True):
        y += 1.0 if before is None or before.group == case.group else 1.7
        rows.append(y)
    figure, axes = panels(1, 5, (15.0, 0.36 * rows[-1] + 1.9), sharey=True)
    for noise, (colour, marker, _) in NOISES.items():
        for case, at in zip(chosen, rows, strict=True):
            some = [found[case.key, robot, noise] for robot in ROBOTS]
            done = np.concatenate([one.converged for one in some])
            steps = _median(np.concatenate([one.steps_1 for one in some]))
            apart = 1e3 * _median(np.concatenate([one.distance for one in some])[done])
            off = 100.0 * _median(np.concatenate([one.off for one in some]))
            lost = 100.0 * np.mean(np.concatenate([one.diverged for one in some]))
            # A calibration is given, not learned: its distance from the truth is no result.
            off = off if case.source == "learned" else np.nan
            values = (100.0 * done.mean(), lost, steps, apart, off)
            for panel, value in zip(axes[0], values, strict=True):
                panel.plot(
                    value, at, marker, color=colour, markersize=7, linestyle="none", clip_on=False,
                    markerfacecolor=colour if noise == "gaussian" else "none", markeredgewidth=1.5,
                    zorder=3 if noise == "gaussian" else 4,
                )  # fmt: skip
    titles = (
        "converged [%]", "diverged [%]", "steps to under 1 px\n(median of those that got there)",
        "final 3D error [mm]\n(median of the converged)", "error of the Jacobian [%]\n(median)",
    )  # fmt: skip
    for panel, title in zip(axes[0], titles, strict=True):
        panel.set_title(title, fontsize=10, loc="left")
        panel.set_xlim(left=0.0)
        panel.tick_params(axis="y", length=0)
    axes[0, 0].set_xlim(0.0, 100.0)
    axes[0, 1].set_xlim(0.0, max(1.0, axes[0, 1].get_xlim()[1]))
    for panel in axes[0, 3:]:
        _decades(panel)
    for group, words in GROUPS.items():
        first = min(at for case, at in zip(chosen, rows, strict=True) if case.group == group)
        axes[0, 0].annotate(
            words, (-0.02, first - 0.75), xycoords=("axes fraction", "data"), ha="right", va="center",
            fontsize=9, fontweight="bold", annotation_clip=False,
        )  # fmt: skip
    axes[0, 0].set_yticks(rows, [case.title for case in chosen], fontsize=9)
    axes[0, 0].set_ylim(rows[-1] + 0.7, -0.1)
    runs = sum(len(found["default", robot, "gaussian"].converged) for robot in ROBOTS)
    figure.suptitle(f"{runs} random tasks of WAM 4, WAM 7 and Puma 560, with joint limits", fontsize=12)
    legend_below(figure, [_dot(*look) for look in NOISES.values()], 2)
    return figure


def curves_figure(found: Mapping[tuple[str, str, str], Outcomes]) -> Figure:
    """Median error over the steps, one panel for each set of tasks."""
    figure, axes = panels(2, 3, (12.0, 6.8), sharex=True, sharey=True)
    shown = [case for case in cases() if case.key in SHOWN]
    places = [(tasks.key, tasks.title, "gaussian") for tasks in TASKS]
    places.append(("wam7", "random, wam7, wild readings", "impulsive"))
    assert set(READINGS) >= {noise for *_, noise in places}
    steps = 0
    for panel, (key, title, noise) in zip(axes.flat, places, strict=True):
        for case in shown:
            if case.key == "robust+uncertainty" and noise == "gaussian":
                continue  # There it does what the default does.
            colour, line = SHOWN[case.key]
            curve = found[case.key, key, noise].curve
            steps = len(curve) - 1
            panel.semilogy(np.maximum(curve, 0.5 * FLOOR_PX), line, color=colour, linewidth=1.7)
        panel.axhline(1.0, color="#444444", linewidth=0.8, linestyle=":")
        panel.set_title(title, fontsize=10, loc="left")
        panel.set_ylim(FLOOR_PX, 1e3)
        panel.set_xlim(0, min(steps, 40))
    for panel in axes[1]:
        panel.set_xlabel("control period", fontsize=9)
    for panel in axes[:, 0]:
        panel.set_ylabel("largest error component [px]", fontsize=9)
    figure.suptitle("Median course of the true image error (dotted line: converged)", fontsize=12)
    legend_below(figure, [_line(case.title, *SHOWN[case.key]) for case in shown], 3)
    return figure


def _decades(panel: Any) -> None:
    """A logarithmic axis over whole decades with plain numbers."""
    from matplotlib.ticker import LogLocator, NullFormatter

    panel.set_xscale("log")
    panel.relim()
    low, high = panel.dataLim.intervalx
    panel.set_xlim(10.0 ** np.floor(np.log10(max(low, 1e-9))), 10.0 ** np.ceil(np.log10(max(high, 1e-8))))
    panel.xaxis.set_major_locator(LogLocator(10.0))
    panel.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    panel.xaxis.set_minor_formatter(NullFormatter())


def _median(values: Any) -> float:
    kept = values[np.isfinite(values)]
    return float(np.median(kept)) if kept.size else float("nan")


def _dot(colour: str, marker: str, label: str) -> Any:
    from matplotlib.lines import Line2D

    face = colour if marker == "o" else "none"
    return Line2D([], [], color=colour, marker=marker, linestyle="none", markerfacecolor=face, label=label)


def _line(label: str, colour: str, style: Any) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=colour, linestyle=style, linewidth=1.7, label=label)
