"""A picture of a run: the error of each constraint, and the joints."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vita.errors import BadInput, MissingDependency

if TYPE_CHECKING:
    from vita.scenario.record import RunRecord

_SHADES = {"learning": "#f4d58d", "servoing": "#cfe8d5", "hold": "#f3c6c6", "fault": "#e59a9a"}


def plot(record: RunRecord, path: str | Path) -> None:
    """Write a PNG with the largest error per constraint (log scale) above the joint motion.

    Raises `MissingDependency` without matplotlib.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingDependency("plots need the package matplotlib") from None
    # Figure without pyplot: no global state, so it may be called from any thread.
    figure = Figure(figsize=(9, 6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    time = record.stamp - record.stamp[0] if record.stamp.size else record.stamp
    draw = _following if record.scenario.mode == "impedance" else _errors
    draw(above, record, time)
    _joints(below, record, time)
    for axes in (above, below):
        _states(axes, record, time)
        axes.grid(True, color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    mark = "passed" if record.passed else "FAILED"
    verdict = f"{record.outcome} ({record.reason})" if record.reason else record.outcome
    # The title is the author's text: a dollar sign in it must not start a formula.
    title = above.set_title(f"{record.scenario.title}\n{verdict}, {mark}", fontsize=11, loc="left", wrap=True)
    title.set_parse_math(False)
    try:
        figure.savefig(path, format="png")
    except OSError as error:
        raise BadInput(f"cannot write the plot: {error.strerror or error}", str(path)) from None


def _errors(axes: Any, record: RunRecord, time: np.ndarray) -> None:
    """One line per constraint: its largest absolute residual."""
    axes.set_ylabel("error [px]")
    rows = list(enumerate(record.labels))
    colors = _colors(len({label.constraint for _, label in rows}))
    for color, (name, group) in zip(colors, groupby(rows, key=lambda row: row[1].constraint), strict=False):
        columns = [i for i, _ in group]
        values = np.abs(record.error[:, columns])
        largest = np.where(np.isnan(values).all(axis=1), np.nan, np.nanmax(np.nan_to_num(values), axis=1))
        camera = record.labels[columns[0]].camera
        (line,) = axes.plot(time, np.maximum(largest, 1e-3), color=color, linewidth=1.4)
        line.set_label(f"{name} ({camera})".lstrip("_"))
    tolerance = record.scenario.servo.tolerance_px
    goal = axes.axhline(tolerance, color="#555555", linewidth=0.9, linestyle="--")
    goal.set_label(f"done within {tolerance:g} px")
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.08)  # room for the names of the states
    legend = axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False)
    for text in legend.get_texts():
        text.set_parse_math(False)


def _following(axes: Any, record: RunRecord, time: np.ndarray) -> None:
    """How far the tool was from its goal, truly and as seen, and what the learned calibration was off by."""
    axes.set_ylabel("distance [mm]")
    series = record.series
    lines = [("tool to goal, as seen", series.get("error_mm"))]
    for i, follow in enumerate(record.scenario.expect.follow if record.scenario.expect else ()):
        lines.append((f"{follow.of} to goal, truly", series.get(f"follow_{i}_mm")))
    if {"tool_true", "tool_recovered"} <= series.keys():
        gap = 1e3 * np.linalg.norm(series["tool_recovered"] - series["tool_true"], axis=1)
        lines.append(("recovered tool to true tool", gap))
    for color, (name, values) in zip(_colors(len(lines)), lines, strict=True):
        if values is not None:
            axes.plot(time, np.maximum(values, 1e-2), color=color, linewidth=1.3, label=name)
    axes.set_yscale("log")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False)


def _joints(axes: Any, record: RunRecord, time: np.ndarray) -> None:
    """Each joint's motion from where it started."""
    axes.set_xlabel("time [s]")
    axes.set_ylabel("joints from start [deg]")
    if record.q.ndim != 2 or not record.q.size:
        return
    motion = np.degrees(record.q - record.q[0])
    for j, color in enumerate(_colors(motion.shape[1])):
        axes.plot(time, motion[:, j], color=color, linewidth=1.2, label=f"{j}")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False, title="joint")


def _states(axes: Any, record: RunRecord, time: np.ndarray) -> None:
    """Shade the background by the state of the machine, and name the states that have the room."""
    start = 0
    named = axes.get_subplotspec().is_first_row()
    for state, group in groupby(record.state):
        end = start + len(list(group))
        if state in _SHADES and end <= time.size:
            last = time[min(end, time.size - 1)]
            axes.axvspan(time[start], last, color=_SHADES[state], alpha=0.35, linewidth=0, zorder=0)
            if named and last - time[start] > 0.06 * time[-1]:
                axes.annotate(
                    f" {state}", (time[start], 0.97), xycoords=("data", "axes fraction"),
                    va="top", fontsize=8, color="#555555",
                )  # fmt: skip
        start = end


def _colors(count: int) -> list[Any]:
    from matplotlib import colormaps

    if count <= 10:
        return [colormaps["tab10"](i) for i in range(count)]
    return [colormaps["turbo"](x) for x in np.linspace(0.05, 0.95, count)]
