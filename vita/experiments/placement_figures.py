"""The plots of the `placement` experiment: maps of the sky above a task, and the check of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vita.errors import MissingDependency
from vita.experiments.charts import legend_below, panels
from vita.experiments.placement_map import PlacementMap, Task, eye_of
from vita.types import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vita.experiments.placement_tasks import ClosedLoop, Maps

LEVELS = 12
WIDEST = 0.98
"""Colours are cut at this quantile, so that a few hopeless places do not take them all."""
DEFAULT, PLAIN = "#1f6fb4", "#d9822b"


def sky_figure(maps: Maps) -> Figure:
    """Four maps of one task: accuracy and condition number, known and learned."""
    from matplotlib.lines import Line2D

    figure, axes = _skies(2, 2, (10.6, 11.2))
    true, learned = maps.true, maps.learned
    drawn = (
        (true, true.accuracy_mm, "Expected 3D error [mm per px of noise]", True),
        (true, true.condition, "Condition number", True),
        (learned, learned.joints_deg, "Learned: joint uncertainty [deg per px of noise]", False),
        (learned, learned.condition, "Learned: condition number", False),
    )
    for panel, (one, values, title, exact) in zip(axes.flat, drawn, strict=True):
        draw_sky(figure, panel, maps.task, one, values, title, exact)
    figure.suptitle(
        f"Where to put the second camera: {maps.task.title}\n"
        "Top: from the true Jacobian. Bottom: from what two cameras learned by exploring, one by one.",
        fontsize=12,
    )
    legend_below(
        figure,
        [
            Line2D([], [], marker="^", color="black", linestyle="none", markersize=9, label="first camera"),
            Line2D(
                [], [], marker="*", color="#d62728", markeredgecolor="white", linestyle="none", markersize=15,
                label="best place for the second",
            ),
            Line2D(
                [], [], marker="X", color="black", markeredgecolor="white", linestyle="none", markersize=10,
                label="worst",
            ),
            Line2D([], [], color="#555555", linewidth=5, label="arm, as seen from the target (square: base)"),
            _hatched("hidden by the arm, or a point is outside the image"),
        ],
        3,
    )  # fmt: skip
    return figure


def draw_sky(
    figure: Any, panel: Any, task: Task, one: PlacementMap, values: Array, title: str, exact: bool = True
) -> None:
    """One map on polar axes: azimuth around, zenith in the middle, `values` (b, a) as colours. Those
    that are `exact` get contour lines and the worst place, too; noise would make a tangle of them."""
    theta, radius = np.radians(one.azimuth_deg), 90.0 - one.elevation_deg
    kept = values[one.usable]
    low, high = np.log10(kept.min()), np.log10(max(np.quantile(kept, WIDEST), 1.02 * kept.min()))
    levels = np.linspace(low, high, LEVELS + 1)
    shown = panel.contourf(
        theta, radius, np.log10(values), levels=levels, cmap="viridis_r", extend="both", zorder=1
    )
    if exact:
        lines = panel.contour(
            theta, radius, np.log10(values), levels=levels[1:-1:2], colors="white", linewidths=0.8, zorder=2
        )
        # Gaps for the labels are cut in the wrong place on polar axes.
        panel.clabel(lines, fmt=lambda level: f"{10.0**level:.3g}", fontsize=7, colors="black", inline=False)
    # Hatching alone, so that the colours below it stay readable.
    panel.contourf(
        theta, radius, np.where(one.usable, 0.0, 1.0), levels=[0.5, 1.5], colors=["#ffffff55"],
        hatches=["////"], zorder=3,
    )  # fmt: skip
    _draw_arm(panel, task)
    azimuth, elevation = _direction_of(eye_of(task.first) - task.centre)
    panel.plot(
        azimuth, 90.0 - elevation, "^", color="black", markeredgecolor="white", markersize=11, zorder=6
    )
    order = np.where(one.usable, values, np.inf)
    for marker, colour, size, flat in (
        ("*", "#d62728", 19, order.argmin()),
        ("X", "black", 11, np.where(one.usable, values, -np.inf).argmax()),
    ):
        if marker == "X" and not exact:
            continue
        row, column = np.unravel_index(int(flat), values.shape)
        panel.plot(
            theta[column], radius[row], marker, color=colour, markeredgecolor="white", markersize=size,
            zorder=7, clip_on=False,
        )
    panel.set_title(title, fontsize=10, pad=14)
    bar = figure.colorbar(shown, ax=panel, shrink=0.75, pad=0.08, ticks=levels[::3])
    bar.ax.set_yticklabels([f"{10.0**level:.3g}" for level in levels[::3]], fontsize=8)


def check_figure(found: Sequence[ClosedLoop]) -> Figure:
    """Predicted against reached accuracy, and accuracy over the angle between the cameras."""
    from matplotlib.lines import Line2D

    figure, axes = panels(2, len(found), (5.6 * len(found), 8.6))
    for column, one in enumerate(found):
        above, below = axes[:, column]
        for values, colour, marker in ((one.default_mm, DEFAULT, "o"), (one.plain_mm, PLAIN, "s")):
            above.loglog(one.predicted_mm, values, marker, color=colour, markersize=5, alpha=0.8)
            below.semilogy(one.apart_deg, values, marker, color=colour, markersize=5, alpha=0.8)
        order = np.argsort(one.apart_deg)
        below.semilogy(one.apart_deg[order], one.predicted_mm[order], ".", color="#444444", markersize=7)
        ends = np.array([one.predicted_mm.min(), one.predicted_mm.max()])
        above.loglog(ends, ends, "--", color="#444444", linewidth=1)
        above.set_xlabel("predicted for one look, no averaging [mm]", fontsize=9)
        above.set_ylabel("reached 3D error of a point, rms [mm]", fontsize=9)
        above.set_title(
            f"{one.key}: rank correlation {one.agreement('default_mm'):.2f} (default), "
            f"{one.agreement('plain_mm'):.2f} (plain)",
            fontsize=10, loc="left",
        )  # fmt: skip
        below.set_xlabel("angle between the lines of sight [deg]", fontsize=9)
        below.set_ylabel("3D error of a point, rms [mm]", fontsize=9)
        below.set_xlim(0, 180)
        below.set_xticks(range(0, 181, 30))
        for panel, axis in ((above, "x"), (above, "y"), (below, "y")):
            _plain_ticks(panel, axis)
    figure.suptitle("Predicted and reached accuracy at random places of the second camera", fontsize=12)
    legend_below(
        figure,
        [
            Line2D([], [], color=DEFAULT, marker="o", linestyle="none", label="reached by the default"),
            Line2D([], [], color=PLAIN, marker="s", linestyle="none", label="reached by the thesis' law"),
            Line2D([], [], color="#444444", marker=".", linestyle="--", label="predicted"),
        ],
        3,
    )
    return figure


def _skies(rows: int, columns: int, size: tuple[float, float]) -> tuple[Any, Any]:
    """Polar axes with the horizon marked; raises `MissingDependency` without matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingDependency("plots need the package matplotlib") from None
    figure = Figure(figsize=size, dpi=110, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, subplot_kw={"projection": "polar"})
    for panel in axes.flat:
        panel.set_ylim(0, 105)
        panel.set_yticks([30, 60, 90], ["60°", "30°", "horizon"], fontsize=7, color="#222222")
        panel.set_rlabel_position(112)
        panel.tick_params(axis="x", labelsize=8)
        panel.grid(True, color="#00000022", linewidth=0.6)
        around = np.linspace(0, 2 * np.pi, 181)
        panel.plot(around, np.full(181, 90.0), color="#00000077", linewidth=1, zorder=4)
    return figure, axes


