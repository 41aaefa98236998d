"""What the `estimators` experiment compares, and on which tasks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vita.errors import UnknownName
from vita.experiments.analytic import Ibvs, Pbvs, miscalibrated
from vita.experiments.cameras import Reading
from vita.experiments.estimators_loop import Source
from vita.experiments.scene import stereo_rigs, target, world
from vita.experiments.starts import random_starts
from vita.experiments.trial import Method, World
from vita.servo.config import ServoConfig
from vita.servo.estimators import ESTIMATORS, Tuning
from vita.servo.policies import POLICIES

DEFAULT = (ServoConfig.estimator, ServoConfig.policy)
GAIN, DELTA_DEG = 0.5, 4.0
"""Settings of all methods alike: lambda in the middle of the thesis' range, the default exploration."""
ROUGH_FOCAL_SHARE, ROUGH_TURN_DEG = 0.1, 5.0
"""A calibration that is off: the focal length, and each camera turned about a random axis."""


@dataclass(frozen=True)
class Case:
    """One way to servo, and where its Jacobian comes from."""

    key: str
    """Short and unique, for CSV files and tests."""
    title: str
    group: str
    """`estimators`, `policies` or `references`."""
    method: Method
    source: str = "learned"
    """`learned` from motion; or what a calibrated servo computes, image-based (`ibvs`) or position-based
    (`pbvs`), with a calibration that is exact or, with `-rough` behind it, off."""
    thin: int = 1
    """What is slow does the first of so many of the tasks, and none in the quick sweep."""


def cases() -> tuple[Case, ...]:
    """Every estimator with the default policy, every policy with the default estimator, and what to
    compare them with. New ones appear by themselves."""
    estimator, policy = DEFAULT
    found = [
        Case(
            f"{kind}+{policy}" if kind != estimator else "default",
            found.title if kind != estimator else f"Default: {found.title}",
            "estimators",
            _method(kind, policy),
        )
        for kind, found in sorted(ESTIMATORS.items(), key=lambda item: item[0] != estimator)
    ]
    found += [
        Case(f"{estimator}+{kind}", found.title, "policies", _method(estimator, kind))
        for kind, found in POLICIES.items()
        if kind != policy
    ]
    plain = Method("plain", "thesis", "fixed", Tuning(alpha=0.0))
    broyden = replace(plain, tuning=Tuning(alpha=ServoConfig.alpha))
    ideal = _method(estimator, policy)
    ibvs = replace(ideal, policy="fixed", damping=0.0)
    return (
        *found,
        Case("thesis", "Thesis, first Jacobian kept", "references", plain),
        Case("thesis-broyden", f"Thesis, Broyden {ServoConfig.alpha:g}", "references", broyden),
        Case("ibvs", "Calibrated IBVS, exact", "references", ibvs, "ibvs"),
        Case("ibvs-rough", "Calibrated IBVS, 10 % and 5° off", "references", ibvs, "ibvs-rough"),
        Case("pbvs", "Calibrated PBVS, exact", "references", ibvs, "pbvs", thin=5),
        Case("pbvs-rough", "Calibrated PBVS, 10 % and 5° off", "references", ibvs, "pbvs-rough", thin=5),
        Case("floor", "Floor: true Jacobian at every step", "references", ideal, "ibvs"),
    )


def _method(estimator: str, policy: str) -> Method:
    return Method(f"{estimator}+{policy}", estimator, policy, damping=ServoConfig.damping)


def case_of(key: str) -> Case:
    """Raises `UnknownName` with the choices."""
    known = {case.key: case for case in cases()}
    try:
        return known[key]
    except KeyError:
        raise UnknownName("method", key, known) from None


READINGS = {"gaussian": Reading("gaussian", 0.2), "impulsive": Reading("impulsive", 0.2, wild_share=0.01)}
"""Noise of 0.2 px, and the same with 1 % of wild readings of 10 px: with 24 readings a frame, one frame
in five holds one."""


@dataclass(frozen=True)
class Tasks:
    """A set of tasks: its name, what people call it, and how many of them."""

    key: str
    title: str
    full: int
    quick: int

    def count(self, case: Case, quick: bool) -> int:
        """How many of the tasks `case` does."""
        if quick:
            return self.quick if case.thin == 1 else 0
        return max(6, self.full // case.thin)


ROBOTS = ("wam4", "wam7", "puma560")
TASKS: Sequence[Tasks] = (
    Tasks("near", "thesis 5.2.1, 0.32 m", 36, 6),
    Tasks("far", "thesis listing 2, 0.70 m", 36, 6),
    *(Tasks(robot, f"random, {robot}", 200, 30) for robot in ROBOTS),
)


def tasks_of(key: str, count: int, noise: str, seed: int) -> World:
    """The tasks of one set. Those of the thesis start outside the Puma's limits and so have none."""
    if key in ROBOTS:
        return random_starts(key, count, seed, READINGS[noise])
    if key not in ("near", "far"):
        raise UnknownName("set of tasks", key, [tasks.key for tasks in TASKS])
    rigs = stereo_rigs(np.radians(np.arange(count) * 360.0 / count), target(key))
    return world(rigs, key, READINGS[noise])


def source_of(kind: str, one: World, seed: int) -> Source:
    """What a case's Jacobian comes from; wrong calibrations are wrong in the same way for all cases."""
    if kind == "learned":
        return "learned"
    cameras, gain = one.cameras, GAIN
    if kind.endswith("-rough"):
        random = np.random.default_rng([seed, 1])
        cameras = miscalibrated(cameras, random, ROUGH_FOCAL_SHARE, ROUGH_TURN_DEG)
    return Pbvs(cameras, gain) if kind.startswith("pbvs") else Ibvs(cameras, gain)
