"""Plots of the stereo-impedance experiment, after figures 6 to 8 of the TUM report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vita.experiments.charts import panels
from vita.experiments.stereo_cases import HIDDEN_S, MOVED_S
from vita.experiments.stereo_runs import Crossing, StereoRun

TRUE, SEEN, OFF, TARGET = "#1f6fb4", "#d9822b", "#b03a48", "#3a8f5c"
SHADES = {"calibrating": "#f4d58d", "looking": "#f7e6bf", "waiting": "#e3d3ea"}


def figure_7(run: StereoRun) -> Any:
    """True and recovered tool over time, their difference, and the way on which the arm learned."""
    figure, axes = panels(2, 3, (12.5, 6.4))
    for axis, name, panel in zip(range(3), "xyz", axes[0], strict=True):
        _phases(panel, run)
        panel.plot(run.stamp, run.tool[:, axis], color=TRUE, linewidth=1.8, label="true tool")
        panel.plot(run.stamp, run.recovered[:, axis], color=SEEN, linewidth=1.0, label="recovered")
        panel.set_title(f"{name} [m]", fontsize=9, loc="left")
        # While the tripod moves, the recovered tool leaves the picture: what matters is before and after.
        middle, half = np.mean(run.tool[:, axis]), np.ptp(run.tool[:, axis]) / 2 + 0.06
        panel.set_ylim(middle - half, middle + half)
    axes[0, 0].legend(fontsize=8, frameon=False, loc="upper right")
    off, gap, way = axes[1]
    _phases(off, run)
    off.plot(run.stamp, np.maximum(run.recovered_mm, 0.05), color=OFF, linewidth=1.2)
    off.set_yscale("log")
    off.set_title("recovered from true tool [mm]", fontsize=9, loc="left")
    _phases(gap, run)
    gap.plot(run.stamp, np.maximum(1e3 * np.linalg.norm(run.gap, axis=1), 0.05), color=TRUE, linewidth=1.2)
    gap.set_yscale("log")
    gap.set_title("tool from its goal [mm]", fontsize=9, loc="left")
    for panel in (*axes[0], off, gap):
        panel.axvline(MOVED_S, color="#555555", linewidth=0.9, linestyle="--")
        panel.set_xlabel("time [s]", fontsize=8)
    learning = np.array([p == "calibrating" for p in run.phase]) & run.since(MOVED_S)
    way.plot(*(1e3 * run.tool[learning][:, (1, 2)].T), ".-", color=TRUE, markersize=3, linewidth=0.7)
    way.set_aspect("equal", "datalim")
    way.set_title("calibration motion, y and z [mm]", fontsize=9, loc="left")
    figure.suptitle(
        "On-line calibration: the tripod is moved at the dashed line (TUM figure 7). Shaded: looking, "
        "calibrating", fontsize=10,
    )  # fmt: skip
    return figure


def figure_waits(run: StereoRun) -> Any:
    """How the arm waits while the target is hidden, and goes on once the tripod has been carried."""
    figure, axes = panels(1, 1, (8.5, 3.4))
    panel = axes[0, 0]
    _phases(panel, run, named=True)
    panel.plot(run.stamp, np.maximum(1e3 * np.linalg.norm(run.gap, axis=1), 0.05), color=TRUE, linewidth=1.2,
               label="tool from its goal")  # fmt: skip
    panel.plot(run.stamp, np.maximum(run.recovered_mm, 0.05), color=OFF, linewidth=1.0,
               label="recovered from true tool")  # fmt: skip
    panel.axvline(HIDDEN_S, color="#555555", linewidth=0.9, linestyle="--")
    panel.set_yscale("log")
    panel.set_xlabel("time [s]", fontsize=8)
    panel.set_ylabel("[mm]", fontsize=8)
    panel.legend(fontsize=8, frameon=False, loc="upper right")
    panel.set_title("The target is hidden at the dashed line, then the tripod is carried (TUM figure 6)",
                    fontsize=10, loc="left")  # fmt: skip
    return figure


def figure_8(run: StereoRun) -> Any:
    """Ways of tool and goal from above and from the side while a person crosses, and the distance between."""
    figure, axes = panels(1, 3, (12.5, 4.0))
    above, side, clear = axes[0]
    crossing = run.since(6.0)
    tool = run.goal + run.gap
    for panel, (i, j), names in ((above, (0, 1), "xy"), (side, (1, 2), "yz")):
        panel.plot(run.goal[crossing, i], run.goal[crossing, j], color=TRUE, linewidth=1.0, label="goal")
        panel.plot(tool[crossing, i], tool[crossing, j], color=OFF, linewidth=1.0, label="tool")
        panel.set_xlabel(f"{names[0]} [m]", fontsize=8)
        panel.set_ylabel(f"{names[1]} [m]", fontsize=8)
        panel.set_aspect("equal", "datalim")
    near = np.argmin(np.where(np.isfinite(run.clearance), run.clearance, np.inf))
    above.annotate("nearest here", tool[near, :2], fontsize=7, color="#555555")
    above.plot(*tool[near, :2], "o", color=TARGET, markersize=5)
    above.legend(fontsize=8, frameon=False)
    clear.plot(run.stamp, 1e3 * np.where(np.isfinite(run.clearance), run.clearance, np.nan), color=TARGET)
    clear.plot(run.stamp, 1e3 * np.linalg.norm(run.gap, axis=1), color=OFF, linewidth=0.9)
    clear.set_title("person to arm (green), tool from goal (red) [mm]", fontsize=9, loc="left")
    clear.set_xlabel("time [s]", fontsize=8)
    clear.set_ylim(0.0, 600.0)
    figure.suptitle("A person walks past with an arm in the way (TUM figure 8)", fontsize=10)
    return figure


def figure_obstacles(crossings: Sequence[Crossing]) -> Any:
    """Smallest distance of every random sphere, by its speed."""
    figure, axes = panels(1, 1, (6.5, 3.6))
    panel = axes[0, 0]
    panel.scatter(
        [c.speed_m_s for c in crossings], [1e3 * c.nearest_m for c in crossings],
        s=[2e5 * c.radius_m**3 for c in crossings], color=TRUE, alpha=0.6, edgecolor="none",
    )  # fmt: skip
    panel.axhline(0.0, color=OFF, linewidth=1.0)
    panel.set_xlabel("speed of the sphere [m/s]; size: its radius", fontsize=8)
    panel.set_ylabel("smallest distance to the arm [mm]", fontsize=8)
    return figure


def _phases(panel: Any, run: StereoRun, named: bool = False) -> None:
    """Shade what is not following."""
    start = 0
    for i in range(1, len(run.phase) + 1):
        if i < len(run.phase) and run.phase[i] == run.phase[start]:
            continue
        phase, end = run.phase[start], run.stamp[min(i, run.stamp.size - 1)]
        if phase in SHADES:
            panel.axvspan(run.stamp[start], end, color=SHADES[phase], alpha=0.6, linewidth=0, zorder=0)
            if named and end - run.stamp[start] > 1.0:
                panel.annotate(f" {phase}", (run.stamp[start], 0.03), xycoords=("data", "axes fraction"),
                               fontsize=8, color="#555555")  # fmt: skip
        start = i
