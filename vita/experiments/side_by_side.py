"""The same reach by both modes of vita, with calibration errors injected: which wins, when."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vita.experiments.base import Check, Experiment, Job, Report, Table, register
from vita.experiments.side_by_side_charts import distances, ways
from vita.experiments.side_by_side_methods import METHODS, SHOWN
from vita.experiments.side_by_side_runs import LAST_S, NEAR_DEG, NEAR_MM, Reach, reaches
from vita.experiments.side_by_side_tasks import TROUBLES, Trouble
from vita.experiments.stereo_runs import SIGMA_PX

ROBOTS, TASKS = ("tx90", "wam7"), 3
UVS, PATIENT, TIED = "uvs", "uvs, to 0.3 px", "uvs, goal tied to the target"
LEARNING, TAUGHT = "stereo, learning, drawn", "stereo, learning, taught"
GIVEN, GIVEN_TAUGHT = "stereo, calibrated, drawn", "stereo, calibrated, taught"
BLIND = "stereo, calibrated, tool unseen"
FOCAL, EYE, BOTH, MOVED, SPHERE, CARRIED = list(TROUBLES)[1:]


def methods_at(trouble: Trouble) -> list[str]:
    """The methods that are run with this trouble."""
    if trouble.carried:
        return [TIED, LEARNING, GIVEN]  # Corners that were shown stand still: there is nothing to run.
    chosen = [UVS, LEARNING, GIVEN]
    if trouble.moved:
        chosen += [TIED, BLIND]
    elif trouble.sphere:
        chosen += [PATIENT]
    else:
        # Teaching, and looking at the tool, matter where the cameras are not what they are taken for.
        chosen += [PATIENT, TIED, TAUGHT, GIVEN_TAUGHT, BLIND]
    return [m for m in METHODS if m in chosen and source(m, trouble) == trouble.name]


def source(method: str, trouble: Trouble) -> str:
    """The trouble whose runs tell of this one. A method that is not given what is wrong would do the same
    again: only the default UVS is run all the same, to check that it is so."""
    uses = METHODS[method].uses
    focal = trouble.focal != 1.0 and ("focal" in uses or method == UVS)
    hand_eye = trouble.hand_eye_deg != 0.0 and ("hand-eye" in uses or method == UVS)
    if trouble.focal == 1.0 and trouble.hand_eye_deg == 0.0:
        return trouble.name
    same = (t.name for t in TROUBLES.values() if (t.focal != 1.0, t.hand_eye_deg != 0.0) == (focal, hand_eye))
    return next(same)


@register
class SideBySide(Experiment):
    name = "side-by-side"
    title = "Side by side: image-based without calibration, and stereo impedance"
    doc = (
        "The same reach by UVS and by the stereo-impedance mode, with a wrong focal length, a wrong "
        "hand-eye, moved cameras, an obstacle, a goal that moves: which wins, when?"
    )

    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        tasks = [(ROBOTS[0], seed)] if quick else [(r, seed + i) for i in range(TASKS) for r in ROBOTS]
        troubles = {n: t for n, t in TROUBLES.items() if not (quick and n == BOTH)}
        return [
            Job(
                f"{name}, {robot} {number}", reaches,
                {"robot": robot, "seed": number, "trouble": name, "methods": tuple(methods_at(trouble))},
            )
            for robot, number in tasks
            for name, trouble in troubles.items()
        ]  # fmt: skip

    def report(self, jobs: Sequence[Job], results: Sequence[Any], quick: bool) -> Report:
        found = Found([reach for result in results for reach in result])
        tables = [_table(found), _winners(found)]
        figures = {"distances": distances(found.cells, NEAR_MM), "ways": ways(found.cells)}
        return Report(_summary(found), tables, {"runs": _data(found)}, figures, checks(found))


class Found:
    """The runs by trouble and method."""

    def __init__(self, runs: Sequence[Reach]) -> None:
        self.runs = runs
        self.cells: dict[tuple[str, str], list[Reach]] = {}
        for trouble in TROUBLES.values():
            for method in METHODS:
                wanted = (method, source(method, trouble))
                cell = [run for run in runs if (run.method, run.trouble) == wanted]
                # In a quick run some troubles are left out altogether.
                if cell and any(run.trouble == trouble.name for run in runs):
                    self.cells[trouble.name, method] = cell

    def share(self, trouble: str, method: str) -> float:
        return float(np.mean([run.arrived for run in self.cells[trouble, method]]))

    def median(self, trouble: str, method: str, what: str) -> float:
        return float(np.median([getattr(run, what) for run in self.cells[trouble, method]]))

    def worst(self, trouble: str, method: str, what: str = "mm") -> float:
        return float(max(getattr(run, what) for run in self.cells[trouble, method]))

    def best(self, trouble: str) -> list[str]:
        """The methods from the best on: most arrive, then soonest, then nearest."""

        def rank(method: str) -> tuple[float, ...]:
            share = self.share(trouble, method)
            # Where hardly any arrive, it does not matter how fast those are.
            time_s = self.median(trouble, method, "time_s") if share >= 0.5 else np.inf
            return -share, time_s, self.median(trouble, method, "mm")

        return sorted((m for t, m in self.cells if t == trouble), key=rank)


def told(found: Found) -> float:
    """Largest difference that a wrong focal length and hand-eye make to a run of UVS [m]."""
    right = {(run.robot, run.seed): run.tool for run in found.cells["none", UVS]}
    wrong = [run for name in (FOCAL, EYE, BOTH) for run in found.cells.get((name, UVS), ())]
    pairs = [(run.tool, right[run.robot, run.seed]) for run in wrong]
    return max(np.inf if a.shape != b.shape else float(np.abs(a - b).max()) for a, b in pairs)


def checks(found: Found) -> list[Check]:
    """What must hold, whoever wins."""
    runs = found.runs
    sphere = [run.clearance_mm for (t, m), cell in found.cells.items() for run in cell
              if t == SPHERE and "stereo" in m]  # fmt: skip
    return [
        Check("any joint, beyond its limits at most [rad]", max(r.beyond_rad for r in runs), most=0.0),
        Check("fastest joint, relative to its limit", max(r.speed for r in runs), most=1.0 + 1e-6),
        Check("what wrong camera parameters change in a run of UVS [m]", told(found), 0.0, 0.0),
        Check("learning, right focal length, whatever the hand-eye: worst distance at the end [mm]",
              max(found.worst(EYE, m) for m in (LEARNING, TAUGHT)), most=5.0),
        Check("learning, cameras moved on the way: worst distance at the end [mm]",
              found.worst(MOVED, LEARNING), most=5.0),
        Check("learning, goal that moves: worst distance, rms [mm]",
              found.worst(CARRIED, LEARNING), most=5.0),
        Check("stereo, sphere in the way: smallest distance to the arm [mm]", min(sphere), least=1e-3),
    ]  # fmt: skip


def _table(found: Found) -> Table:
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
        "shown once cannot move by themselves. `drawn`: where the tool belongs beside the target is from "
        "the drawing; `taught`: measured by the cameras as they are believed to be. `calibrated`: the "
        "place of the cameras is given, right or as wrong as the row says (turned about the left camera), "
        "and never doubted, but the tool is still looked at; `tool unseen`: the tool's place is that of "
        "the joints alone, which is the classic form. `learning` takes no hand-eye, UVS neither that nor "
        "a focal length: such rows repeat those above, but for the default UVS, which is run to check "
        "that. The way counts from the end of the first learning. The goal sets out, and the cameras move "
        "when the tool is half way, once the arm has learned. Nothing hides behind the sphere and nobody "
        "feels being touched by the arm. It repels from 10 cm on, instead of 20, because the goals are "
        "that near to it."
    )
    return Table("Side by side", columns, rows, notes)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _winners(found: Found) -> Table:
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


def _summary(found: Found) -> str:
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
        f"**Nothing wrong**: `{wins['none']}` wins. Calibrated stereo has nothing to learn ({share('none', GIVEN)} "
        f"arrive, {after('none', GIVEN)}); of those that learn, stereo brings {share('none', LEARNING)} home "
        f"({after('none', LEARNING)}), UVS {share('none', UVS)} with its default of 0.5 px and "
        f"{share('none', PATIENT)} with 0.3 px ({after('none', PATIENT)}): at this distance half a pixel is a "
        f"few millimetres and degrees. **Focal length 10 % off**: `{wins[FOCAL]}` wins. The classic form, which "
        f"does not look at the tool, ends {off(FOCAL, BLIND)} off; looking at the tool saves it "
        f"({off(FOCAL, GIVEN)} by the drawing, {off(FOCAL, GIVEN_TAUGHT)} taught: what is taught through the "
        f"same wrong cameras is wrong in the same way, and most of it cancels). Learning stereo ends "
        f"{off(FOCAL, LEARNING)} off drawn and {off(FOCAL, TAUGHT)} taught, but takes {after(FOCAL, TAUGHT)} and "
        f"{found.median(FOCAL, TAUGHT, 'way'):.1f} times the straight way: what it learned with a wrong scale "
        f"fits only near where it learned it, so it takes its cameras for moved and learns again. UVS is not "
        f"touched, to the bit, by any camera parameter, and is sooner there ({after(FOCAL, PATIENT)} with 0.3 "
        f"px). **Hand-eye 5 degrees off**: `{wins[EYE]}` wins. A given calibration leaves the tool turned by "
        f"that much ({off(EYE, GIVEN)}; {off(EYE, BLIND)} if the tool is not looked at), and teaching through "
        f"the cameras does not help ({off(EYE, GIVEN_TAUGHT)}), since it is the arm's side that is wrong. "
        f"Learning stereo and UVS need no hand-eye. **Cameras moved on the way**: `{wins[MOVED]}` wins: "
        f"{share(MOVED, LEARNING)} of learning stereo, {share(MOVED, GIVEN)} of calibrated, {share(MOVED, UVS)} "
        f"of UVS, whose shown corners then mean another place ({share(MOVED, TIED)} tied to the target). "
        f"**Sphere in the way**: `{wins[SPHERE]}` wins. UVS knows of no obstacle and comes to {ball_uvs:.0f} mm "
        f"of it (below 0 is through it), learning stereo to {ball_us:.0f} mm. **Goal that moves**: "
        f"`{wins[CARRIED]}` wins; learning stereo keeps to {off(CARRIED, LEARNING)}, UVS tied to the target's "
        f"marker to {off(CARRIED, TIED)}. So UVS is for cameras of which nothing is known, not even the focal "
        f"length, for a goal that can be shown and stands still, and for a free way; learning stereo for all "
        f"else; and a calibration given beforehand is the quickest, as long as it is right."
    )


def _data(found: Found) -> Table:
    rows = [
        (
            run.trouble, run.method, run.robot, run.seed, run.arrived, run.mm, run.deg, run.time_s,
            run.learned_s, run.way, run.clearance_mm, run.beyond_rad, run.speed, run.reason,
        )
        for run in found.runs
    ]  # fmt: skip
    columns = (
        "trouble", "method", "robot", "seed", "arrived", "off_mm", "off_deg", "within_5_mm_s", "learned_s",
        "way", "clearance_mm", "beyond_rad", "speed", "reason",
    )  # fmt: skip
    return Table("Every run", columns, rows)
