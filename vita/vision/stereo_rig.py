"""The geometry of two of a scenario's cameras: what a calibration of them would find."""

from __future__ import annotations

import numpy as np

from vita.errors import BadInput
from vita.scenario.schema import CameraSpec
from vita.sim.camera import PinholeCamera, camera_pose
from vita.stereo.base import Lens, StereoRig


def stereo_rig_of(left: CameraSpec, right: CameraSpec) -> StereoRig:
    """The rig that two cameras form. Both ride on the same body, or both stand in the world."""
    if left.mount != right.mount:
        one, other = (
            f"{spec.name!r} " + (f"is carried by {spec.mount!r}" if spec.mount else "stands in the world")
            for spec in (left, right)
        )
        raise BadInput(f"stereo cameras must be fixed to one another, but {one} and {other}", "camera")
    # What carries both does not matter: it cancels.
    carrier = {} if left.mount is None else {left.mount: np.eye(4)}
    T_world_left, T_world_right = camera_pose(left, carrier), camera_pose(right, carrier)
    return StereoRig(lens_of(left), lens_of(right), np.linalg.inv(T_world_right) @ T_world_left)


def lens_of(spec: CameraSpec) -> Lens:
    """The intrinsic parameters of a simulated camera: square pixels, no distortion."""
    K = PinholeCamera(spec.name, spec.size, spec.fov_deg).intrinsics
    return Lens(float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]))
