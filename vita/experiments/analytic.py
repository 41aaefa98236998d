"""Calibrated visual servoing: what people would use instead, for comparison only.

Both servos know the cameras' focal length and poses, the arm's kinematics and where the tracked
points sit, as well as somebody has calibrated them: `miscalibrated` makes that knowledge wrong by so
much. vita's own servo knows nothing of the kind.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vita.experiments.arms import Arm
from vita.experiments.cameras import Cameras
from vita.experiments.interaction import (
    adjoint,
    inverse,
    moved,
    point_interaction,
    theta_u_of,
    turned,
)
from vita.experiments.trial import JUMP_PX, Runs, World
from vita.types import Array

LEAST_DEPTH = 0.02
"""A point is never taken to be nearer to a camera [m]."""
CUTOFF = 1e-4
"""Singular values below this share of the largest are not inverted."""
FITTING_STEPS = 12
"""Gauss-Newton steps for a pose from pixels, at most."""
FITTING_DAMPING = 1e-9
"""Of its normal equations, relative to their trace, against views that hold no full pose."""
FITTED = 1e-9
"""Steps of the fit that are smaller than this end it [m and rad]."""

Law = Callable[[Array, Array, World], Array]
"""(q (runs, n), e (runs, m), world) to the joint step (runs, n) [rad]."""


@dataclass(frozen=True, eq=False)
class HandWorld(World):
    """Eye-in-hand: the cameras ride on the tool and the points stand in the room.

    `cameras.T_camera_world` are then poses T_camera_tool, and `local` (k, 3) are points in the base frame.
    """

    def features(self, q: Array) -> Array:
        pose = inverse(self.arm.pose(q))
        points = self.local @ pose[..., :3, :3].swapaxes(-1, -2) + pose[..., None, :3, 3]
        pixels = self.cameras.project(points)
        return pixels.reshape(*q.shape[:-1], -1)

    def distance(self, q: Array) -> Array:
        """(runs,) distance of the tool from where it is at the goal [m]."""
        apart = self.arm.pose(q)[..., :3, 3] - self.arm.pose(self.goal)[..., :3, 3]
        return np.linalg.norm(apart, axis=-1)


def miscalibrated(
    cameras: Cameras, random: np.random.Generator, focal_share: float = 0.0, turn_deg: float = 0.0
) -> Cameras:
    """What a calibration says that has the focal length wrong by `focal_share` (0.1 is 10 % too long)
    and each camera's pose turned by `turn_deg` about a random axis through the camera."""
    pose = cameras.T_camera_world
    axis = random.standard_normal((*pose.shape[:-2], 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    error = np.zeros(pose.shape)
    error[..., :3, :3] = turned(np.radians(turn_deg) * axis)
    error[..., 3, 3] = 1.0
    return replace(cameras, T_camera_world=error @ pose, focal_px=(1.0 + focal_share) * cameras.focal_px)


def tool_jacobian(arm: Arm, q: Array) -> Array:
    """(..., 6, n) twist of the tool in its own frame for each joint's speed."""
    frame, poses = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4)), []
    for i in range(arm.n):
        poses.append(frame)
        turn = np.zeros((*q.shape[:-1], 4, 4))
        turn[..., :3, :3] = turned((q[..., i] + arm.chain.offset[i])[..., None] * np.array([0.0, 0.0, 1.0]))
        turn[..., 3, 3] = 1.0
        frame = frame @ (turn @ arm.chain.fixed(i))
    tool = inverse(frame @ arm.tool)
    # Joint i turns about z of frame i - 1: the twist (0, z) there, brought to the tool.
    columns = [adjoint(tool @ pose)[..., :, 5] for pose in poses]
    return np.stack(columns, axis=-1)


@dataclass(frozen=True, eq=False)
class Ibvs:
    """Image-based: dq = -lambda J+ e with the Jacobian computed from the interaction matrix
    (thesis eq. 2.4 and 2.14), the depth from the arm's pose and the calibration."""

    cameras: Cameras
    """As calibrated."""
    gain: float = 0.25

    def __call__(self, q: Array, e: Array, world: World) -> Array:
        jacobian = self.jacobian(q, e + world.features(world.goal), world)
        return -self.gain * _times(_inverted(jacobian), e)

    def jacobian(self, q: Array, pixels: Array, world: World) -> Array:
        """(..., m, n) d pixels / d joints [px/rad] at the measured `pixels` (..., m)."""
        c, k, f = self.cameras.count, len(world.local), self.cameras.focal_px
        tool_to_cameras, sign = _mount(self.cameras, q, world)
        points = world.local
        if isinstance(world, HandWorld):
            pose = inverse(world.arm.pose(q))
            points = points @ pose[..., :3, :3].swapaxes(-1, -2) + pose[..., None, :3, 3]
        # The third row of each camera's pose gives the depth of tool points.
        row = tool_to_cameras[..., 2, :]
        depth = np.einsum("...ci,...ki->...ck", row[..., :3], np.broadcast_to(points, (*q.shape[:-1], k, 3)))
        depth = np.maximum(depth + row[..., 3:], LEAST_DEPTH)
        x = pixels.reshape(*q.shape[:-1], c, k, 2) / f
        interaction = point_interaction(x, depth)
        rows = sign * f * interaction @ adjoint(tool_to_cameras)[..., None, :, :]
        return rows.reshape(*q.shape[:-1], 2 * c * k, 6) @ tool_jacobian(world.arm, q)