def _draw_arm(panel: Any, task: Task) -> None:
    """The directions in which the arm's links are, finely enough to be curves on the sky."""
    share = np.linspace(0.0, 1.0, 20)[:, None]
    # The last piece carries the points and is all around them: it has no direction.
    pieces = [a + share * (b - a) for a, b in zip(task.links[:-2], task.links[1:-1], strict=True)]
    path = np.concatenate(pieces)
    azimuth, elevation = _direction_of(path - task.centre)
    panel.plot(np.unwrap(azimuth), 90.0 - elevation, color="#555555", linewidth=5, alpha=0.75, zorder=5)
    panel.plot(
        azimuth[0], min(90.0 - elevation[0], 103.0), "s", color="#555555", markeredgecolor="white",
        markersize=9, zorder=5, clip_on=False,
    )  # fmt: skip


def _direction_of(away: Array) -> tuple[Array, Array]:
    """Azimuth [rad] and elevation [deg] of vectors (..., 3)."""
    flat = np.hypot(away[..., 0], away[..., 1])
    return np.arctan2(away[..., 1], away[..., 0]), np.degrees(np.arctan2(away[..., 2], flat))


def _plain_ticks(panel: Any, axis: str) -> None:
    """Plain numbers on a logarithmic axis, whose range may be less than a decade."""
    from matplotlib.ticker import LogLocator, NullFormatter

    one = panel.xaxis if axis == "x" else panel.yaxis
    one.set_major_locator(LogLocator(10.0, subs=(1.0, 2.0, 5.0)))
    one.set_major_formatter(lambda value, _: f"{value:g}")
    one.set_minor_formatter(NullFormatter())


def _hatched(label: str) -> Any:
    from matplotlib.patches import Patch

    return Patch(facecolor="#f4f4f4", edgecolor="#555555", hatch="////", label=label)
