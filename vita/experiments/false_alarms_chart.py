"""The picture of how soon faults are noticed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from vita.experiments.charts import legend_below, panels
from vita.experiments.false_alarms_runs import WATCH, Fate
from vita.faults import CATALOGUE

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def periods_figure(fates: Sequence[Fate]) -> Figure:
    """Share of the faults noticed within so many control periods, and how far the tool came."""
    figure, ((left, right),) = panels(1, 2, (9.5, 4.0))
    handles = []
    for row in sorted({fate.row for fate in fates if fate.row}):
        runs = [fate for fate in fates if fate.row == row and np.isfinite(fate.travel_m)]
        if not runs:
            continue
        share = 100 * np.arange(1, len(runs) + 1) / len(runs)
        periods = np.sort([np.nan_to_num(fate.periods, nan=WATCH + 1) for fate in runs])
        handles += left.step(periods, share, where="post", label=f"{row}: {CATALOGUE[row].title}")
        right.step(np.sort([100 * fate.travel_m for fate in runs]), share, where="post")
    left.set_xlim(0, WATCH)
    left.set_xlabel("control periods since the fault")
    left.set_ylabel("noticed [% of the runs]")
    right.set_xlabel("travel of the tool since the fault [cm]")
    right.set_ylabel("[% of the runs]")
    legend_below(figure, handles, 2)
    return figure
