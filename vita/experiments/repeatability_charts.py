"""Plots of the repeatability experiment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from vita.experiments.charts import COLOURS, NAMES, legend_below, panels
from vita.experiments.repeatability_jobs import Measured, Residual
from vita.experiments.repeatability_setups import setup_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MM = 1e3
JOINT = "#5f8a4a"
WIDTH = 0.17


def comparison(main: Sequence[Measured]) -> Figure:
    """Joint control and servoing for each set-up, with the thesis' figures as ticks across the bars."""
    figure, ((axes,),) = panels(1, 1, (9.5, 5.0))
    at = np.arange(len(main))
    groups = [
        ("joint control, reported pose", JOINT, "s", [m.reported for m in main]),
        ("joint control, commanded pose", JOINT, "D", [m.commanded for m in main]),
        ("plain", COLOURS["plain"], "v", [m.servo["plain"].still for m in main]),
        ("plain, lambda doubled at the end", COLOURS["plain"], "^", [m.servo["plain"].final for m in main]),
        (NAMES["default"], COLOURS["default"], "o", [m.servo["default"].final for m in main]),
    ]
    handles = []
    for i, (label, colour, marker, values) in enumerate(groups):
        x = at + (i - 2) * WIDTH
        low, high = (np.array([MM * np.quantile(v, share) for v in values]) for share in (0.1, 0.9))
        axes.vlines(x, low, high, color=colour, linewidth=5, alpha=0.3)
        means = [MM * v.mean() for v in values]
        handles += axes.plot(x, means, marker, color=colour, markersize=7, label=label)
    for i, m in enumerate(main):
        s = setup_of(m.key)
        printed = ((-2, -2, s.reported_mm), (-1, -1, s.commanded_mm), (0, 2, s.servo_mm))
        for first, last, value in printed:
            ends = (i + (first - 0.5) * WIDTH, i + (last + 0.5) * WIDTH)
            axes.plot(ends, (value, value), color=COLOURS["thesis"], linewidth=2.0, zorder=1)
    handles += axes.plot([], [], color=COLOURS["thesis"], linewidth=2.0, label=NAMES["thesis"])
    axes.set_yscale("log")
    axes.set_xticks(at, [setup_of(m.key).title.replace(", ", ",\n", 1) for m in main])
    axes.set_ylabel("error of the tool [mm], mean and 10 to 90 %")
    axes.set_title("Going back to a pose: by the joints, and by what the cameras see", fontsize=11)
    axes.grid(False, axis="x")
    ticks = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
    axes.set_yticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    legend_below(figure, handles, 3)
    return figure


def laws(residuals: Sequence[Residual], measured: Sequence[Measured]) -> Figure:
    """What the dead band leaves against lambda, and what noise makes of it all."""
    figure, ((left, right),) = panels(1, 2, (9.5, 4.2))
    gains = np.linspace(0.22, 1.0, 100)
    (law,) = left.plot(gains, 1.0 / gains, color=COLOURS["thesis"], label="TOL / lambda (thesis 5.1.3)")
    handles = [law]
    for name, size in (("plain", 9), ("default", 6)):
        some = [r for r in residuals if r.method == name]
        at, left_over = [r.gain for r in some], [r.largest for r in some]
        (line,) = left.plot(at, left_over, "o", color=COLOURS[name], markersize=size, label=NAMES[name])
        handles.append(line)
    left.set(xlabel="lambda", ylabel="largest residual [multiples of TOL]", ylim=(0, None))
    left.set_title("One joint with a dead band TOL", fontsize=10)
    styles = {"one": "o", "four": "s", "stereo": "^", "mono": "v", "seven": "D"}
    for key, marker in styles.items():
        some = sorted((m for m in measured if m.key == key), key=lambda m: m.noise_px)
        for name in ("plain", "default"):
            means = [MM * m.servo[name].final.mean() for m in some]
            right.plot([m.noise_px for m in some], means, marker + "-", color=COLOURS[name], markersize=5,
                       linewidth=1)  # fmt: skip
        (shape,) = right.plot([], [], marker, color="#444444", label=setup_of(key).title)
        handles.append(shape)
    right.set(xscale="log", yscale="log", xlabel="tracker noise [px]", ylabel="mean error of the tool [mm]")
    noises = sorted({m.noise_px for m in measured})
    right.set_xticks(noises, [f"{noise:g}" for noise in noises])
    right.minorticks_off()
    ticks = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
    low, high = right.get_ylim()
    shown = [t for t in ticks if low <= t <= high]
    right.set_yticks(shown, [f"{t:g}" for t in shown])
    right.set_title("Worse trackers", fontsize=10)
    legend_below(figure, handles, 4)
    return figure
