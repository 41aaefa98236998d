"""The same reach by both modes of vita, with calibration errors injected: which wins, when."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vita.experiments.base import Check, Experiment, Job, Report, Table, register
from vita.experiments.side_by_side_charts import distances, ways
from vita.experiments.side_by_side_found import (
    BOTH,
    CARRIED,
    EYE,
    FOCAL,
    LEARNING,
    MOVED,
    SPHERE,
    TAUGHT,
    UVS,
    Found,
    methods_at,
)  # fmt: skip
from vita.experiments.side_by_side_runs import NEAR_MM, reaches
from vita.experiments.side_by_side_tables import main_table, summary, winners
from vita.experiments.side_by_side_tasks import TROUBLES

ROBOTS, TASKS = ("tx90", "wam7"), 3


@register
class SideBySide(Experiment):
    name = "side-by-side"
    title = "Side by side: image-based without calibration, and stereo impedance"
    doc = (
        "The same reach by UVS and by the stereo-impedance mode, with a wrong focal length, a wrong "
        "hand-eye, moved cameras, an obstacle, a goal that moves: which wins, when?"
    )

    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        tasks = [(ROBOTS[0], seed)] if quick else [(r, seed + i) for i in range(TASKS) for r in ROBOTS]
        troubles = {n: t for n, t in TROUBLES.items() if not (quick and n == BOTH)}
        return [
            Job(
                f"{name}, {robot} {number}", reaches,
                {"robot": robot, "seed": number, "trouble": name, "methods": tuple(methods_at(trouble))},
            )
            for robot, number in tasks
            for name, trouble in troubles.items()
        ]  # fmt: skip

    def report(self, jobs: Sequence[Job], results: Sequence[Any], quick: bool) -> Report:
        found = Found([reach for result in results for reach in result])
        tables = [main_table(found), winners(found)]
        figures = {"distances": distances(found.cells, NEAR_MM), "ways": ways(found.cells)}
        return Report(summary(found), tables, {"runs": _data(found)}, figures, checks(found))


def told(found: Found) -> float:
    """Largest difference that a wrong focal length and hand-eye make to a run of UVS [m]."""
    right = {(run.robot, run.seed): run.tool for run in found.cells["none", UVS]}
    wrong = [run for name in (FOCAL, EYE, BOTH) for run in found.cells.get((name, UVS), ())]
    pairs = [(run.tool, right[run.robot, run.seed]) for run in wrong]
    return max(np.inf if a.shape != b.shape else float(np.abs(a - b).max()) for a, b in pairs)


def checks(found: Found) -> list[Check]:
    """What must hold, whoever wins."""
    runs = found.runs
    sphere = [run.clearance_mm for (t, m), cell in found.cells.items() for run in cell
              if t == SPHERE and "stereo" in m]  # fmt: skip
    return [
        Check("any joint, beyond its limits at most [rad]", max(r.beyond_rad for r in runs), most=0.0),
        Check("fastest joint, relative to its limit", max(r.speed for r in runs), most=1.0 + 1e-6),
        Check("what wrong camera parameters change in a run of UVS [m]", told(found), 0.0, 0.0),
        Check("learning, right focal length, whatever the hand-eye: worst distance at the end [mm]",
              max(found.worst(EYE, m) for m in (LEARNING, TAUGHT)), most=5.0),
        Check("learning, cameras moved on the way: worst distance at the end [mm]",
              found.worst(MOVED, LEARNING), most=5.0),
        Check("learning, goal that moves: worst distance, rms [mm]",
              found.worst(CARRIED, LEARNING), most=5.0),
        Check("stereo, sphere in the way: smallest distance to the arm [mm]", min(sphere), least=1e-3),
    ]  # fmt: skip


def _data(found: Found) -> Table:
    rows = [
        (
            run.trouble, run.method, run.robot, run.seed, run.arrived, run.mm, run.deg, run.time_s,
            run.learned_s, run.way, run.clearance_mm, run.beyond_rad, run.speed, run.reason,
        )
        for run in found.runs
    ]  # fmt: skip
    columns = (
        "trouble", "method", "robot", "seed", "arrived", "off_mm", "off_deg", "within_5_mm_s", "learned_s",
        "way", "clearance_mm", "beyond_rad", "speed", "reason",
    )  # fmt: skip
    return Table("Every run", columns, rows)
