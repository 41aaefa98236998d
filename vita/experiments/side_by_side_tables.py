"""What the side-by-side experiment says: its table, who wins, and a summary in words."""

from __future__ import annotations

import numpy as np

from vita.experiments.base import Table
from vita.experiments.side_by_side_found import (
    BLIND,
    CARRIED,
    EYE,
    FOCAL,
    GIVEN,
    GIVEN_TAUGHT,
    LEARNING,
    MOVED,
    PATIENT,
    SPHERE,
    TAUGHT,
    TIED,
    UVS,
    Found,
)  # fmt: skip
from vita.experiments.side_by_side_methods import SHOWN
from vita.experiments.side_by_side_runs import LAST_S, NEAR_DEG, NEAR_MM
from vita.experiments.stereo_runs import SIGMA_PX


def main_table(found: Found) -> Table:
    """One row for every method with every trouble."""
    rows = []
    for (trouble, method), cell in found.cells.items():
        clear = min(run.clearance_mm for run in cell)
        rows.append(
            (
                trouble, method, found.share(trouble, method), found.median(trouble, method, "mm"),
                found.median(trouble, method, "deg"), _finite(found.median(trouble, method, "time_s")),
                found.median(trouble, method, "learned_s"), found.median(trouble, method, "way"),
                _finite(clear),
            )
        )  # fmt: skip
        if trouble == CARRIED and method == TIED:
            rows.append((trouble, UVS, "cannot", *[None] * 6))
    columns = (
        "what is wrong", "method", "share that arrive", "off [mm]", "off [deg]", "within 5 mm after [s]",
        "of which learning [s]", "way / straight", "nearest to the sphere [mm]",
    )  # fmt: skip
    count = len(found.cells["none", UVS])
    notes = (
        f"{count} random tasks; medians, but for the smallest distance to the sphere. Arrived: within "
        f"{NEAR_MM:g} mm and {NEAR_DEG:g} degrees by the simulation's truth where the method itself says "
        f"that it is done (a goal that moves: rms of the last {LAST_S:g} s), and without having touched "
        f"the sphere. Corners have {SIGMA_PX:g} px of noise; what is taught by showing is the mean of "
        f"{SHOWN} pictures, the same for all methods. `uvs` brings the corners of the tool's marker to "
        "where they were shown; its defaults are content with 0.5 px. `tied` shifts these corners with "
        "the target's marker in each picture, with `moving_goal` where the goal moves; corners that were "
        "shown once cannot move by themselves. (On a goal that stands its noise alone makes it differ: it "
        "stops later, and so nearer.) `drawn`: where the tool belongs beside the target is from "
        "the drawing; `taught`: measured by the cameras as they are believed to be. `calibrated`: the "
        "place of the cameras is given, right or as wrong as the row says (turned about the left camera), "
        "and never doubted, but the tool is still looked at; `tool unseen`: the tool's place is that of "
        "the joints alone, which is the classic form. `learning` takes no hand-eye, UVS neither that nor "
        "a focal length: such rows repeat those above, but for the default UVS, which is run to check "
        "that. The way counts from the end of the first learning. The goal sets out, and the cameras move "
        "when the tool is half way, once the arm has learned. The sphere hides no marker and does not "
        "stop the arm. It repels from 10 cm on, instead of 20, because the goals are "
        "that near to it."
    )
    return Table("Side by side", columns, rows, notes)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def winners(found: Found) -> Table:
    """Who wins, and how the two that need no calibration do."""
    rows = []
    for trouble in dict.fromkeys(trouble for trouble, _ in found.cells):
        order = found.best(trouble)
        first = found.share(trouble, order[0])
        uvs = next(m for m in order if m.startswith("uvs"))
        learning = next(m for m in order if m in (LEARNING, TAUGHT))
        words = [order[0] if first > 0.0 else "nobody"]
        for method in (uvs, learning):
            mm = found.median(trouble, method, "mm")
            words.append(f"{method}: {found.share(trouble, method):.0%}, {mm:.1f} mm")
        rows.append((trouble, *words))
    columns = ("what is wrong", "wins", "best of UVS", "best that learns its calibration")
    notes = "The one of which most arrive wins; where as many do, the one that is within 5 mm sooner."
    return Table("Which wins, when", columns, rows, notes)


