"""Holds the end of a run against the scenario's `[expect]` table."""

from __future__ import annotations

import numpy as np

from vita.rig import SimulatedRig
from vita.scenario.schema import Scenario
from vita.scenario.truth_log import TruthLog
from vita.servo import outcome_of
from vita.types import Status


def final_distance_mm(rig: SimulatedRig, scenario: Scenario) -> float | None:
    """Ground truth of the distance that the scenario asks about, now [mm]."""
    wanted = scenario.expect.final_distance_mm if scenario.expect else None
    if wanted is None:
        return None
    goal = rig.locate(wanted.to, wanted.at)
    gap = rig.locate(wanted.of, wanted.point) - goal
    if wanted.along is not None:
        beyond = [a + b for a, b in zip(wanted.at, wanted.along, strict=True)]
        direction = rig.locate(wanted.to, beyond) - goal
        direction = direction / np.linalg.norm(direction)
        gap = gap - (gap @ direction) * direction
    return 1e3 * float(np.linalg.norm(gap))


def judged(
    scenario: Scenario,
    status: Status,
    ended_s: float,
    error_px: float,
    distance_mm: float | None,
    motion_after_deg: float,
    truth: TruthLog | None = None,
) -> dict[str, bool]:
    """Each expectation and whether it was met. Comparisons are written so that NaN fails."""
    expect = scenario.expect
    if expect is None:
        return {}
    verdict: dict[str, bool] = {}
    if expect.outcome is not None:
        verdict["outcome"] = outcome_of(status) == expect.outcome
    if expect.reason is not None:
        verdict["reason"] = status.reason == expect.reason
    if expect.within_s is not None:
        verdict["within_s"] = ended_s <= expect.within_s
    if expect.final_error_px is not None:
        verdict["final_error_px"] = error_px <= expect.final_error_px
    if expect.final_distance_mm is not None:
        verdict["final_distance_mm"] = distance_mm is not None and distance_mm <= expect.final_distance_mm.max
    if expect.max_joint_motion_after_deg is not None:
        verdict["max_joint_motion_after_deg"] = motion_after_deg <= expect.max_joint_motion_after_deg
    for index, follow in enumerate(expect.follow if truth else ()):
        assert truth is not None
        figures = truth.figures(index)
        for key in ("rms_mm", "rms_deg", "mean_mm"):
            most = getattr(follow, key)
            if most is not None:
                verdict[f"follow[{index}].{key}"] = figures[key] <= most
    for index, clearance in enumerate(expect.clearance if truth else ()):
        assert truth is not None
        verdict[f"clearance[{index}]"] = truth.nearest_mm(index) >= clearance.min
    if expect.recovered_mm is not None:
        verdict["recovered_mm"] = truth is not None and truth.recovered_mm() <= expect.recovered_mm
    return verdict
