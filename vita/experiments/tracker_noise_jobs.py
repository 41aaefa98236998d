"""The measurements of the tracker-noise experiment, each a job of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vita.experiments.cameras import Reading
from vita.experiments.repeatability_arm import commanded, reported
from vita.experiments.repeatability_jobs import JOINT_TRIALS, METHODS, joints_of
from vita.experiments.repeatability_servo import servo
from vita.experiments.repeatability_setups import around, setup_of
from vita.experiments.tracker_noise_runs import DELTA_DEG, Settings, outcome
from vita.experiments.tracker_noise_scene import NEAREST_M, Fading
from vita.types import Array

READINGS: Mapping[str, Reading] = {
    "perfect": Reading("perfect"),
    "gaussian": Reading("gaussian", 0.2),
    "gaussian03": Reading("gaussian", 0.3),
    "integer": Reading("integer"),
    "fading": Fading("gaussian", 0.2),
}
NOISE_NAMES = {
    "perfect": "perfect",
    "gaussian": "Gaussian 0.2 px",
    "gaussian03": "Gaussian 0.3 px",
    "integer": "whole pixels",
    "fading": "0.2 px at 0.4 m, growing with distance",
}
ALPHAS: Mapping[str, float | None] = {"plain": 0.0, "broyden0.1": 0.1, "broyden1": 1.0, "default": None}
"""Algorithm to the alpha of Broyden's update in every step; the default has an estimator of its own."""
REPORTED_MM, COMMANDED_MM = 0.1575, 0.1245
REAL_M = (0.40, 0.55)
REAL_NOISE_PX = 0.2
"""Table 5.8: joint control of the real arm, distances of its cameras, and tracker noise at the first."""


@dataclass(frozen=True, order=True)
class Case:
    """One curve over the distance."""

    rig: str
    noise: str
    method: str
    gain: float = 0.05
    delta_deg: float = DELTA_DEG


@dataclass(frozen=True, eq=False)
class Curve:
    """How one case went at every distance; all arrays (d,)."""

    case: Case
    distances: Array
    """Of the cameras from the target [m]."""
    trials: int
    mm: Array
    """Mean of the summed 3D error [mm]."""
    median_mm: Array
    px: Array
    """Mean of the summed true image error [px]."""
    diverged: Array
    """How many of the trials."""
    steps: Array
    """Median number of steps to a tenth of the first image error; NaN when most never got there."""


@dataclass(frozen=True)
class Real:
    """One cell of table 5.8."""

    method: str
    distance_m: float
    noise_px: float
    mm: float


@dataclass(frozen=True)
class RealArm:
    """Table 5.8: joint control and visual servoing of an arm like the thesis' real one."""

    reported_mm: float
    commanded_mm: float
    cells: Sequence[Real]


def curve(case: Case, distances: Sequence[float], trials: int, seed: int) -> Curve:
    """Run one case."""
    at = np.array(distances)
    method = Settings(ALPHAS[case.method], case.gain, float(np.radians(case.delta_deg)))
    ends = outcome(case.rig, READINGS[case.noise], at, trials, method, seed)
    mm, px, steps, diverged = (
        values.reshape(len(at), trials)
        for values in (1e3 * ends.distance, ends.image, ends.steps, ends.diverged)
    )
    late = np.where(np.isnan(steps), np.inf, steps)
    typical = np.median(late, axis=1)
    return Curve(
        case, at, trials, mm.mean(1), np.median(mm, axis=1), px.mean(1), diverged.sum(1),
        np.where(np.isfinite(typical), typical, np.nan),
    )  # fmt: skip


def real_arm(trials: int, seed: int) -> RealArm:
    """Table 5.8: two cameras 90 degrees apart, on an arm with the joint errors of the thesis' arm; the
    noise is the same at both distances, or grows with them."""
    base = replace(setup_of("four"), reported_mm=REPORTED_MM, commanded_mm=COMMANDED_MM)
    joints = joints_of(base, seed)
    target = base.arm.pose(base.goal)[:3, 3]
    cells = []
    near, far = REAL_M
    for distance, noise in (
        (near, REAL_NOISE_PX), (far, REAL_NOISE_PX), (far, REAL_NOISE_PX * far / NEAREST_M),
    ):  # fmt: skip
        cameras = around(target, distance, np.radians([-45.0, 45.0]), height=0.0)
        setup = replace(base, cameras=cameras)
        for name, method in METHODS.items():
            ends = servo(setup, joints, method, trials=trials, seed=seed + 1, noise_px=noise)
            cells.append(Real(name, distance, noise, float(1e3 * ends.final.mean())))
    return RealArm(
        float(1e3 * reported(base.arm, joints, base.goal, JOINT_TRIALS, seed + 2).mean()),
        float(1e3 * commanded(base.arm, joints, base.goal, JOINT_TRIALS, seed + 3).mean()),
        cells,
    )