@dataclass(frozen=True, eq=False)
class Pbvs:
    """Position-based (thesis eq. 2.5 to 2.8): poses are fitted to the pixels, and the frame that moves
    (the first camera, or the tool that is watched) goes straight to where it is to be."""

    cameras: Cameras
    """As calibrated."""
    gain: float = 0.25

    def __call__(self, q: Array, e: Array, world: World) -> Array:
        goal_pixels = world.features(world.goal)
        goal = self.relative(world.goal, goal_pixels, world)
        now = self.relative(q, goal_pixels + e, world)
        to_tool = np.eye(4)
        if isinstance(world, HandWorld):
            # What is seen is the room in the tool's frame; the camera is the frame to be moved.
            camera = np.broadcast_to(self.cameras.T_camera_world[..., 0, :, :], now.shape)
            to_tool = inverse(camera)
            error = camera @ goal @ inverse(now) @ to_tool
        else:
            error = inverse(goal) @ now
        turn, shift = error[..., :3, :3], error[..., :3, 3]
        straight = _times(turn.swapaxes(-1, -2), shift)
        twist = -self.gain * np.concatenate([straight, theta_u_of(turn)], axis=-1)
        jacobian = tool_jacobian(world.arm, q)
        return _times(_inverted(jacobian), _times(adjoint(to_tool), twist))

    def relative(self, q: Array, pixels: Array, world: World) -> Array:
        """(..., 4, 4) pose fitted to `pixels` (..., m): of the tool in the base frame, or with cameras in
        the hand of the base in the tool's frame. The arm's own pose is where the fit begins."""
        in_hand = isinstance(world, HandWorld)
        pose = world.arm.pose(q)
        pose = inverse(pose) if in_hand else pose
        c, k, f = self.cameras.count, len(world.local), self.cameras.focal_px
        target = pixels.reshape(*q.shape[:-1], c, k, 2)
        for _ in range(FITTING_STEPS):
            in_camera = self.cameras.T_camera_world @ pose[..., None, :, :]
            seen = world.local @ in_camera[..., :3, :3].swapaxes(-1, -2) + in_camera[..., None, :3, 3]
            depth = np.maximum(seen[..., 2], LEAST_DEPTH)
            x = seen[..., :2] / depth[..., None]
            # Moving the points is moving the camera the other way.
            slope = -f * point_interaction(x, depth) @ adjoint(in_camera)[..., None, :, :]
            slope = slope.reshape(*q.shape[:-1], 2 * c * k, 6)
            off = (f * x - target).reshape(*q.shape[:-1], 2 * c * k)
            turned_slope = slope.swapaxes(-1, -2)
            normal = turned_slope @ slope
            floor = FITTING_DAMPING * np.trace(normal, axis1=-2, axis2=-1)[..., None, None] * np.eye(6)
            change = -np.linalg.solve(normal + floor, turned_slope @ off[..., None])[..., 0]
            pose = pose @ moved(change)
            if np.abs(change).max() < FITTED:
                break
        return pose


def run_law(world: World, law: Law, *, steps: int, seed: int) -> Runs:
    """Servo every run of `world` by `law` for `steps` steps; runs that have diverged stand still."""
    random, q = np.random.default_rng(seed), world.q0.copy()
    error, distance = [np.abs(world.features(q) - world.features(world.goal)).sum(-1)], [world.distance(q)]
    stopped = np.zeros(q.shape[:-1], bool)
    for _ in range(steps):
        dq = law(q, world.measure(q, random), world)
        q = q + np.where(stopped[..., None], 0.0, dq)
        error.append(np.abs(world.features(q) - world.features(world.goal)).sum(-1))
        distance.append(world.distance(q))
        stopped = stopped | (error[-1] > error[-2] + JUMP_PX)
    return Runs(np.stack(error, -1), np.stack(distance, -1), np.full(q.shape[:-1], np.nan), q)


def _mount(cameras: Cameras, q: Array, world: World) -> tuple[Array, float]:
    """(..., c, 4, 4) T_camera_tool, and the sign with which the tool's twist moves the cameras relative
    to what they see."""
    if isinstance(world, HandWorld):
        return np.broadcast_to(cameras.T_camera_world, (*q.shape[:-1], cameras.count, 4, 4)), 1.0
    return cameras.T_camera_world @ world.arm.pose(q)[..., None, :, :], -1.0


def _inverted(matrix: Array) -> Array:
    """Pseudo-inverse without the directions that hardly show."""
    return np.asarray(np.linalg.pinv(matrix, rcond=CUTOFF), float)


def _times(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]
