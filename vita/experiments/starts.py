"""Random tasks of realistic size: start and goal poses of an arm, and two cameras that see both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vita.experiments.arms import Arm, arm_of
from vita.experiments.cameras import Cameras, Reading, look_at
from vita.experiments.scene import POINTS
from vita.experiments.trial import World
from vita.types import Array

IMAGE = (640, 480)
"""Width and height [px]."""
FOCAL_PX = 600.0
"""That of a common webcam at this size: 56 degrees wide, 44 high."""
BATCH = 3200
"""Tasks that are drawn at a time; some of a hundred fit."""


@dataclass(frozen=True)
class Kind:
    """What random tasks are like."""

    travel_m: tuple[float, float] = (0.05, 0.40)
    """Least and greatest displacement of the tool from start to goal."""
    turn_deg: float = 60.0
    """Greatest rotation of the tool."""
    joint_deg: float = 40.0
    """Greatest motion of one joint: start and goal are on one branch of the arm's inverse kinematics,
    as after a coarse motion to the neighbourhood of the goal."""
    margin_deg: float = 10.0
    """Start and goal keep this distance from the joint limits."""
    reach_m: float = 0.30
    """The tool is at least so far from the arm's vertical axis, out of its own body."""
    apart_deg: tuple[float, float] = (30.0, 150.0)
    """Angle between the two lines of sight."""
    away_m: tuple[float, float] = (0.8, 1.6)
    """Distance of the cameras from the middle of the scene."""
    elevation_deg: tuple[float, float] = (-20.0, 75.0)
    """Of the cameras as seen from the middle of the scene."""
    aside_m: float = 0.05
    """The cameras are aimed at the middle of the scene up to this error, as people would."""
    border_px: float = 20.0
    """All points are so far inside the image at start and goal."""


def random_starts(
    robot: str, count: int, seed: int, reading: Reading | None = None, kind: Kind | None = None
) -> World:
    """`count` tasks for one robot, drawn by rejection. A shorter list is the beginning of a longer one."""
    arm, kind = arm_of(robot), kind or Kind()
    random = np.random.default_rng(seed)
    kept: list[tuple[Array, Array, Array]] = []
    number = 0
    while number < count:
        q0, goal, rigs = _candidates(arm, kind, BATCH, random)
        kept.append((q0, goal, rigs))
        number += len(q0)
    q0, goal, rigs = (np.concatenate(part)[:count] for part in zip(*kept, strict=True))
    return World(arm, Cameras(rigs, FOCAL_PX), POINTS, q0, goal, reading or Reading(), limited=True)


def _candidates(
    arm: Arm, kind: Kind, count: int, random: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Those of `count` random tasks that fit: start, goal and rigs (k, 2, 4, 4)."""
    margin = np.radians(kind.margin_deg)
    low, high = arm.limits[:, 0] + margin, arm.limits[:, 1] - margin
    goal = random.uniform(low, high, (count, arm.n))
    # Differently long motions of the joints give short and long tasks alike.
    size = np.radians(kind.joint_deg) * random.random((count, 1))
    q0 = goal + size * random.uniform(-1.0, 1.0, (count, arm.n))
    start_pose, goal_pose = arm.pose(q0), arm.pose(goal)
    travel = np.linalg.norm(start_pose[:, :3, 3] - goal_pose[:, :3, 3], axis=-1)
    fits = ((q0 > low) & (q0 < high)).all(-1)
    fits &= (travel > kind.travel_m[0]) & (travel < kind.travel_m[1])
    fits &= turned(start_pose, goal_pose) < np.radians(kind.turn_deg)
    for pose in (start_pose, goal_pose):
        fits &= np.linalg.norm(pose[:, :2, 3], axis=-1) > kind.reach_m
    q0, goal = q0[fits], goal[fits]
    rigs, good = _rigs(arm, kind, q0, goal, random)
    return q0[good], goal[good], rigs[good]


def turned(one: Array, other: Array) -> Array:
    """(...,) angle between two poses (..., 4, 4) [rad]."""
    trace = np.einsum("...ij,...ij->...", one[..., :3, :3], other[..., :3, :3])
    return np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0))


def _rigs(
    arm: Arm, kind: Kind, q0: Array, goal: Array, random: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """A random pair of cameras (k, 2, 4, 4) for each task, and (k,) whether it will do."""
    points = np.concatenate([arm.points(q0, POINTS), arm.points(goal, POINTS)], axis=-2)
    k, middle = len(q0), points.mean(-2, keepdims=True)
    elevation = np.radians(random.uniform(*kind.elevation_deg, (k, 2)))
    azimuth = random.uniform(-np.pi, np.pi, (k, 2))
    sight = direction(azimuth, elevation)
    eye = middle + random.uniform(*kind.away_m, (k, 2, 1)) * sight
    aim = middle + random.uniform(-kind.aside_m, kind.aside_m, (k, 2, 3))
    rigs = look_at(eye, aim)
    apart = np.degrees(angle_between(rigs))
    good = (apart > kind.apart_deg[0]) & (apart < kind.apart_deg[1])
    return rigs, good & visible(Cameras(rigs, FOCAL_PX), points, kind.border_px).all((-2, -1))


def direction(azimuth: Array, elevation: Array) -> Array:
    """(..., 3) unit vectors towards `azimuth` and `elevation` (...) [rad]."""
    flat = np.cos(elevation)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=-1)


def angle_between(rigs: Array) -> Array:
    """(...,) angle between the optical axes of two cameras, T_camera_world (..., 2, 4, 4) [rad]."""
    axes = rigs[..., :, 2, :3]
    return np.arccos(np.clip(np.sum(axes[..., 0, :] * axes[..., 1, :], axis=-1), -1.0, 1.0))


def visible(cameras: Cameras, points: Array, border_px: float = 0.0) -> NDArray[np.bool_]:
    """(..., c, k) whether `points` (..., k, 3) are in front of the cameras and inside their images."""
    room = np.array(IMAGE) / 2.0 - border_px
    in_front = cameras.depth(points) > 0.1
    return in_front & (np.abs(cameras.project(points)) < room).all(-1)
