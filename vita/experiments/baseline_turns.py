"""The sweep of thesis 5.2.2: one camera turns about the target, the other one stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vita.experiments import scene
from vita.experiments.cameras import READINGS
from vita.experiments.rotation_cells import REACHED_PX, seed_of
from vita.experiments.trial import World, run
from vita.servo.estimators.base import Mask
from vita.types import Array

FIRST_DEG = tuple(range(0, 360, 60))
"""Where the camera that stays may stand. The thesis has one place; what holds at six is no accident."""
DELTA_DEG, GAIN = 6.0, 0.5
"""As the text of 5.2.2 has it; the figure's caption says 8 degrees."""
CONDITIONS = ("condition", "goal_condition", "view_condition")
FIELDS = (*CONDITIONS, "steps", "distance_mm", "image_px", "diverged")


@dataclass(frozen=True, eq=False)
class Turn:
    """One method and tracker: arrays (first camera's places, angles between the cameras)."""

    method: str
    tracker: str
    angle_deg: Array
    """(a,) angle between the cameras as seen from the target [deg]."""
    condition: Array
    """Condition number of the first Jacobian, measured at the start."""
    goal_condition: Array
    """Of the true Jacobian at the goal."""
    view_condition: Array
    """Of the pixels by the tool's position at the goal: what the cameras alone do, whatever the arm."""
    steps: Array
    """Steps to under 10 px; NaN for never, and for runs that diverge."""
    distance_mm: Array
    """Final 3D error [mm], NaN for runs that diverge; `image_px` likewise [px]."""
    image_px: Array
    diverged: Mask

    def at(self, field: str, angle_deg: float, within_deg: float = 0.0) -> Array:
        """The values of all runs whose angle is at most so far from `angle_deg`, to either side.

        The other camera to the left or to the right of the first one is the same angle: 0 to 180.
        """
        opening = np.minimum(self.angle_deg, 360.0 - self.angle_deg)
        return getattr(self, field)[:, np.abs(opening - angle_deg) <= within_deg].ravel()


def turn(method: str, tracker: str, angles_deg: Sequence[int], seed: int) -> Turn:
    """Every place of the first camera with every angle to the second; a job of the experiment."""
    places, angles = np.array(FIRST_DEG, float), np.array(angles_deg, float)
    first = np.repeat(places, angles.size)
    second = first + np.tile(angles, places.size)
    rigs = scene.pair_rigs(np.radians(first), np.radians(second), scene.target("near"))
    world = scene.world(rigs, "near", READINGS[tracker])
    noise = seed_of(seed, list(READINGS).index(tracker))
    runs = run(
        world, scene.method(method, world, noise),
        gain=GAIN, delta=np.radians(DELTA_DEG), steps=scene.STEPS, seed=noise,
    )  # fmt: skip
    lost = runs.diverged

    def by_place(values: Array) -> Array:
        return values.reshape(places.size, angles.size)

    def kept(values: Array) -> Array:
        return by_place(np.where(lost, np.nan, values))

    return Turn(
        method, tracker, angles,
        by_place(runs.condition),
        by_place(condition_of(world.true_jacobian(world.goal))),
        by_place(condition_of(_by_position(world))),
        kept(runs.steps_to(REACHED_PX)),
        kept(1e3 * runs.distance[:, -1]),
        kept(runs.error[:, -1]),
        lost.reshape(places.size, angles.size),
    )  # fmt: skip


def condition_of(matrix: Array) -> Array:
    """(...,) ratio of the largest to the smallest singular value of (..., m, n)."""
    values = np.linalg.svd(matrix, compute_uv=False)
    return values[..., 0] / np.maximum(values[..., -1], 1e-12)


def _by_position(world: World) -> Array:
    """(runs, m, 3) what a shift of the tool at the goal does to the pixels, by central differences [px/m]."""
    points, shift = world.arm.points(world.goal, world.local), 1e-5 * np.eye(3)
    columns = [world.cameras.project(points + s) - world.cameras.project(points - s) for s in shift]
    return np.stack([c.reshape(len(c), -1) for c in columns], -1) / 2e-5
