"""The side-by-side experiment's runs, by what is wrong and by method."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vita.experiments.side_by_side_methods import METHODS
from vita.experiments.side_by_side_runs import Reach
from vita.experiments.side_by_side_tasks import TROUBLES, Trouble

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
        chosen += [TIED]
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
