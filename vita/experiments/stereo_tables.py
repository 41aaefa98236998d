"""The tables of the stereo experiment."""

from __future__ import annotations

import numpy as np

from vita.experiments.base import Table
from vita.experiments.stereo_cases import CASES
from vita.experiments.stereo_found import Found


def situations(found: Found) -> Table:
    rows = []
    for (robot, name), run in found.runs.items():
        case = CASES[name]
        clear = run.clearance[np.isfinite(run.clearance)]
        rows.append(
            (
                case.doc, robot, run.rms_mm(case.from_s), run.bias_mm(case.from_s), run.rms_deg(case.from_s),
                float(np.nanmedian(run.recovered_mm[run.since(run.stamp[-1] - 3.0)])),
                1e3 * float(clear.min()) if clear.size else None, 1e3 * float(run.height.min()),
                float(np.degrees(run.bend.min())),
            )
        )  # fmt: skip
    columns = (
        "situation", "robot", "off [mm rms]", "mean offset [mm]", "angle [deg rms]",
        "recovered tool off [mm]", "nearest obstacle [mm]", "lowest point [mm]", "least bend [deg]",
    )  # fmt: skip
    notes = (
        "Errors count once the arm has learned, or once the disturbance is over. Where the target is carried "
        "to where the arm must not go, the distance from it is meant to be large."
    )
    return Table("Situations", columns, rows, notes)


def fitted(found: Found) -> Table:
    rows = [
        (n, *np.percentile(f[:, 0], [50, 95]), *np.percentile(f[:, 1], [50, 95]), np.median(f[:, 2]))
        for n, f in sorted(found.fits.items())
    ]
    columns = (
        "pairs", "rotation off [deg], median", "95 %", "recovered point off [mm], median", "95 %",
        "eq. 11 as printed [deg], median",
    )  # fmt: skip
    return Table("Fit of pairs spread over 20 cm, 1 mm of noise", columns, rows)


def filtering(found: Found) -> Table:
    rows = [(v, w, ours, held, ours / held) for (v, w), (ours, held) in sorted(found.filter.items())]
    columns = ("speed [m/s]", "turning [deg/s]", "filter [mm]", "last measurement held [mm]", "ratio")
    notes = "Root mean square over steps of 1 ms; pictures every 33 ms, corner noise 0.3 px, 1 m away."
    return Table("Filter alone", columns, rows, notes)


def moved(found: Found) -> Table:
    rows = [
        (1e3 * shift, 100 * result["within_1_s"], result["median_s"], pictures or None, result["alarms"])
        for (shift, pictures), result in sorted(found.moved.items())
    ]
    columns = (
        "moved by [mm]", "noticed within 1 s [%]", "median [s]", "pictures of cameras that stand",
        "false alarms",
    )
    notes = "The watch alone, on the offsets that a marker 1.2 m away gives: 0.3, 0.3 and 1.5 mm of noise."
    return Table("Moved cameras", columns, rows, notes)


def obstacles(found: Found) -> Table:
    nearest = 1e3 * np.array([c.nearest_m for c in found.crossings])
    after = np.array([c.after_mm for c in found.crossings])
    rows = [(len(nearest), nearest.min(), np.percentile(nearest, 5), np.median(nearest), after.max())]
    columns = (
        "spheres", "smallest distance [mm]", "5 %", "median",
        "worst distance from the goal afterwards [mm rms]",
    )
    notes = "Radius 6 to 12 cm, 0.1 to 0.25 m/s, through the space of tool and forearm."
    return Table("Random moving obstacles", columns, rows, notes)


def every_sphere(found: Found) -> Table:
    rows = [(c.seed, c.robot, c.radius_m, c.speed_m_s, c.nearest_m, c.after_mm) for c in found.crossings]
    return Table("Every sphere", ("seed", "robot", "radius_m", "speed_m_s", "nearest_m", "after_mm"), rows)


def every_tenth(found: Found) -> Table:
    rows = [
        (
            run.robot, run.case, float(run.stamp[i]), run.phase[i], *run.tool[i].tolist(),
            *run.recovered[i].tolist(), *run.target[i].tolist(),
            1e3 * float(np.linalg.norm(run.gap[i])), float(np.degrees(run.angle[i])),
        )
        for run in found.runs.values()
        for i in range(0, run.stamp.size, 3)
    ]  # fmt: skip
    columns = (
        "robot", "case", "time_s", "phase", "tool_x", "tool_y", "tool_z", "recovered_x", "recovered_y",
        "recovered_z", "target_x", "target_y", "target_z", "off_mm", "off_deg",
    )  # fmt: skip
    return Table("Every tenth of a second", columns, rows)
