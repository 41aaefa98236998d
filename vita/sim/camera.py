"""Pinhole cameras without distortion, and where a scenario puts them.

A camera looks along its own +z, x right, y down (OpenCV). Pixels are (column, row) with the origin at
the centre of the top-left pixel, so the image spans -0.5 to width - 0.5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vita.errors import BadInput, UnknownName
from vita.poses import Vector, look_at, pose_matrix
from vita.scenario.schema import CameraSpec
from vita.types import Array


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
