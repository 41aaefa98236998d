"""The look that all plots of the experiments share."""

from __future__ import annotations

from typing import Any

from vita.errors import MissingDependency

COLOURS = {"thesis": "#8a8a8a", "plain": "#d9822b", "default": "#1f6fb4"}
"""Who is who in every plot: the thesis' printed figures, its algorithm as we run it, and ours."""
NAMES = {
    "thesis": "thesis, as printed",
    "plain": "plain (the thesis' algorithm)",
    "default": "vita's default",
}


def panels(rows: int, columns: int, size: tuple[float, float], **options: Any) -> tuple[Any, Any]:
    """A figure and its (rows, columns) axes; raises `MissingDependency` without matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingDependency("plots need the package matplotlib") from None
    # Figure without pyplot: no global state, so that it may be made anywhere.
    figure = Figure(figsize=size, dpi=120, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for each in axes.flat:
        each.grid(True, color="#e2e2e2", linewidth=0.6)
        each.set_axisbelow(True)
        each.tick_params(labelsize=8)
        for side in ("top", "right"):
            each.spines[side].set_visible(False)
    return figure, axes


def legend_below(figure: Any, handles: list[Any], columns: int) -> None:
    """One legend for all panels, outside them, so that it covers no data."""
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)


def line(method: str, **style: Any) -> Any:
    """A line of `method` for the legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], **{"color": COLOURS[method], "label": NAMES[method], "linewidth": 1.4} | style)


def log_scale(axes: Any) -> None:
    """A logarithmic y axis with plain numbers at 1, 2 and 5, or at powers of ten on a long one."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 300 * low else (1.0,)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
