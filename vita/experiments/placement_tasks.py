"""The tasks of the `placement` experiment, and what is run on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vita.errors import UnknownName
from vita.experiments.arms import Arm, arm_of
from vita.experiments.cameras import Reading, look_at
from vita.experiments.estimators_exact import image_jacobian, point_jacobian
from vita.experiments.estimators_loop import servo
from vita.experiments.placement_map import (
    LOWEST_DEG,
    PlacementMap,
    Task,
    figures_of,
    grid,
    learned_pairs,
    map_of,
    pair,
    placement_map,
    rank_correlation,
    second_cameras,
)
from vita.experiments.scene import GOALS, POINTS, START
from vita.experiments.starts import FOCAL_PX, direction
from vita.experiments.trial import Method, World
from vita.servo.config import ServoConfig
from vita.servo.estimators import Tuning
from vita.sim.wam import READY
from vita.types import Array

SIGMA_PX = 0.2
"""Noise of each reading; the error is the difference of two."""
DELTA_DEG, GAIN, STEPS, LAST = 4.0, 0.5, 60, 15
"""Settings of the closed-loop runs; their accuracy is taken over the last steps."""


@dataclass(frozen=True)
class Setting:
    """One task: an arm, where it starts and where it is to go, and the camera that stands already."""

    key: str
    title: str
    robot: str
    start_deg: tuple[float, ...]
    goal_deg: tuple[float, ...]
    first_deg: tuple[float, float]
    """Azimuth and elevation of the first camera as seen from the goal."""
    distance_m: float
    focal_px: float
    limited: bool = True

    @property
    def arm(self) -> Arm:
        return arm_of(self.robot)

    def task(self) -> Task:
        goal = np.radians(self.goal_deg)
        points, moves = point_jacobian(self.arm, goal, POINTS)
        out = direction(*np.radians(self.first_deg))
        centre = points.mean(0)
        first = look_at(centre + self.distance_m * out, centre)
        return Task(self.title, points, moves, first, self.distance_m, self.focal_px, _links(self.arm, goal))


def _links(arm: Arm, q: Array) -> Array:
    """(n + 2, 3) origins of the arm's frames and its tool [m]."""
    frames = arm.chain.link_frames(q)
    return np.concatenate([frames[:, :3, 3], (frames[-1] @ arm.tool)[None, :3, 3]])


WAM7_GOAL = np.degrees(READY["wam7"])
SETTINGS: Sequence[Setting] = (
    Setting(
        "wam7", "WAM 7, hand in front of the arm", "wam7",
        tuple(WAM7_GOAL + np.array([12.0, -8.0, 10.0, -9.0, 12.0, 8.0, -15.0])), tuple(WAM7_GOAL),
        (-40.0, 25.0), 1.2, FOCAL_PX,
    ),
    Setting(
        "puma560", "Puma 560, goal of thesis 5.2.1", "puma560", tuple(np.degrees(START)),
        tuple(np.degrees(GOALS["near"])), (-90.0, 0.0), 1.0, 1200.0, limited=False,
    ),
)  # fmt: skip


def setting_of(key: str) -> Setting:
    """Raises `UnknownName` with the choices."""
    for setting in SETTINGS:
        if setting.key == key:
            return setting
    raise UnknownName("placement task", key, [setting.key for setting in SETTINGS])


@dataclass(frozen=True, eq=False)
class Maps:
    """Of one task: the map of the true Jacobian and that of learned ones."""

    key: str
    task: Task
    true: PlacementMap
    learned: PlacementMap


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """Of one task: servo runs with the second camera at (p,) sampled placements."""

    key: str
    azimuth_deg: Array
    elevation_deg: Array
    apart_deg: Array
    predicted_mm: Array
    """3D error of a point for the noise of these runs, before any averaging (root mean square)."""
    condition: Array
    default_mm: Array
    """The same that the default reached at the end of its runs."""
    plain_mm: Array
    """The same with the thesis' law."""
    lost: Array
    """Share of the default's runs that ended above 1 px."""

    def agreement(self, reached: str) -> float:
        """Spearman's rank correlation of predicted and reached accuracy."""
        return rank_correlation(self.predicted_mm, getattr(self, reached))


