"""The sweep of thesis 5.2.1 in cells: all placements with one algorithm, tracker, Delta and lambda."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from itertools import groupby, product

import numpy as np

from vita.experiments import scene
from vita.experiments.cameras import READINGS
from vita.experiments.thesis_rotation import DELTAS_DEG, GAINS
from vita.experiments.trial import run
from vita.servo.estimators.base import Mask
from vita.types import Array

REACHED_PX = 10.0
"""The thesis' bound on the summed image error."""
TENTH = 0.1
SETTINGS = tuple(product(DELTAS_DEG, GAINS))

Key = tuple[str, str, str, int, float]
"""Goal, method, tracker, Delta [deg], lambda."""


@dataclass(frozen=True, eq=False)
class Cell:
    """One setting; arrays have one entry for each of the r placements."""

    goal: str
    """`near` or `far`."""
    method: str
    tracker: str
    delta_deg: int
    gain: float
    angle_deg: Array
    """(r,) placement of the cameras around the target [deg]."""
    first_px: Array
    """(r,) true image error at the start, summed over all coordinates [px]."""
    image_px: Array
    """(r,) final image error as the tracker reports it, summed over all coordinates [px]; so the thesis."""
    true_px: Array
    """(r,) the same without the tracker's noise or rounding [px]."""
    largest_px: Array
    """(r,) the largest component of the true one [px]."""
    distance_m: Array
    """(r,) final 3D error, summed over points and coordinates [m]."""
    steps: Array
    """(r,) steps until the image error was under 10 px; NaN for never."""
    steps_to_tenth: Array
    """(r,) steps until it was under a tenth of the first one; NaN for never."""
    condition: Array
    """(r,) condition number of the first Jacobian."""
    diverged: Mask
    """(r,) bool by the thesis' rule."""

    @property
    def key(self) -> Key:
        return self.goal, self.method, self.tracker, self.delta_deg, self.gain

    @property
    def reached(self) -> Mask:
        """(r,) bool: came under 10 px and did not diverge."""
        return np.isfinite(self.steps) & ~self.diverged

    @property
    def mean_image_px(self) -> float:
        return mean(self.image_px[~self.diverged])

    @property
    def mean_true_px(self) -> float:
        return mean(self.true_px[~self.diverged])

    @property
    def mean_distance_mm(self) -> float:
        return 1e3 * mean(self.distance_m[~self.diverged])

    @property
    def mean_steps(self) -> float:
        return mean(self.steps[self.reached])

    @property
    def mean_steps_to_tenth(self) -> float:
        return mean(self.steps_to_tenth[self.reached])


def mean(values: Array) -> float:
    """The mean; NaN of nothing."""
    return float(values.mean()) if values.size else float("nan")


def sweep(goal: str, method: str, tracker: str, angles_deg: Sequence[float], seed: int) -> list[Cell]:
    """The 20 cells of every Delta and lambda at some placements; a job of the experiment.

    All of them are run as one batch. Both methods get the same noise: their seeds do not depend on
    which of them it is.
    """
    angles = np.asarray(angles_deg, float)
    rigs = scene.stereo_rigs(np.radians(np.tile(angles, len(SETTINGS))), scene.target(goal))
    world = scene.world(rigs, goal, READINGS[tracker])
    delta, gain = np.repeat(np.array(SETTINGS, float), angles.size, axis=0).T
    noise = seed_of(seed, list(READINGS).index(tracker), int(angles[0]))
    runs = run(
        world, scene.method(method, world, noise),
        gain=gain, delta=np.radians(delta), steps=scene.STEPS, seed=noise,
    )  # fmt: skip
    results = (
        runs.error[:, 0],
        np.abs(world.measure(runs.q, np.random.default_rng([noise, scene.STEPS]))).sum(-1),
        runs.error[:, -1],
        np.abs(world.features(runs.q) - world.features(world.goal)).max(-1),
        runs.distance[:, -1],
        runs.steps_to(REACHED_PX),
        runs.steps_to(TENTH * runs.error[:, 0]),
        runs.condition,
        runs.diverged,
    )
    parts = zip(*(np.split(values, len(SETTINGS)) for values in results), strict=True)
    return [
        Cell(goal, method, tracker, *setting, angles, *part)
        for setting, part in zip(SETTINGS, parts, strict=True)
    ]


def seed_of(*numbers: int) -> int:
    """One seed from several numbers, so that neighbours share nothing."""
    return int(np.random.SeedSequence(numbers).generate_state(1)[0])


def joined(cells: Iterable[Cell]) -> dict[Key, Cell]:
    """The cells by their setting, with the placements of all jobs together in their order."""
    by_key = sorted(cells, key=lambda cell: (cell.key, cell.angle_deg[0]))
    return {key: _together(list(same)) for key, same in groupby(by_key, key=lambda cell: cell.key)}


def _together(same: list[Cell]) -> Cell:
    arrays = [f.name for f in fields(Cell)][len(same[0].key) :]
    return Cell(*same[0].key, *(np.concatenate([getattr(c, name) for c in same]) for name in arrays))
