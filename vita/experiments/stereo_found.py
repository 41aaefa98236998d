"""The results of the stereo experiment, by what they are of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vita.experiments.base import Job
from vita.experiments.stereo_cases import MOVED_OVER_S, MOVED_S
from vita.experiments.stereo_parts import filtered, fits, moved_cameras
from vita.experiments.stereo_runs import Crossing, StereoRun, run_case, run_crossings
from vita.types import Array

MAIN = "tx90"
"""The report's arm."""


class Found:
    def __init__(self, jobs: Sequence[Job], results: Sequence[Any]) -> None:
        self.runs: dict[tuple[str, str], StereoRun] = {}
        self.crossings: list[Crossing] = []
        self.fits: dict[int, Array] = {}
        self.filter: dict[tuple[float, float], tuple[float, float]] = {}
        self.triangulation: dict[str, float] = {}
        self.moved: dict[tuple[float, int], dict[str, float]] = {}
        for job, result in zip(jobs, results, strict=True):
            given = job.arguments
            if job.work is run_case:
                self.runs[given["robot_name"], given["case"]] = result
            elif job.work is run_crossings:
                self.crossings += result
            elif job.work is fits:
                self.fits[given["pairs"]] = result
            elif job.work is moved_cameras:
                self.moved[given["shift_m"], given["pictures"]] = result
            elif job.work is filtered:
                self.filter[given["speed_m_s"], given["turn_deg_s"]] = result
            else:
                self.triangulation = result

    def run(self, case: str, robot: str = MAIN) -> StereoRun:
        return self.runs[robot, case]


def noticed_s(run: StereoRun) -> float:
    """Time from the tripod's first motion until the arm stopped to look [s]."""
    after = [t for t, p in zip(run.stamp, run.phase, strict=True) if t > MOVED_S and p == "looking"]
    return float(after[0] - MOVED_S) if after else np.nan


def back_s(run: StereoRun, within_mm: float = 10.0) -> float:
    """Time from the end of the tripod's motion until the tool is at its goal, and the recovered tool at the
    true one, within 1 cm for good [s]."""
    gap = 1e3 * np.linalg.norm(run.gap, axis=1)
    good = (gap < within_mm) & (np.nan_to_num(run.recovered_mm, nan=np.inf) < within_mm)
    bad = np.flatnonzero(~good)
    last = run.stamp[bad[-1]] if bad.size else 0.0
    return float(last - MOVED_S - MOVED_OVER_S) if last < run.stamp[-1] else np.inf
