"""Every estimator and step policy on the same tasks, against the true Jacobian."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vita.experiments.base import Check, Experiment, Job, Report, Table, register
from vita.experiments.estimators_cases import (
    DELTA_DEG,
    GAIN,
    READINGS,
    ROBOTS,
    TASKS,
    Case,
    case_of,
    cases,
    source_of,
    tasks_of,
)
from vita.experiments.estimators_figures import curves_figure, methods_figure
from vita.experiments.estimators_loop import servo
from vita.types import Array

STEPS, QUICK_STEPS = 100, 60
COMPARE_EVERY = 4
DONE_SHARE = 0.99

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Outcomes:
    """What one method did on one set of tasks; (runs,) each unless stated."""

    tasks: str
    noise: str
    case: str
    converged: Flags
    diverged: Flags
    growth: Array
    """[px]"""
    steps_10: Array
    steps_1: Array
    distance: Array
    """[m]"""
    off: Array
    """Median over the run of |J - J_true| / |J_true|."""
    outside: Array
    """[rad]"""
    blocked: Flags
    out_of_view: Flags
    curve: Array
    """(steps + 1,) median over the runs of the largest error component [px]."""


def trial(tasks: str, count: int, noise: str, case: str, steps: int, seed: int) -> Outcomes:
    """One job: `count` tasks of a set with one method."""
    world, chosen = tasks_of(tasks, count, noise, seed), case_of(case)
    # Every method meets the same tasks and the same noise.
    course = servo(
        world, chosen.method, gain=GAIN, delta=np.radians(DELTA_DEG), steps=steps, seed=seed,
        compare_every=COMPARE_EVERY, source=source_of(chosen.source, world, seed),
    )
    return Outcomes(
        tasks, noise, case, course.converged, course.diverged, course.growth, course.steps_to(10.0),
        course.steps_to(1.0), course.distance[:, -1], np.median(course.off[:, ::COMPARE_EVERY], axis=-1),
        course.outside,
        course.blocked > 0, course.out_of_view, np.median(course.largest, axis=0),
    )


@register
class Estimators(Experiment):
    name = "estimators"
    title = "Estimators and step policies"
    doc = (
        "Which estimator and which step policy converge, how fast and how closely, on the thesis' near and "
        "far starts and on random tasks of three robots, with Gaussian and impulsive noise?"
    )

    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        return [
            Job(
                f"{case.key} on {tasks.key}, {noise}",
                trial,
                {
                    "tasks": tasks.key,
                    "count": tasks.count(case, quick),
                    "noise": noise,
                    "case": case.key,
                    "steps": QUICK_STEPS if quick else STEPS,
                    "seed": seed,
                },
            )
            for noise in READINGS
            for tasks in TASKS
            for case in cases()
            if tasks.count(case, quick)
        ]

    def report(self, jobs: Sequence[Job], results: Sequence[Any], quick: bool) -> Report:
        found = {(one.case, one.tasks, one.noise): one for one in results}
        tables = [
            _table(found, ROBOTS, noise, f"Random tasks of three robots, {noise} noise") for noise in READINGS
        ]
        tables += [
            _table(found, (key,), "gaussian", f"Puma 560, {title}, gaussian noise")
            for key, title in ((tasks.key, tasks.title) for tasks in TASKS[:2])
        ]
        return Report(
            _summary(found),
            tables,
            {"estimators": _everything(results)},
            {"methods": methods_figure(found), "convergence": curves_figure(found)},
            _checks(found, quick),
        )


def done_cases(found: dict) -> list[Case]:
    """The methods that ran."""
    ran = {key for key, *_ in found}
    return [case for case in cases() if case.key in ran]


def pooled(found: dict, case: str, tasks: Sequence[str], noise: str, field: str) -> NDArray[Any]:
    """One field of all runs of a method on several sets of tasks, one after the other."""
    return np.concatenate([getattr(found[case, key, noise], field) for key in tasks])


def median(values: Array) -> float:
    """Over what is finite; NaN when nothing is."""
    kept = values[np.isfinite(values)]
    return float(np.median(kept)) if kept.size else float("nan")


COLUMNS = (
    "method", "runs", "converged [%]", "diverged", "worst growth [px]", "steps to 10 px", "steps to 1 px",
    "3D error [mm]", "Jacobian off by [%]",
)  # fmt: skip


def _table(found: dict, tasks: Sequence[str], noise: str, title: str) -> Table:
    rows = []
    for case in done_cases(found):
        def of(field: str, key: str = case.key) -> NDArray[Any]:
            return pooled(found, key, tasks, noise, field)

        done = of("converged")
        rows.append((
            case.title, len(done), 100.0 * float(done.mean()), int(of("diverged").sum()),
            float(of("growth").max()), median(of("steps_10")), median(of("steps_1")),
            1e3 * median(of("distance")[done]), 100.0 * median(of("off")),
        ))  # fmt: skip
    steps = len(found["default", tasks[0], noise].curve) - 1
    notes = (
        f"Converged: every true error component below 1 px after {steps} steps (median of the last ten); 3D "
        "error: median over those, summed over three points; steps: median over the runs that got there; "
        "diverged: summed error +100 px in one step, the thesis' rule; Jacobian: Frobenius norm of the error "
        "over that of the true one, median over run and runs. The default comes first."
    )
    return Table(title, COLUMNS, rows, notes)


def _everything(results: Sequence[Outcomes]) -> Table:
    columns = (
        "tasks", "noise", "method", "runs", "converged", "diverged", "worst_growth_px", "steps_to_10px",
        "steps_to_1px", "steps_to_1px_p95", "distance_mm", "distance_mm_p95", "jacobian_off",
        "outside_limits_deg", "runs_at_a_limit", "runs_out_of_view",
    )  # fmt: skip
    rows = []
    for one in results:
        reached = one.steps_1[np.isfinite(one.steps_1)]
        outside = float(np.degrees(one.outside.max())) if one.tasks in ROBOTS else float("nan")
        rows.append((
            one.tasks, one.noise, one.case, len(one.converged), int(one.converged.sum()),
            int(one.diverged.sum()), float(one.growth.max()), median(one.steps_10), median(one.steps_1),
            float(np.percentile(reached, 95)) if reached.size else float("nan"),
            1e3 * median(one.distance), 1e3 * float(np.percentile(one.distance, 95)), median(one.off),
            max(outside, 0.0), int(one.blocked.sum()), int(one.out_of_view.sum()),
        ))  # fmt: skip
    return Table("All figures", columns, rows)


def _checks(found: dict, quick: bool) -> list[Check]:
    checks = []
    for tasks in TASKS[1:]:
        one: Outcomes = found["default", tasks.key, "gaussian"]
        share = 100.0 * float(one.converged.mean())
        if not quick:  # One run of thirty is more than one in a hundred.
            checks.append(Check(f"default converges, {tasks.title} [%]", share, least=100.0 * DONE_SHARE))
        checks.append(Check(f"default diverges, {tasks.title} [runs]", float(one.diverged.sum()), most=0))
    beyond = [
        np.count_nonzero(found[case.key, robot, noise].outside > 0.0)
        for case in done_cases(found) for robot in ROBOTS for noise in READINGS
    ]  # fmt: skip
    checks.append(Check("left the joint limits, all methods and robots [runs]", float(sum(beyond)), most=0))
    return checks


def _summary(found: dict) -> str:
    def share(case: str, noise: str = "gaussian") -> float:
        return 100.0 * float(pooled(found, case, ROBOTS, noise, "converged").mean())

    def steps(case: str) -> float:
        return median(pooled(found, case, ROBOTS, "gaussian", "steps_1"))

    runs = len(pooled(found, "default", ROBOTS, "gaussian", "converged"))
    return (
        f"On {runs} random tasks of three robots with noise of 0.2 px the default converges below 1 px in "
        f"{share('default'):.1f} % (the thesis' law in {share('thesis'):.1f} %, with its Broyden update in "
        f"{share('thesis-broyden'):.1f} %; exactly calibrated servoing in {share('ibvs'):.1f} %, calibrated "
        f"10 % and 5 degrees off in {share('ibvs-rough'):.1f} %; the default's policy with the true Jacobian "
        f"in {share('floor'):.1f} %). It takes {steps('default'):g} steps in the median, against "
        f"{steps('floor'):g} with the true Jacobian and {steps('ibvs'):g} with calibrated servoing at fixed "
        f"gain. With impulsive noise {share('default', 'impulsive'):.1f} % of the default's runs end below "
        f"1 px, {share('robust+uncertainty', 'impulsive'):.1f} % with the robust filter. Simulated trackers "
        "see through the arm and beyond the image; the random tasks include poses near singularities."
    )
