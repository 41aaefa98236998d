"""Where to put the second camera: what a pair of cameras can tell of a task, over all directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from vita.experiments.cameras import Cameras, Reading, facing
from vita.experiments.estimators_exact import image_jacobian
from vita.experiments.starts import direction, visible
from vita.servo.estimators.base import RIGID_RANK
from vita.types import Array

LOWEST_DEG = -15.0
"""Cameras stand at least so high above the horizontal through the points."""
ARM_RADIUS_M = 0.07
"""A line of sight that passes the arm's links within this is taken to be blocked."""


@dataclass(frozen=True, eq=False)
class Task:
    """All that the map needs to know; a scenario gives it as well as an experiment does."""

    title: str
    points: Array
    """(k, 3) tracked points of the tool at the goal [m]."""
    moves: Array
    """(k, 3, n) how they move with the joints there [m/rad]."""
    first: Array
    """(4, 4) T_camera_world of the camera that stands already."""
    distance_m: float
    """Distance of the second camera from the middle of the points."""
    focal_px: float
    links: Array
    """(j, 3) the arm as a chain of straight pieces, from its base to its flange [m]."""

    @property
    def centre(self) -> Array:
        """(3,) what the second camera looks at [m]."""
        return self.points.mean(0)


@dataclass(frozen=True, eq=False)
class PlacementMap:
    """Figures of each direction of the second camera, over (elevations, azimuths)."""

    azimuth_deg: Array
    """(a,) about the vertical, from the world's x axis."""
    elevation_deg: Array
    """(b,) above the horizontal."""
    accuracy_mm: Array
    """(b, a) expected 3D error of a point (root mean square) for one pixel of noise in the error
    [mm/px], when the arm stands where the error is least."""
    condition: Array
    """(b, a) condition number of the image Jacobian, over the directions that a rigid hand has."""
    joints_deg: Array
    """(b, a) the same uncertainty in joint space [deg/px]: all that a servo can tell by itself."""
    apart_deg: Array
    """(b, a) angle between the two lines of sight."""
    usable: NDArray[np.bool_]
    """(b, a) whether the second camera sees all points past the arm."""

    def best(self) -> tuple[int, int]:
        """Index of the usable direction with the best accuracy."""
        return _index(np.where(self.usable, self.accuracy_mm, np.inf).argmin(), self.usable.shape)

    def worst(self) -> tuple[int, int]:
        """Index of the usable direction with the worst accuracy."""
        return _index(np.where(self.usable, self.accuracy_mm, -np.inf).argmax(), self.usable.shape)


def grid(step_deg: float, lowest_deg: float = LOWEST_DEG) -> tuple[Array, Array]:
    """Azimuths all around and elevations up to the zenith [deg]."""
    azimuth = np.arange(-180.0, 180.0 + step_deg / 2, step_deg)
    return azimuth, np.arange(lowest_deg, 90.0 + step_deg / 2, step_deg)


def placement_map(task: Task, azimuth_deg: Array, elevation_deg: Array) -> PlacementMap:
    """The map from the true Jacobian at the goal."""
    azimuth, elevation = np.meshgrid(azimuth_deg, elevation_deg)
    second = second_cameras(task, azimuth, elevation)
    rigs = pair(task, second)
    jacobian = image_jacobian(rigs, task.points, task.moves)
    return map_of(task, jacobian, azimuth_deg, elevation_deg)


def map_of(task: Task, jacobian: Array, azimuth_deg: Array, elevation_deg: Array) -> PlacementMap:
    """The map from any Jacobians of the pair (b, a, m, n) [px/rad], true or learned."""
    azimuth, elevation = np.meshgrid(azimuth_deg, elevation_deg)
    second = second_cameras(task, azimuth, elevation)
    accuracy, condition, joints = figures_of(jacobian, task.moves)
    sight = -direction(np.radians(azimuth), np.radians(elevation))
    first = task.centre - eye_of(task.first)
    cosine = sight @ (first / np.linalg.norm(first))
    apart = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    seen = visible(Cameras(second[..., None, :, :], task.focal_px), task.points).all((-2, -1))
    usable = seen & ~blocked(task, second)
    return PlacementMap(
        azimuth_deg, elevation_deg, 1e3 * accuracy, condition, np.degrees(joints), apart, usable
    )


