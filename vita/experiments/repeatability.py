"""Repeatability (thesis 5.2.3): going back to a pose by the joints, or by what the cameras see."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

from vita.experiments import repeatability_charts as charts
from vita.experiments import repeatability_tables as tables
from vita.experiments.base import Check, Experiment, Job, Report, register
from vita.experiments.repeatability_arm import DEAD_BAND_RAD
from vita.experiments.repeatability_jobs import (
    NOISE_PX,
    Biased,
    Doubled,
    Measured,
    Residual,
    biased,
    dead_band,
    doubled,
    measure,
)
from vita.experiments.repeatability_setups import setup_of, setups

NOISES_PX = (NOISE_PX, 0.1, 0.2, 0.43)
"""Up to the worst that the thesis measured; the thesis' figures are compared at the first."""
QUICK_NOISES_PX = (NOISE_PX, 0.2)
GAINS = (0.25, 0.5, 0.75, 1.0)
CASES = (("one", 0.0), ("four", 0.0), ("one", NOISE_PX), ("four", NOISE_PX))
BANDS_RAD = (DEAD_BAND_RAD, 2.0 * DEAD_BAND_RAD)
MM = 1e3


@register
class Repeatability(Experiment):
    name = "repeatability"
    title = "Repeatability: joint control against visual servoing"
    doc = "How well does the arm return to a pose by its joints, and by its cameras? Tables 5.4 to 5.7."

    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        trials = 100 if quick else 400
        keys = [setup.key for setup in setups()]
        jobs = [
            Job(
                f"{key}, {noise} px", measure,
                {"key": key, "noise_px": noise, "trials": trials, "seed": seed},
            )
            for noise, key in product(QUICK_NOISES_PX if quick else NOISES_PX, keys)
        ]  # fmt: skip
        jobs.append(Job("dead band", dead_band, {"gains": GAINS, "trials": 1000, "seed": seed}))
        jobs += [
            Job(
                f"doubled gain, {key}", doubled,
                {"key": key, "noise_px": noise, "dead_band_rad": band, "trials": trials, "seed": seed},
            )
            for (key, noise), band in product(CASES, BANDS_RAD)
        ]  # fmt: skip
        jobs.append(Job("bias and push", biased, {"trials": trials, "seed": seed}))
        return jobs

    def report(self, jobs: Sequence[Job], results: Sequence[Any], quick: bool) -> Report:
        del jobs, quick
        measured = [r for r in results if isinstance(r, Measured)]
        main = [m for m in measured if m.noise_px == NOISE_PX]
        residuals = next(r for r in results if isinstance(r, list))
        twice = [r for r in results if isinstance(r, Doubled)]
        off = next(r for r in results if isinstance(r, Biased))
        found = [
            tables.main_table(main), tables.spread_table(main), tables.arm_table(main),
            tables.noise_table(measured), tables.residual_table(residuals),
            tables.doubled_table(twice), tables.biased_table(off),
        ]  # fmt: skip
        figures = {
            "repeatability": charts.comparison(main),
            "dead_band_and_noise": charts.laws(residuals, measured),
        }
        return Report(
            _summary(main, twice, off), found, {"trials": tables.trials(measured)}, figures,
            _checks(main, residuals, twice, off),
        )  # fmt: skip


def _checks(
    main: Sequence[Measured], residuals: Sequence[Residual], twice: Sequence[Doubled], off: Biased
) -> list[Check]:
    checks = []
    for m in main:
        s = setup_of(m.key)
        for kind, ours, thesis in (
            ("reported", m.reported, s.reported_mm), ("commanded", m.commanded, s.commanded_mm),
        ):  # fmt: skip
            what = f"{s.title}: joint control to the {kind} pose [mm]"
            checks.append(Check(what, tables.mean_mm(ours), 0.9 * thesis, 1.1 * thesis))
        what = f"{s.title}: default, mean error [mm]"
        checks.append(Check(what, tables.mean_mm(m.servo["default"].final), most=s.servo_mm))
    spread = {m.key: float(m.servo["default"].final.std()) for m in main}
    checks.append(
        Check("eye-in-hand: spread of mono over spread of stereo", spread["mono"] / spread["stereo"], least=1)
    )
    law = {r.gain: r.largest for r in residuals if r.method == "plain"}
    checks.append(Check("residual at lambda 0.25 over that at 1", law[0.25] / law[1.0], least=3, most=5))
    best = max((d.before - d.after) * MM for d in twice)
    checks.append(Check("doubled lambda: largest improvement [mm]", best, least=0.1))
    checks.append(Check("bias and push: image error of the default [px]", off.image["default"], most=1.0))
    return checks


def _summary(main: Sequence[Measured], twice: Sequence[Doubled], off: Biased) -> str:
    def listed(name: str) -> str:
        return ", ".join(f"{tables.mean_mm(m.servo[name].final):.3f}" for m in main)

    thesis = ", ".join(f"{setup_of(m.key).servo_mm:.3f}" for m in main)
    titles = "; ".join(setup_of(m.key).title for m in main)
    gains = {(d.key, d.noise_px, d.dead_band_rad): (d.before - d.after) * MM for d in twice}
    one, four = gains["one", 0.0, BANDS_RAD[0]], gains["four", 0.0, BANDS_RAD[0]]
    wide = gains["four", 0.0, BANDS_RAD[1]]
    return (
        f"Mean error of the tool with visual servoing [mm] ({titles}): thesis {thesis}; its algorithm with "
        f"lambda doubled at the end {listed('plain')}; the default {listed('default')}. The arm's joint "
        "errors are those that give the thesis' joint-control figures. A dead band leaves TOL / lambda with "
        "the plain algorithm and TOL with the default, which raises lambda when the arm stands still. "
        f"After 1 degree of bias and a push of 1 mm joint control is off by {off.joint_control * MM:.1f} mm, "
        f"the default by {off.tool['default'] * MM:.3f} mm.\n\n"
        f"Doubling lambda makes the plain algorithm better by {one:.2f} mm (1 joint) and {four:.2f} mm (4 "
        f"joints); the thesis tells of 0.1 to 0.2 mm, which 4 joints have at twice the dead band ({wide:.2f} "
        "mm). With noise the plain arm creeps across its dead band, and there is less to gain.\n\n"
        "Not reproduced: the thesis' 0.093 mm with 7 joints, which it blames on an arm that gives way; ours "
        "is rigid. Poses, the tracked points and the lens are ours, and so is the share of the stop error "
        "that small moves have; the thesis prints none of them."
    )
