"""Pinhole cameras without distortion, and the poses that scenes are written with.

A camera looks along its own +z, x right, y down (OpenCV). Pixels are (column, row) with the origin at
the centre of the top-left pixel, so the image spans -0.5 to width - 0.5.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vita.errors import BadInput, UnknownName
from vita.scenario.schema import CameraSpec
from vita.types import Array

Vector = Sequence[float] | Array


@dataclass(frozen=True)
class PinholeCamera:
    """The lens and the sensor of one camera; where it stands is a separate `T_world_camera`."""

    name: str
    size: tuple[int, int] = (640, 480)
    """Width and height [px]."""
    fov_deg: float = 50.0
    """Vertical field of view, from the top edge to the bottom edge of the image [deg]."""

    def __post_init__(self) -> None:
        width, height = self.size
        if not (int(width) == width and int(height) == height and 0 < width <= 8192 and 0 < height <= 8192):
            raise BadInput(
                f"camera {self.name!r} needs a size of 1 to 8192 px a side, not {self.size}", "size"
            )
        if not 0.1 <= self.fov_deg <= 175.0:
            raise BadInput(f"camera {self.name!r} needs 0.1 to 175 degrees, not {self.fov_deg}", "fov_deg")

    @property
    def focal_px(self) -> float:
        """Focal length, the same for rows and columns [px]."""
        return 0.5 * self.size[1] / float(np.tan(0.5 * np.radians(self.fov_deg)))

    @property
    def intrinsics(self) -> Array:
        """(3, 3) camera matrix [px]; the principal point is the centre of the image."""
        width, height = self.size
        f = self.focal_px
        return np.array([[f, 0.0, 0.5 * (width - 1)], [0.0, f, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])

    def project(self, T_world_camera: Array, points: Array) -> Array:
        """(k, 2) pixels of the (k, 3) world `points` [m]; NaN for those not in front of the camera.

        Pixels outside the image are returned as they are: the caller knows whether they matter.
        """
        points = np.atleast_2d(np.asarray(points, dtype=float))
        T = np.asarray(T_world_camera, dtype=float)
        local = (points - T[:3, 3]) @ T[:3, :3]
        depth = np.where(local[:, 2] > 1e-9, local[:, 2], np.nan)
        width, height = self.size
        return self.focal_px * local[:, :2] / depth[:, None] + (0.5 * (width - 1), 0.5 * (height - 1))


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


def mounted(T_world_mount: Array, xyz: Vector, rpy_deg: Vector) -> Array:
    """(4, 4) T_world_camera of a camera fixed at `xyz`, `rpy_deg` in the frame of its mount."""
    return np.asarray(T_world_mount, dtype=float) @ pose_matrix(xyz, rpy_deg)


def camera_pose(spec: CameraSpec, poses: Mapping[str, Array]) -> Array:
    """(4, 4) T_world_camera of a scenario's camera, given T_world_body of the bodies in the scene."""
    if spec.mount is not None:
        if spec.mount not in poses:
            raise UnknownName("mount", spec.mount, poses, path=f"camera {spec.name!r}")
        return mounted(poses[spec.mount], spec.xyz, spec.rpy_deg)
    if spec.look_from is None or spec.look_at is None:
        raise BadInput("needs look_from and look_at, or mount", path=f"camera {spec.name!r}")
    return look_at(spec.look_from, spec.look_at)
