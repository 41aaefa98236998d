"""The benchmark's picture: the ROC of the loss score, and success against the threshold."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tracker_score as score
from tracker_follow import Track
from tracker_report import about

from vita.errors import MissingDependency


def plot(path: Path, tracks: Sequence[Track], trackers: Sequence[str]) -> None:
    """Write a PNG with both plots."""
    try:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot
    except ImportError as problem:
        raise MissingDependency("the plot needs matplotlib (pip install matplotlib)") from problem
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    limits = np.geomspace(0.02, 10, 60)
    for tracker in trackers:
        mine = [t for t in tracks if t.tracker == tracker]
        moving = [t for t in mine if t.case in about("success")]
        if moving:
            right.plot(limits, [100 * score.success(moving, x) for x in limits], label=tracker)
        values, good = score.judged(mine)
        alarms, hits, area = score.roc(values, good)
        if np.isnan(area):
            continue
        (line,) = left.plot(100 * alarms, 100 * hits, label=f"{tracker}, area {area:.4f}")
        flags, good_flags = score.judged_flags(mine)
        own = [100 * float((flags[good_flags == which] == 0).mean()) for which in (True, False)]
        left.plot(*own, "o", color=line.get_color())
    left.set(xlabel="good frames flagged [%]", ylabel="bad frames flagged [%]")
    left.set_title("Loss: score swept, dot: own flag")
    left.set_xscale("symlog", linthresh=0.1)
    right.set(xlabel="threshold [px]", ylabel="frames within [%]", xscale="log")
    right.set_title("Success, all cases without loss")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