def make_maps(key: str, step_deg: float, seed: int) -> Maps:
    """One job: both maps of a task."""
    setting = setting_of(key)
    task = setting.task()
    azimuth, elevation = grid(step_deg)
    around = np.meshgrid(azimuth, elevation)
    second = second_cameras(task, *around)
    random, reading = np.random.default_rng(seed), Reading("gaussian", SIGMA_PX)
    delta, goal = np.radians(DELTA_DEG), np.radians(setting.goal_deg)
    moved = setting.arm.points(goal + delta * np.eye(setting.arm.n), POINTS)
    rows = []
    # Each camera explores alone, as people would who try a second camera in several places.
    for cameras in (pair(task, second[..., :1, :1, :, :]), pair(task, second)):
        pixels = cameras.project(task.points)
        pixels_moved = np.moveaxis(cameras.project(moved[:, None, None]), 0, -4)
        keep = 0 if not rows else 1
        flat = pixels[..., keep, :, :].reshape(*pixels.shape[:-3], -1)
        flat_moved = pixels_moved[..., keep, :, :].reshape(*pixels_moved.shape[:-3], -1)
        rows.append(learned_pairs(flat, flat_moved, delta, reading, random))
    first, other = rows
    both = np.concatenate([np.broadcast_to(first, other.shape), other], axis=-2)
    return Maps(key, task, placement_map(task, azimuth, elevation), map_of(task, both, azimuth, elevation))


def run_sample(key: str, placements: int, repeats: int, seed: int) -> ClosedLoop:
    """One job: servo runs at random placements."""
    setting = setting_of(key)
    task, random = setting.task(), np.random.default_rng(seed)
    azimuth, elevation = _sampled(setting.first_deg, placements, random)
    second = second_cameras(task, azimuth, elevation)
    rigs = pair(task, second)
    accuracy, condition, _ = figures_of(image_jacobian(rigs, task.points, task.moves), task.moves)
    sight = direction(np.radians(azimuth), np.radians(elevation))
    cosine = sight @ direction(*np.radians(setting.first_deg))
    runs = placements * repeats
    cameras = type(rigs)(np.repeat(rigs.T_camera_world, repeats, axis=0), setting.focal_px)
    world = World(
        setting.arm, cameras, POINTS, np.tile(np.radians(setting.start_deg), (runs, 1)),
        np.tile(np.radians(setting.goal_deg), (runs, 1)), Reading("gaussian", SIGMA_PX), setting.limited,
    )  # fmt: skip
    default = Method("default", ServoConfig.estimator, ServoConfig.policy, damping=ServoConfig.damping)
    plain = Method("plain", "thesis", "fixed", Tuning(alpha=0.0))
    reached, lost = _reached(world, default, placements, seed)
    plainly, _ = _reached(world, plain, placements, seed)
    return ClosedLoop(
        key, azimuth, elevation, np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))),
        1e3 * accuracy * np.sqrt(2.0) * SIGMA_PX, condition, 1e3 * reached, 1e3 * plainly, lost,
    )  # fmt: skip


def _sampled(
    first_deg: tuple[float, float], count: int, random: np.random.Generator
) -> tuple[Array, Array]:
    """Azimuth and elevation [deg] of `count` random directions, evenly over the angle between the cameras:
    evenly over the sphere most would be near a right angle, where all places are nearly as good."""
    one = direction(*np.radians(np.asarray(first_deg)))
    side = np.cross(one, [0.0, 0.0, 1.0]) / np.hypot(one[0], one[1])
    found: list[Array] = []
    while len(found) < count:
        apart, around = random.uniform(0.0, np.pi), random.uniform(0.0, 2.0 * np.pi)
        across = np.cos(around) * side + np.sin(around) * np.cross(side, one)
        way = np.cos(apart) * one + np.sin(apart) * across
        if way[2] > np.sin(np.radians(LOWEST_DEG)):
            found.append(way)
    x, y, z = np.array(found).T
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z))


def _reached(world: World, method: Method, placements: int, seed: int) -> tuple[Array, Array]:
    """(placements,) root mean square 3D error of a point over repeats and last steps [m], and the
    share of runs that did not converge; those are not in the mean."""
    goal, squares = world.arm.points(world.goal, world.local), []

    def note(number: int, q: Array, *_: object) -> None:
        if number >= STEPS - LAST:
            apart = world.arm.points(q, world.local) - goal
            squares.append(np.sum(apart**2, axis=-1).mean(-1))

    course = servo(
        world, method, gain=GAIN, delta=np.radians(DELTA_DEG), steps=STEPS, seed=seed, each=note
    )
    done = course.converged.reshape(placements, -1)
    mean = np.where(done, np.mean(squares, axis=0).reshape(done.shape), 0.0)
    with np.errstate(invalid="ignore"):
        return np.sqrt(mean.sum(-1) / done.sum(-1)), 1.0 - done.mean(-1)
