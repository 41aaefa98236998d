"""Camera rotation (thesis 5.2.1): where two cameras stand, how far to explore, how large a step."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product

import numpy as np

from vita.experiments import rotation_charts as charts
from vita.experiments.base import Check, Experiment, Job, Report, Table, register
from vita.experiments.rotation_cells import Cell, Key, joined, mean, sweep
from vita.experiments.scene import METHODS
from vita.experiments.thesis_rotation import (
    DELTAS_DEG,
    GAINS,
    PLACEMENTS,
    PRINTED,
    TRACKERS,
    name_of,
)

QUICK_EVERY = 12
"""The quick sweep takes every twelfth placement."""
BATCH = 60
"""Placements of one job. It does not depend on the number of workers, so that the noise does not."""
STEPS_WANTED, QUICK_STEPS_WANTED = 9.5, 10.0
"""Mean steps; of thirty placements the mean scatters by some tenths of a step."""
MM_WANTED = {"perfect": 0.09, "gaussian": 0.6, "integer": 2.9}
CORRELATION_WANTED = 0.85
CONVERGED_WANTED = 0.99

Cells = dict[Key, Cell]


@register
class CameraRotation(Experiment):
    name = "camera-rotation"
    title = "Camera rotation: placement, exploration size and step size"
    doc = "How often, how fast, how exactly does it converge wherever cameras stand? Tables 5.1 to 5.3."

    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        angles = range(0, PLACEMENTS, QUICK_EVERY if quick else 1)
        parts = [angles[i : i + BATCH] for i in range(0, len(angles), BATCH)]
        return [
            Job(
                f"{method}, {goal} goal, {tracker} tracker",
                sweep,
                {
                    "goal": goal, "method": method, "tracker": tracker,
                    "angles_deg": tuple(part), "seed": seed,
                },
            )
            for goal, method, tracker, part in product(("near", "far"), METHODS, TRACKERS, parts)
        ]  # fmt: skip

    def report(self, jobs: Sequence[Job], results: Sequence[list[Cell]], quick: bool) -> Report:
        del jobs
        cells = joined(cell for part in results for cell in part)
        tables = [*(_table(cells, tracker) for tracker in TRACKERS), _far_table(cells)]
        data = {"settings": _settings(cells), "placements": _placements(cells)}
        return Report(_summary(cells), tables, data, charts.figures(cells), _checks(cells, quick))


def _of(cells: Cells, goal: str, method: str, tracker: str = "") -> list[Cell]:
    return [c for c in cells.values() if (c.goal, c.method) == (goal, method) and tracker in ("", c.tracker)]


def _diverged(some: Iterable[Cell]) -> int:
    return int(sum(c.diverged.sum() for c in some))


def _runs(some: Iterable[Cell]) -> int:
    return sum(c.diverged.size for c in some)


def correlation(cells: Cells) -> float:
    """Pearson's coefficient of the plain algorithm's 60 divergence counts and the thesis'."""
    ours = [cells["near", "plain", *setting].diverged.mean() for setting in PRINTED]
    printed = [row.diverged / PLACEMENTS for row in PRINTED.values()]
    return float(np.corrcoef(ours, printed)[0, 1]) if np.std(ours) > 0 else 0.0


def _checks(cells: Cells, quick: bool) -> list[Check]:
    default, far = _of(cells, "near", "default"), _of(cells, "far", "default")
    slowest = max(c.mean_steps for c in default)
    most_steps = QUICK_STEPS_WANTED if quick else STEPS_WANTED
    checks = [
        Check("runs of the default that diverge", _diverged(default), most=0),
        Check("mean steps of the default to under 10 px, slowest setting", slowest, most=most_steps),
    ]
    for tracker, wanted in MM_WANTED.items():
        if quick and tracker == "integer":
            continue  # The goal's own rounding rules there: it takes many placements to average.
        some = _of(cells, "near", "default", tracker)
        average = float(np.mean([c.mean_distance_mm for c in some]))
        checks.append(Check(f"mean 3D error of the default, {tracker} tracker [mm]", average, most=wanted))
    if not quick:  # A handful of placements is too few to compare counts.
        what = "correlation of plain's divergence counts with the thesis'"
        checks.append(Check(what, correlation(cells), least=CORRELATION_WANTED))
    near_share = np.concatenate([c.reached for c in far]).mean()
    checks.append(Check("far goal: runs of the default that diverge", _diverged(far), most=0))
    checks.append(Check("far goal: share that reaches 10 px", float(near_share), least=CONVERGED_WANTED))
    return checks


