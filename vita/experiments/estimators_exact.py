"""The exact image Jacobian of a simulated arm in closed form; for judging and for the floor only."""

from __future__ import annotations

import numpy as np

from vita.experiments.arms import Arm
from vita.experiments.cameras import Cameras
from vita.experiments.trial import World
from vita.types import Array


def point_jacobian(arm: Arm, q: Array, local: Array) -> tuple[Array, Array]:
    """(..., k, 3) tool points [m] at joints `q` (..., n), and (..., k, 3, n) how they move [m/rad].

    A point turns about the axis of each joint: dp/dq_i = z_i x (p - o_i), with joint i's axis z_i
    through o_i, which are those of frame i - 1 (Denavit-Hartenberg).
    """
    frame = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
    axes, origins = [], []
    for i in range(arm.n):
        axes.append(frame[..., :3, 2])
        origins.append(frame[..., :3, 3])
        turn = np.zeros((*q.shape[:-1], 4, 4))
        angle = q[..., i] + arm.chain.offset[i]
        turn[..., 0, 0] = turn[..., 1, 1] = np.cos(angle)
        turn[..., 1, 0] = np.sin(angle)
        turn[..., 0, 1] = -turn[..., 1, 0]
        turn[..., 2, 2] = turn[..., 3, 3] = 1.0
        frame = frame @ (turn @ arm.chain.fixed(i))
    pose = frame @ arm.tool
    points = local @ pose[..., :3, :3].swapaxes(-1, -2) + pose[..., None, :3, 3]
    columns = [
        np.cross(z[..., None, :], points - o[..., None, :]) for z, o in zip(axes, origins, strict=True)
    ]
    return points, np.stack(columns, axis=-1)


def image_jacobian(cameras: Cameras, points: Array, moves: Array) -> Array:
    """(..., 2 c k, n) d pixels / d joints [px/rad] of `points` (..., k, 3) [m] that move by `moves`
    (..., k, 3, n) [m/rad]; rows in the order of `Cameras.project`.

    Per point (f/z) [1 0 -x/z; 0 1 -y/z] R dp, the translational part of the interaction matrix
    (thesis eq. 2.14) for a camera that stands still.
    """
    turn, shift = cameras.T_camera_world[..., :3, :3], cameras.T_camera_world[..., None, :3, 3]
    seen = points[..., None, :, :] @ turn.swapaxes(-1, -2) + shift
    moved = turn[..., None, :, :] @ moves[..., None, :, :, :]
    x, z = seen[..., :2, None], seen[..., 2:, None]
    rows = cameras.focal_px * (moved[..., :2, :] - x / z * moved[..., 2:, :]) / z
    return rows.reshape(*rows.shape[:-4], -1, rows.shape[-1])


def exact_jacobian(world: World, q: Array) -> Array:
    """(runs, m, n) [px/rad] of a world at joints `q` (runs, n)."""
    points, moves = point_jacobian(world.arm, q, world.local)
    return image_jacobian(world.cameras, points, moves)
