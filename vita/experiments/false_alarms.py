"""How often do the monitors stop a run in which nothing is wrong, and how soon one in which something is?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from vita.experiments.base import Check, Experiment, Job, Report, Table, register
from vita.experiments.false_alarms_chart import periods_figure
from vita.experiments.false_alarms_runs import Fate, run_some
from vita.faults import CATALOGUE
from vita.types import Array

HEALTHY, QUICK_HEALTHY = 200, 12
FAULTY, QUICK_FAULTY = 40, 4
"""Runs of each fault."""
AT_ONCE = 4
"""Runs of one job."""
MOST_FALSE = 1
"""False alarms in 200 healthy runs that are put up with."""
SAID = {
    "V4": "3",
    "V5": "3; 3 cm (9 at most), unguarded 71 cm (98)",
    "V7": "2",
    "V8": "2 (93 % at once)",
    "V9": "10 (15 at most)",
    "C2": "2 (5 at most); 3 cm (17 at most), unguarded 26 cm (39)",
}
"""What the catalogue of faults measured on an idealised model: median periods; runaway."""


@register
class FalseAlarms(Experiment):
    name = "false-alarms"
    title = "Faults noticed, and false alarms"
    doc = (
        "How many of 200 healthy runs do the monitors stop or slow down, and how soon do they notice a "
        "fault? The catalogue of faults: V4, V5, V7, V8, V9, C2."
    )

    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        healthy, faulty = (QUICK_HEALTHY, QUICK_FAULTY) if quick else (HEALTHY, FAULTY)
        jobs = []
        for row, count in (("", healthy), *((row, faulty) for row in SAID)):
            for first in range(0, count, AT_ONCE):
                arguments = {"row": row, "first": first, "count": min(AT_ONCE, count - first), "seed": seed}
                jobs.append(Job(f"{row or 'healthy'} {first + 1}", run_some, arguments))
        return jobs

    def report(self, jobs: Sequence[Job], results: Sequence[Any], quick: bool) -> Report:
        fates = [fate for some in results for fate in some]
        healthy = [fate for fate in fates if not fate.row]
        alarms = [fate for fate in healthy if fate.reason != "converged" or fate.degraded]
        allowed = MOST_FALSE * len(healthy) / HEALTHY
        checks = [Check(f"false alarms in {len(healthy)} healthy runs", len(alarms), most=np.ceil(allowed))]
        tables = [_found(fates), _ended(healthy)]
        figures = {"periods": periods_figure(fates)}
        return Report(_summary(healthy, alarms), tables, {"runs": _all(fates)}, figures, checks)


def _found(fates: Sequence[Fate]) -> Table:
    columns = (
        "fault", "runs", "noticed [%]", "periods, median", "90 % within", "at most", "travel [cm], median",
        "at most [cm]", "way to the goal [cm], median", "the catalogue: median periods; runaway",
    )  # fmt: skip
    rows = []
    for row, said in SAID.items():
        runs = [fate for fate in fates if fate.row == row and np.isfinite(fate.travel_m)]
        periods = np.array([fate.periods for fate in runs if np.isfinite(fate.periods)])
        travel, honest = (100 * np.array([getattr(f, k) for f in runs]) for k in ("travel_m", "honest_m"))
        share = 100 * len(periods) / len(runs) if runs else np.nan
        rows.append((
            f"{row}: {CATALOGUE[row].title}", len(runs), share,
            _share(periods, 50), _share(periods, 90), _share(periods, 100),
            _share(travel, 50), _share(travel, 100), _share(honest, 50), said,
        ))  # fmt: skip
    return Table(
        "Faults", columns, rows,
        "Noticed: degraded to half speed, held or faulted. A fault comes within the first ten periods of "
        "servoing, while the arm is on its way; a run that was done before it came is left out. Travel: "
        "how far the tool came from where it was when the fault came, until it was at rest or, where the arm "
        "goes on without the lost tracker, at the goal.",
    )  # fmt: skip


def _share(values: Array, percent: float) -> float:
    """The value that so many percent do not exceed; NaN of none."""
    return float(np.percentile(values, percent)) if len(values) else np.nan


def _ended(healthy: Sequence[Fate]) -> Table:
    ends = Counter((fate.reason, fate.degraded) for fate in healthy)
    rows = [(reason, "yes" if slow else "no", count) for (reason, slow), count in ends.most_common()]
    return Table("How the healthy runs ended", ("reason", "at half speed meanwhile", "runs"), rows)


def _all(fates: Sequence[Fate]) -> Table:
    columns = (
        "row", "run", "noise_px", "reason", "degraded", "periods_until_noticed", "travel_m", "honest_m",
    )  # fmt: skip
    rows = [
        (f.row or "healthy", f.run, f.noise_px, f.reason, int(f.degraded), f.periods, f.travel_m, f.honest_m)
        for f in fates
    ]
    return Table("Runs", columns, rows)


def _summary(healthy: Sequence[Fate], alarms: Sequence[Fate]) -> str:
    kinds = ", ".join(f"{f.reason} (run {f.run})" for f in alarms) or "none"
    return (
        f"{len(alarms)} of {len(healthy)} healthy runs were stopped or slowed down: {kinds}. Each is a "
        "random task of a WAM with seven joints: three points of its tool in two views, trackers with 0.2 to "
        "0.43 px of noise. Engine, monitors and gate are the product's; physics and pictures are left out."
    )