def _summary(cells: Cells) -> str:
    plain, default = _of(cells, "near", "plain"), _of(cells, "near", "default")
    far_plain, far = _of(cells, "far", "plain"), _of(cells, "far", "default")
    total, printed = _runs(plain), sum(row.diverged for row in PRINTED.values())
    steps = [c.mean_steps for c in default]
    best = ", ".join(
        f"{tracker} {np.mean([c.mean_distance_mm for c in _of(cells, 'near', 'default', tracker)]):.3g} mm "
        f"(thesis' best setting {1e3 * min(r.distance_m for k, r in PRINTED.items() if k[0] == tracker):.3g})"
        for tracker in MM_WANTED
    )
    share = np.concatenate([c.reached for c in far]).mean()
    first = min(c.first_px.min() for c in plain)
    return (
        f"{total} runs for each algorithm: {len(plain)} settings at {total // len(plain)} placements of the "
        f"cameras. The plain algorithm diverges in {_diverged(plain)} of them (the thesis: {printed} of "
        f"{PLACEMENTS * len(PRINTED)}; correlation over the settings {correlation(cells):.2f}), the default "
        f"in {_diverged(default)}. The default needs {min(steps):.1f} to {max(steps):.1f} steps to come "
        f"under 10 px, by setting; its mean final 3D error: {best}. At the far goal of listing 2 the plain "
        f"algorithm diverges in {_diverged(far_plain)} of {_runs(far_plain)} runs, the default in "
        f"{_diverged(far)}, and {100 * share:.2f} % of the default's runs come under 10 px.\n\n"
        'The thesis\' column "steps to <10 px" cannot be that: a quarter of the error less in each '
        f"step comes under 10 px after 8.9 steps only from 130 px, and here {first:.0f} px are the least "
        "that a run begins with. It agrees with steps to a tenth of the first error, averaged over the runs "
        "that come under 10 px; both counts are given."
    )


COLUMNS = (
    "Δ [deg]", "λ",
    "image error [px]: thesis", "plain", "default",
    "3D error [mm]: thesis", "plain", "default",
    "steps to a tenth: thesis", "plain", "default",
    "steps to 10 px: plain", "default",
    "diverged: thesis", "plain", "default",
)  # fmt: skip


def _table(cells: Cells, tracker: str) -> Table:
    rows = []
    for delta, gain in product(DELTAS_DEG, GAINS):
        printed = PRINTED[tracker, delta, gain]
        p, d = (cells["near", method, tracker, delta, gain] for method in METHODS)
        rows.append((
            delta, gain,
            printed.image_px, p.mean_image_px, d.mean_image_px,
            1e3 * printed.distance_m, p.mean_distance_mm, d.mean_distance_mm,
            printed.steps, p.mean_steps_to_tenth, d.mean_steps_to_tenth,
            p.mean_steps, d.mean_steps,
            printed.diverged, _diverged([p]), _diverged([d]),
        ))  # fmt: skip
    count = _runs([cells["near", "plain", tracker, DELTAS_DEG[0], GAINS[0]]])
    notes = (
        "Image errors are what the tracker reports, as in the thesis. Means over the runs that did not "
        f"diverge. Counts of ours are of {count}, the thesis' of 360."
    )
    return Table(f"{name_of(tracker)}: {tracker} tracker", COLUMNS, rows, notes)


def _far_table(cells: Cells) -> Table:
    rows = []
    for tracker, method in product(TRACKERS, METHODS):
        some = _of(cells, "far", method, tracker)
        together = {f: np.concatenate([getattr(c, f) for c in some]) for f in FAR_FIELDS}
        reached, kept = together["reached"], ~together["diverged"]
        rows.append((
            tracker, method, _runs(some), _diverged(some), float(reached.mean()),
            mean(together["steps"][reached]), mean(1e3 * together["distance_m"][kept]),
            float((kept & (together["largest_px"] < 1.0)).mean()),
        ))  # fmt: skip
    columns = (
        "tracker", "algorithm", "runs", "diverged", "share under 10 px", "steps to 10 px",
        "3D error [mm]", "share that ends with every row under 1 px",
    )  # fmt: skip
    return Table(
        "Far goal: listing 2, 0.70 m away", columns, rows, "All exploration sizes and gains together."
    )


FAR_FIELDS = ("reached", "diverged", "steps", "distance_m", "largest_px")


def _settings(cells: Cells) -> Table:
    columns = (
        "goal", "algorithm", "tracker", "delta_deg", "gain", "placements", "diverged", "under_10_px",
        "image_px", "true_image_px", "distance_mm", "steps_to_tenth", "steps_to_10_px",
        "condition",
        "thesis_image_px", "thesis_distance_mm", "thesis_steps", "thesis_diverged",
    )  # fmt: skip
    rows = []
    for c in cells.values():
        printed = PRINTED[c.tracker, c.delta_deg, c.gain] if c.goal == "near" else None
        theirs = (
            (printed.image_px, 1e3 * printed.distance_m, printed.steps, printed.diverged)
            if printed
            else (None,) * 4
        )
        rows.append((
            c.goal, c.method, c.tracker, c.delta_deg, c.gain, c.diverged.size, _diverged([c]),
            int(c.reached.sum()), c.mean_image_px, c.mean_true_px, c.mean_distance_mm,
            c.mean_steps_to_tenth, c.mean_steps, float(np.median(c.condition)), *theirs,
        ))  # fmt: skip
    return Table("Every setting", columns, rows)


def _placements(cells: Cells) -> Table:
    columns = (
        "figure", "algorithm", "angle_deg", "image_px", "true_image_px", "distance_mm", "condition",
        "steps_to_10_px", "diverged",
    )  # fmt: skip
    rows = []
    for name, (tracker, delta, gain) in charts.FIGURES.items():
        for c in (cells["near", method, tracker, delta, gain] for method in METHODS):
            values = c.angle_deg, c.image_px, c.true_px, 1e3 * c.distance_m, c.condition, c.steps
            rows += [
                (name, c.method, *map(float, row), bool(lost))
                for *row, lost in zip(*values, c.diverged, strict=True)
            ]
    return Table("Every placement of the two figures", columns, rows)
