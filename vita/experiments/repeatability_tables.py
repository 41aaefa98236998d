"""Tables of the repeatability experiment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vita.experiments.base import Table
from vita.experiments.repeatability_arm import SMALL_SHARE
from vita.experiments.repeatability_jobs import Biased, Doubled, Measured, Residual
from vita.experiments.repeatability_setups import FOCAL_PX, setup_of

MM = 1e3


def mean_mm(values: Any) -> float:
    """Mean of `values` [m] in millimetres."""
    return float(MM * np.mean(values))


def main_table(main: Sequence[Measured]) -> Table:
    rows = []
    for m in main:
        s = setup_of(m.key)
        plain, default = m.servo["plain"], m.servo["default"]
        rows.append((
            s.title, s.table, s.reported_mm, mean_mm(m.reported), s.commanded_mm, mean_mm(m.commanded),
            s.servo_mm, mean_mm(plain.still), mean_mm(plain.final), mean_mm(default.final),
        ))  # fmt: skip
    return Table(
        "Mean error of the tool [mm]: the thesis' tables 5.4 to 5.7 beside ours",
        ("set-up", "table", "reported pose, thesis", "ours", "commanded pose, thesis", "ours",
         "servoing, thesis", "plain", "plain, lambda doubled at the end", "default"),
        rows,
        f"{len(main[0].servo['plain'].final)} trials of servoing, the thesis 10. Errors are what a dial "
        "shows, in one direction at a time: the mean over three directions. The joint errors of the "
        "simulated arm are set so that joint control comes out as in the thesis, and checked on "
        f"{len(main[0].reported)} trials with other random numbers. Cameras: 640 x 480 pixels, "
        f"focal length {FOCAL_PX:g} px; trackers with {main[0].noise_px:g} px of noise. In at least "
        f"{100 * min(m.servo['default'].in_view for m in main):.0f} % of the poses at the start and in "
        "exploring, all points are inside all images.",
    )  # fmt: skip


def spread_table(main: Sequence[Measured]) -> Table:
    rows = []
    for m in main:
        for name, ends in m.servo.items():
            rows.append((
                setup_of(m.key).title, name, mean_mm(ends.final), float(MM * ends.final.std()),
                float(MM * np.quantile(ends.final, 0.95)), mean_mm(ends.space),
                float(ends.image.mean()), float(np.median(ends.periods)),
            ))  # fmt: skip
    return Table(
        "Visual servoing in detail",
        ("set-up", "algorithm", "mean [mm]", "standard deviation [mm]", "95th percentile [mm]",
         "mean distance in space [mm]", "largest image error, mean [px]", "periods until still, median"),
        rows,
        "The thesis prints standard deviations and variances that do not agree with one another, so "
        "that only its means are compared. Plain runs all of its periods: noise keeps it moving.",
    )  # fmt: skip


def arm_table(main: Sequence[Measured]) -> Table:
    rows = [
        (setup_of(m.key).title, m.joints.stop_rad * MM, m.joints.offset_rad * MM, m.joints.dead_band_rad * MM)
        for m in main
    ]
    return Table(
        "The simulated arm's joints, as calibrated [mrad]",
        ("set-up", "stop error after 3 degrees (deviation)", "offset of commanded poses", "dead band"),
        rows,
        f"Found by a search at run time. The stop error of a tiny move is {SMALL_SHARE:g} of that of a move "
        "of 3 degrees, an assumption: the thesis could not have come to 0.036 mm by one more small step "
        "if small steps were as inexact as large ones.",
    )


def noise_table(measured: Sequence[Measured]) -> Table:
    rows = [
        (setup_of(m.key).title, m.noise_px, *(mean_mm(m.servo[name].final) for name in ("plain", "default")))
        for m in measured
    ]
    return Table(
        "Mean error [mm] with worse trackers",
        ("set-up", "noise [px]", "plain, lambda doubled at the end", "default"),
        rows,
        "The thesis measured 0.03 to 0.43 px on real objects.",
    )


def residual_table(residuals: Sequence[Residual]) -> Table:
    rows = [
        (gain, 1.0 / gain, *(r.largest for name in ("plain", "default") for r in residuals
                             if (r.method, r.gain) == (name, gain)))
        for gain in dict.fromkeys(r.gain for r in residuals)
    ]  # fmt: skip
    return Table(
        "Largest residual of one joint with a dead band alone, in units of the dead band TOL",
        ("lambda", "TOL / lambda (thesis 5.1.3)", "plain", "default"),
        rows,
        "Perfect trackers, no stop error. The default raises lambda to 1 when the arm stands still.",
    )


def doubled_table(twice: Sequence[Doubled]) -> Table:
    rows = [
        (setup_of(d.key).title, d.noise_px, d.dead_band_rad * MM, d.before * MM, d.after * MM,
         (d.before - d.after) * MM, d.default * MM)
        for d in twice
    ]  # fmt: skip
    return Table(
        "Twice the lambda for the last four steps (thesis 5.2.3: better by about 0.1 to 0.2 mm)",
        ("set-up", "noise [px]", "dead band [mrad]", "plain before [mm]", "after [mm]", "gain [mm]",
         "default [mm]"),
        rows,
    )  # fmt: skip


def biased_table(off: Biased) -> Table:
    rows = [("joint control", off.joint_control * MM, None)]
    rows += [(name, off.tool[name] * MM, off.image[name]) for name in off.tool]
    return Table(
        "4 joints: encoders off by 1 degree and the tool pushed aside by 1 mm after the goal was taken",
        ("control", "mean error of the tool [mm]", "largest image error of all trials [px]"),
        rows,
    )


def trials(measured: Sequence[Measured]) -> Table:
    rows = [
        (m.key, m.noise_px, name, i, ends.still[i] * MM, ends.final[i] * MM, ends.space[i] * MM,
         ends.image[i], int(ends.periods[i]))
        for m in measured
        for name, ends in m.servo.items()
        for i in range(len(ends.final))
    ]  # fmt: skip
    columns = (
        "setup", "noise_px", "algorithm", "trial", "still_mm", "final_mm", "space_mm", "image_px", "periods"
    )  # fmt: skip
    return Table("Every trial of visual servoing", columns, rows)
