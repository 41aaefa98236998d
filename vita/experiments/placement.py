"""Where to put the second camera (the main lesson of thesis chapter 5), as a map, and its check."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vita.experiments.base import Check, Experiment, Job, Report, Table, register
from vita.experiments.placement_figures import check_figure, sky_figure
from vita.experiments.placement_map import rank_correlation
from vita.experiments.placement_tasks import SETTINGS, ClosedLoop, Maps, make_maps, run_sample

STEP_DEG, QUICK_STEP_DEG = 5.0, 10.0
SAMPLES, QUICK_SAMPLES = (60, 20), (24, 8)
"""Placements, and servo runs at each."""
AGREE, QUICK_AGREE = 0.8, 0.5
"""Least rank correlation that makes the map worth following; few places and runs rank less surely."""
BINS_DEG = (0, 15, 30, 60, 120, 150, 165, 180)


@register
class Placement(Experiment):
    name = "placement"
    title = "Where to put the second camera"
    doc = (
        "With one camera given, how accurate does a task become with the second one in every direction, and "
        "can a servo without calibration tell? Thesis 5.2.1 and 5.3."
    )

    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        step = QUICK_STEP_DEG if quick else STEP_DEG
        placements, repeats = QUICK_SAMPLES if quick else SAMPLES
        jobs = []
        for setting in SETTINGS:
            jobs.append(
                Job(
                    f"map of {setting.key}",
                    make_maps,
                    {"key": setting.key, "step_deg": step, "seed": seed},
                )
            )
            arguments = {"key": setting.key, "placements": placements, "repeats": repeats, "seed": seed}
            jobs.append(Job(f"servo runs of {setting.key}", run_sample, arguments))
        return jobs

    def report(self, jobs: Sequence[Job], results: Sequence[Any], quick: bool) -> Report:
        maps = [one for one in results if isinstance(one, Maps)]
        runs = [one for one in results if isinstance(one, ClosedLoop)]
        checks = [
            Check(
                f"{one.key}: rank correlation of predicted accuracy and that which the default reached",
                one.agreement("default_mm"),
                least=QUICK_AGREE if quick else AGREE,
            )
            for one in runs
        ]
        figures = {f"map_{one.key}": sky_figure(one) for one in maps} | {"check": check_figure(runs)}
        tables = [_places(maps), *(_angles(one) for one in maps)]
        return Report(
            _summary(maps, runs), tables, {"maps": _all_maps(maps), "runs": _all_runs(runs)}, figures, checks
        )


def _places(maps: Sequence[Maps]) -> Table:
    columns = (
        "task", "second camera", "azimuth [deg]", "elevation [deg]", "between the cameras [deg]",
        "3D error [mm/px]", "condition number",
    )  # fmt: skip
    rows = []
    for one in maps:
        at = one.true
        for name, (row, column) in (("best", at.best()), ("worst", at.worst())):
            rows.append((
                one.task.title, name, float(at.azimuth_deg[column]), float(at.elevation_deg[row]),
                float(at.apart_deg[row, column]), float(at.accuracy_mm[row, column]),
                float(at.condition[row, column]),
            ))  # fmt: skip
    return Table(
        "Best and worst place", columns, rows,
        "Among the directions from which the arm does not hide a point. 3D error: root mean square of a "
        "point for one pixel of white noise in the error, without averaging over time.",
    )  # fmt: skip


def _angles(one: Maps) -> Table:
    columns = (
        "between the cameras [deg]", "3D error [mm/px], median", "best", "worst", "condition number, median",
    )  # fmt: skip
    rows, at = [], one.true
    for low, high in zip(BINS_DEG, BINS_DEG[1:], strict=False):
        there = (at.apart_deg >= low) & (at.apart_deg <= high)
        if there.any():
            values = at.accuracy_mm[there]
            rows.append((
                f"{low} to {high}", float(np.median(values)), float(values.min()), float(values.max()),
                float(np.median(at.condition[there])),
            ))  # fmt: skip
    return Table(f"{one.task.title}: by the angle between the lines of sight", columns, rows)


def _all_maps(maps: Sequence[Maps]) -> Table:
    columns = (
        "task", "azimuth_deg", "elevation_deg", "apart_deg", "usable", "accuracy_mm_per_px", "condition",
        "joints_deg_per_px", "learned_accuracy_mm_per_px", "learned_condition", "learned_joints_deg_per_px",
    )  # fmt: skip
    rows = []
    for one in maps:
        true, learned = one.true, one.learned
        for r, elevation in enumerate(true.elevation_deg):
            for c, azimuth in enumerate(true.azimuth_deg):
                rows.append((
                    one.key, float(azimuth), float(elevation), true.apart_deg[r, c], int(true.usable[r, c]),
                    true.accuracy_mm[r, c], true.condition[r, c], true.joints_deg[r, c],
                    learned.accuracy_mm[r, c], learned.condition[r, c], learned.joints_deg[r, c],
                ))  # fmt: skip
    return Table("Maps", columns, rows)


def _all_runs(runs: Sequence[ClosedLoop]) -> Table:
    columns = (
        "task", "azimuth_deg", "elevation_deg", "apart_deg", "condition", "predicted_mm", "default_mm",
        "plain_mm", "default_not_converged",
    )  # fmt: skip
    rows = [
        (one.key, *(float(value) for value in values))
        for one in runs
        for values in zip(
            one.azimuth_deg, one.elevation_deg, one.apart_deg, one.condition, one.predicted_mm,
            one.default_mm, one.plain_mm, one.lost, strict=True,
        )
    ]  # fmt: skip
    return Table("Servo runs", columns, rows)


def _summary(maps: Sequence[Maps], runs: Sequence[ClosedLoop]) -> str:
    parts = []
    for one, loop in zip(maps, runs, strict=True):
        at, best, worst = one.true, one.true.best(), one.true.worst()
        usable = at.usable
        told = rank_correlation(at.accuracy_mm[usable], one.learned.joints_deg[usable])
        share = np.median(loop.default_mm / loop.predicted_mm)
        parts.append(
            f"{one.task.title}: the best second camera stands {at.apart_deg[best]:.0f} degrees from the "
            f"first and expects {at.accuracy_mm[best]:.1f} mm per pixel of noise, the worst "
            f"{at.apart_deg[worst]:.0f} degrees and {at.accuracy_mm[worst]:.1f} mm. Servo runs at "
            f"{len(loop.predicted_mm)} random places rank as predicted (rank correlation "
            f"{loop.agreement('default_mm'):.2f}; thesis' law {loop.agreement('plain_mm'):.2f}); by "
            f"averaging the default ends at {share:.2f} of what one look allows. The joint uncertainty of "
            "the learned Jacobians, which needs no calibration, ranks the places like the true accuracy "
            f"(rank correlation {told:.2f})."
        )
    parts.append(
        "The prediction takes white noise of the same size in both images and all points inside them; "
        "what the scene hides is not known to it, only the arm itself, as bars of 7 cm radius."
    )
    return " ".join(parts)