def summary(found: Found) -> str:
    """Who wins when, and why."""
    def share(trouble: str, method: str) -> str:
        return f"{found.share(trouble, method):.0%}"

    def off(trouble: str, method: str) -> str:
        mm, deg = (found.median(trouble, method, what) for what in ("mm", "deg"))
        return f"{mm:.1f} mm and {deg:.1f} degrees"

    def after(trouble: str, method: str) -> str:
        time_s = found.median(trouble, method, "time_s")
        return f"{time_s:.1f} s" if np.isfinite(time_s) else "never within 5 mm"

    ball_uvs, ball_us = (min(run.clearance_mm for run in found.cells[SPHERE, m]) for m in (UVS, LEARNING))
    wins = {trouble: found.best(trouble)[0] for trouble, _ in found.cells}
    return (
        f"**Nothing wrong**: `{wins['none']}` wins. Calibrated stereo has nothing to learn "
        f"({share('none', GIVEN)} arrive, {after('none', GIVEN)}); of those that learn, stereo brings "
        f"{share('none', LEARNING)} home ({after('none', LEARNING)}), UVS {share('none', UVS)} with its "
        f"default of 0.5 px and {share('none', PATIENT)} with 0.3 px ({after('none', PATIENT)}): at this "
        "distance half a pixel is a few millimetres and degrees. **Focal length 10 % off**: "
        f"`{wins[FOCAL]}` wins. The classic form, which does not look at the tool, ends "
        f"{off(FOCAL, BLIND)} off; looking at the tool saves it ({off(FOCAL, GIVEN)} by the drawing, "
        f"{off(FOCAL, GIVEN_TAUGHT)} taught: what is taught through the same wrong cameras is wrong in the "
        f"same way, and most of it cancels). Learning stereo ends {off(FOCAL, LEARNING)} off drawn and "
        f"{off(FOCAL, TAUGHT)} taught, but takes {after(FOCAL, TAUGHT)} and "
        f"{found.median(FOCAL, TAUGHT, 'way'):.1f} times the straight way: what it learned with a wrong "
        "scale fits only near where it learned it, so it takes its cameras for moved and learns again. "
        "UVS is not touched, to the bit, by any camera parameter, and is sooner there "
        f"({after(FOCAL, PATIENT)} with 0.3 px). **Hand-eye 5 degrees off**: `{wins[EYE]}` wins. A given "
        f"calibration leaves the tool turned by that much ({off(EYE, GIVEN)}; {off(EYE, BLIND)} if the "
        "tool is not looked at), and teaching through the cameras does not help "
        f"({off(EYE, GIVEN_TAUGHT)}), since it is the arm's side that is wrong. Learning stereo and UVS "
        f"need no hand-eye. **Cameras moved on the way**: `{wins[MOVED]}` wins: {share(MOVED, LEARNING)} "
        f"of learning stereo, {share(MOVED, GIVEN)} of calibrated, {share(MOVED, UVS)} of UVS, whose shown "
        f"corners then mean another place ({share(MOVED, TIED)} tied to the target). **Sphere in the "
        f"way**: `{wins[SPHERE]}` wins. UVS knows of no obstacle and comes to {ball_uvs:.0f} mm of it "
        f"(below 0 is through it), learning stereo to {ball_us:.0f} mm. **Goal that moves**: "
        f"`{wins[CARRIED]}` wins; learning stereo keeps to {off(CARRIED, LEARNING)}, UVS tied to the "
        f"target's marker to {off(CARRIED, TIED)}. So UVS is for cameras of which nothing is known, not "
        "even the focal length, for a goal that can be shown and stands still, and for a free way; "
        "learning stereo for all else; and a calibration given beforehand is the quickest, as long as it "
        "is right."
    )
