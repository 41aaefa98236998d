"""Tracker noise (thesis 5.2.4): what it costs as the cameras move back, and how many cameras help."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from vita.experiments import tracker_noise_charts as charts
from vita.experiments import tracker_noise_tables as tables
from vita.experiments.base import Check, Experiment, Job, Report, register
from vita.experiments.tracker_noise_jobs import (
    REAL_M,
    REAL_NOISE_PX,
    Case,
    Curve,
    RealArm,
    curve,
    real_arm,
)
from vita.experiments.tracker_noise_scene import RIGS


def cases() -> list[Case]:
    """All curves: figure 5.17, then what the text of 5.2.4 tells of larger noise and lambda."""
    listed = [Case(rig, noise, method) for noise, rig, method in product(tables.MAIN, RIGS, tables.PAIR)]
    listed += [
        Case("single", "gaussian03", method, gain)
        for method, gain in product(tables.PAIR, (0.05, tables.LARGE_GAIN))
    ]
    listed += [Case("single", "gaussian03", "plain", delta_deg=delta) for delta in tables.OTHER_DELTAS_DEG]
    listed += [Case(rig, "gaussian", "plain", tables.LARGE_GAIN) for rig in RIGS]
    listed += [Case(rig, "gaussian", method) for rig, method in product(RIGS, ("broyden0.1", "broyden1"))]
    # Long jobs first, so that no core waits for the last one.
    return sorted(listed, key=lambda case: (case.method != "default", case))


@register
class TrackerNoise(Experiment):
    name = "tracker-noise"
    title = "Tracker noise: cameras that move back from the target"
    doc = "How do noise, distance and the number of cameras limit the accuracy? Figure 5.17, table 5.8."

    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        distances = tuple(np.round(np.arange(0.4, 2.001, 0.2 if quick else 0.05), 3).tolist())
        trials = 16 if quick else 50
        jobs = [
            Job(
                f"{case.method}, {case.rig}, {case.noise}", curve,
                {"case": case, "distances": distances, "trials": trials, "seed": seed},
            )
            for case in cases()
        ]  # fmt: skip
        return [*jobs, Job("real arm", real_arm, {"trials": 100 if quick else 400, "seed": seed})]

    def report(self, jobs: Sequence[Job], results: Sequence[Any], quick: bool) -> Report:
        del jobs
        curves = {result.case: result for result in results if isinstance(result, Curve)}
        real = next(result for result in results if isinstance(result, RealArm))
        figures = {
            "distance_3d": charts.by_distance(curves, tables.MAIN, "mm"),
            "distance_image": charts.by_distance(curves, tables.MAIN, "px"),
            "single_camera": charts.single_camera(curves),
        }
        found = [
            tables.main_table(curves),
            tables.divergence_table(curves),
            tables.broyden_table(curves),
            tables.real_table(real),
        ]
        data = {"curves": tables.data(curves)}
        return Report(_summary(curves, real), found, data, figures, _checks(curves, real, quick))


def _cell(real: RealArm, method: str, distance: float) -> float:
    """Of table 5.8, with noise that grows with the distance [mm]."""
    return [c.mm for c in real.cells if (c.method, c.distance_m) == (method, distance)][-1]


def _worst_ratio(curves: tables.Curves, method: str) -> float:
    """Least ratio, over noises and two-camera rigs, of one camera's error to theirs (geometric means)."""

    def level(rig: str, noise: str) -> float:
        return float(np.exp(np.mean(np.log(curves[Case(rig, noise, method)].mm))))

    noisy = [noise for noise in tables.MAIN if noise != "perfect"]
    return min(level("single", noise) / level(rig, noise) for noise in noisy for rig in RIGS[:2])


def _checks(curves: tables.Curves, real: RealArm, quick: bool) -> list[Check]:
    checks = []
    for noise, rig in product(("gaussian", "fading"), RIGS):
        value = tables.rank_correlation(curves[Case(rig, noise, "default")])
        what = f"rank correlation of error and distance: default, {rig}, {noise}"
        # Nine distances with sixteen trials each rank less surely than 33 with fifty.
        checks.append(Check(what, value, least=0.75 if quick else 0.9))
    for method in tables.PAIR:
        what = f"one camera's error over that of two, least: {method}"
        checks.append(Check(what, _worst_ratio(curves, method), least=1.0))
    lost = sum(int(one.diverged.sum()) for case, one in curves.items() if case.method == "default")
    checks.append(Check("runs of the default that diverge", lost, most=0))
    if not quick:  # It is some runs in a hundred, and a quick sweep has few.
        first = tables.first_lost(curves[Case("single", "gaussian03", "plain")])
        what = "plain, one camera, 0.3 px: nearest distance that diverges [m] (thesis 0.6)"
        checks.append(Check(what, first, least=0.5, most=0.7))
    for method in tables.PAIR:
        growth = _cell(real, method, REAL_M[1]) / _cell(real, method, REAL_M[0])
        checks.append(Check(f"table 5.8: error at 0.55 m over that at 0.40 m, {method}", growth, least=1.0))
    return checks


def _last(method: str, curves: tables.Curves) -> float:
    return float(curves[Case("orthogonal", "gaussian", method)].median_mm[-1])


def _summary(curves: tables.Curves, real: RealArm) -> str:
    def pair(rig: str, noise: str) -> str:
        plain, default = (curves[Case(rig, noise, method)] for method in tables.PAIR)
        ends = f"{tables.mm_at(plain, 0.4):.2g} to {tables.mm_at(plain, 2.0):.2g} mm"
        return f"{ends} ({tables.mm_at(default, 0.4):.2g} to {tables.mm_at(default, 2.0):.2g})"

    steps = {m: tables.typical_steps(curves[Case("aligned", "gaussian", m)]) for m in tables.PAIR}
    lost = {
        m: sum(int(c.diverged.sum()) for case, c in curves.items() if case.method == m) for m in tables.PAIR
    }
    near, far = REAL_M
    first = tables.first_lost(curves[Case("single", "gaussian03", "plain")])
    return (
        "The error grows with the distance of the cameras, and one camera is worst. With 0.2 px of noise the "
        "plain algorithm ends at (in brackets: the default) "
        f"{pair('aligned', 'gaussian')} with two cameras side by side, {pair('orthogonal', 'gaussian')} with "
        f"two 90 degrees apart, {pair('single', 'gaussian')} with one, from 0.4 to 2 m. At lambda 0.05 the "
        "plain algorithm averages the noise away as well as the default near by, and better far away (2 m, "
        f"90 degrees: median {_last('plain', curves):.2g} mm, {_last('default', curves):.2g}), but needs "
        f"{steps['plain']:.0f} steps to a tenth of the error where the default needs {steps['default']:.0f}; "
        f"and {lost['plain']} of its runs diverge, {lost['default']} of the default's. With one camera and "
        f"0.3 px the first run is lost at {first:g} m (thesis 0.6 m).\n\n"
        f"Table 5.8 with {REAL_NOISE_PX:g} px at 0.4 m, growing with the distance: {near:g} m "
        f"{_cell(real, 'plain', near):.4f} mm (thesis {tables.PRINTED_MM[0]}), {far:g} m "
        f"{_cell(real, 'plain', far):.4f} mm (thesis {tables.PRINTED_MM[1]}); the default "
        f"{_cell(real, 'default', near):.4f} and {_cell(real, 'default', far):.4f} mm.\n\n"
        "Not reproduced: that one camera converges slower (ours takes as many steps). The thesis prints "
        "neither its lens nor its poses nor the size of its exploratory motions: the size here was chosen "
        "so that divergence begins where the thesis says. With larger ones it begins farther away."
    )