def figures_of(jacobian: Array, moves: Array) -> tuple[Array, Array, Array]:
    """Of Jacobians (..., m, n) [px/rad]: 3D error [m/px], condition number, joint error [rad/px].

    White noise of one pixel in the error leaves the joints with the covariance (J'J)^-1 where the
    squared error is least, and the points with that turned into motion. Over at most six directions:
    a rigid hand has no more, and along the others a redundant arm moves without moving the tool.
    """
    _, values, axes = np.linalg.svd(jacobian, full_matrices=False)
    keep = min(RIGID_RANK, values.shape[-1])
    values, axes = np.maximum(values[..., :keep], 1e-9), axes[..., :keep, :]
    moved = np.einsum("kxn,...dn->...dkx", moves, axes)
    apart2 = np.sum(moved**2, axis=(-2, -1)) / moves.shape[0]
    accuracy = np.sqrt(np.sum(apart2 / values**2, axis=-1))
    return accuracy, values[..., 0] / values[..., -1], np.sqrt(np.sum(1.0 / values**2, axis=-1))


def second_cameras(task: Task, azimuth_deg: Array, elevation_deg: Array) -> Array:
    """(..., 4, 4) T_camera_world of cameras in these directions (...) that look at the points [deg]."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    out = direction(azimuth, elevation)
    # Upward along the meridian, which is defined at the zenith, too.
    up = direction(azimuth, elevation + np.pi / 2)
    return facing(task.centre + task.distance_m * out, -out, up)


def pair(task: Task, second: Array) -> Cameras:
    """The rigs (..., 2, 4, 4) of the first camera with each of `second` (..., 4, 4)."""
    return Cameras(np.stack(np.broadcast_arrays(task.first, second), axis=-3), task.focal_px)


def eye_of(T_camera_world: Array) -> Array:
    """(..., 3) where cameras (..., 4, 4) stand [m]."""
    turn, shift = T_camera_world[..., :3, :3], T_camera_world[..., :3, 3]
    return -(turn.swapaxes(-1, -2) @ shift[..., None])[..., 0]


def blocked(task: Task, second: Array) -> NDArray[np.bool_]:
    """(...,) whether a link of the arm is between the cameras (..., 4, 4) and a point. The last link
    is left out: it carries the points."""
    eye = eye_of(second)[..., None, None, :]
    along = np.linspace(0.02, 1.0, 30)[:, None]
    starts, ends = task.links[:-2, None], task.links[1:-1, None]
    bodies = (starts + along * (ends - starts)).reshape(-1, 3)
    sight = task.points[:, None] - eye  # (..., k, 1, 3)
    offset = bodies - eye  # (..., 1, bodies, 3)
    share = np.sum(offset * sight, axis=-1) / np.sum(sight**2, axis=-1)
    missed = np.linalg.norm(offset - np.clip(share, 0.0, 1.0)[..., None] * sight, axis=-1)
    # Bodies beside the point itself hide nothing.
    return ((missed < ARM_RADIUS_M) & (share < 0.9)).any((-2, -1))


def learned_pairs(
    pixels: Array, moved: Array, delta: float, reading: Reading, random: np.random.Generator
) -> Array:
    """(..., m, n) Jacobians by forward differences over `delta` [rad] with noisy readings, of true
    pixels (..., m) at the goal and `moved` (..., n, m) after the motion of each joint."""
    start = reading.of(pixels, random)[..., None, :]
    return (reading.of(moved, random) - start).swapaxes(-1, -2) / delta


def rank_correlation(one: Array, other: Array) -> float:
    """Spearman's coefficient; pairs with a NaN are left out."""
    both = np.isfinite(one) & np.isfinite(other)
    return float(np.corrcoef(rankdata(one[both]), rankdata(other[both]))[0, 1])


def _index(flat: np.integer, shape: tuple[int, ...]) -> tuple[int, int]:
    row, column = np.unravel_index(flat, shape)
    return int(row), int(column)
