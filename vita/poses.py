"""Poses as scenes and settings are written: position, roll-pitch-yaw, and cameras that look at a point."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vita.errors import BadInput
from vita.types import Array

Vector = Sequence[float] | Array


def rpy_matrix(rpy_deg: Vector) -> Array:
    """(3, 3) rotation Rz(yaw) Ry(pitch) Rx(roll) from (roll, pitch, yaw) [deg]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.radians(rpy_deg)), np.sin(np.radians(rpy_deg))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def pose_matrix(xyz: Vector, rpy_deg: Vector = (0.0, 0.0, 0.0)) -> Array:
    """(4, 4) pose from a position [m] and (roll, pitch, yaw) [deg]."""
    T = np.eye(4)
    T[:3, :3] = rpy_matrix(rpy_deg)
    T[:3, 3] = xyz
    return T


def look_at(look_from: Vector, look_at: Vector, up: Vector = (0.0, 0.0, 1.0)) -> Array:
    """(4, 4) T_world_camera of a camera at `look_from` that sees `look_at` in its centre, `up` upwards.

    Looking straight along `up` leaves the roll open; world +x (or, failing that, +y) is then up in
    the image, so that the pose is still defined and repeatable.
    """
    eye, target = np.asarray(look_from, dtype=float), np.asarray(look_at, dtype=float)
    forward = target - eye
    distance = np.linalg.norm(forward)
    if not np.isfinite(distance) or distance < 1e-9:
        raise BadInput(f"the camera cannot look from {tuple(eye)} at the same point", "look_at")
    forward /= distance
    for candidate in (up, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        right = np.cross(forward, np.asarray(candidate, dtype=float))
        length = np.linalg.norm(right)
        if length > 1e-6:
            break
    right /= length
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = right, np.cross(forward, right), forward, eye
    return T
