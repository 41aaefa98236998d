"""What the stereo mode knows of its cameras, and what it sees through them.

Only the cameras' own geometry is known (TUM II-B: "these parameters can be computed off-line"). Where they
stand with respect to the robot is learned from motion (`vita.stereo.online_calibration`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.errors import BadInput
from vita.types import Array, frozen


@dataclass(frozen=True)
class Lens:
    """Intrinsic parameters of one camera."""

    fx: float
    """Focal length in columns [px]."""
    fy: float
    """Focal length in rows [px]."""
    cx: float
    """Column of the principal point [px]."""
    cy: float
    """Row of the principal point [px]."""
    distortion: tuple[float, ...] = ()
    """Radial and tangential coefficients k1, k2, p1, p2, k3; empty for none."""

    def __post_init__(self) -> None:
        numbers = (self.fx, self.fy, self.cx, self.cy, *self.distortion)
        if not (np.isfinite(numbers).all() and self.fx > 0 and self.fy > 0):
            raise BadInput(f"focal lengths must be above 0 and all numbers finite, got {numbers}", "lens")

    @property
    def matrix(self) -> Array:
        """(3, 3) intrinsic camera matrix K [px]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class StereoRig:
    """Two cameras that are fixed to one another. World frame of all stereo code: the left camera."""

    left: Lens
    right: Lens
    T_right_left: Array
    """(4, 4) maps left-camera coordinates into the right camera's: R_R^L and t_R^L of TUM eq. 7 [m]."""

    def __post_init__(self) -> None:
        T = frozen(self.T_right_left)
        if T.shape != (4, 4) or not np.isfinite(T).all():
            raise BadInput(f"expected a finite (4, 4) pose, got shape {T.shape}", "T_right_left")
        object.__setattr__(self, "T_right_left", T)

    @property
    def projections(self) -> tuple[Array, Array]:
        """(3, 4) projection matrices P_L = K_L [I 0] and P_R = K_R [R t] (TUM eq. 7)."""
        return self.left.matrix @ np.eye(4)[:3], self.right.matrix @ self.T_right_left[:3]

    @property
    def baseline(self) -> float:
        """Distance between the two cameras [m]."""
        return float(np.linalg.norm(self.T_right_left[:3, 3]))


@dataclass(frozen=True, eq=False)
class MarkerCorners:
    """The four corners of one marker in one pair of frames, with lens distortion taken off.

    Corners are in the marker's own order: clockwise from its own top-left as one looks at it.
    """

    left: Array | None
    """(4, 2) [px]; None where the left camera does not see it."""
    right: Array | None
    """(4, 2) [px]; None where the right camera does not see it."""
    sigma_px: float = 0.2
    """Standard deviation of each coordinate [px]."""

    @property
    def seen(self) -> bool:
        return self.left is not None or self.right is not None


def marker_square(size_m: float) -> Array:
    """(4, 3) corners of a marker of side `size_m` in its own frame [m].

    Its z axis points out of its face at whoever looks at it, x right and y up on the upright face, so the
    corners (clockwise from top-left) are (-, +), (+, +), (+, -), (-, -): those of the printed square on the
    objects `marker` and `target` and on the tool `marker_tool`.
    """
    return 0.5 * size_m * np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])


@dataclass(frozen=True, eq=False)
class PoseSight:
    """A marker's pose as one pair of frames shows it."""

    T_left_marker: Array
    """(4, 4) maps marker coordinates into the left camera's [m]."""
    covariance: Array
    """(6, 6) of translation [m] and of a small rotation about the left camera's axes [rad]."""
    rms_px: float
    """Root mean square of what is left in the image [px]."""


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """A marker's pose and motion at one instant, as the filter knows it; all in left-camera coordinates."""

    stamp: float
    """For which time it holds [s]."""
    T_left_marker: Array
    """(4, 4)."""
    velocity: Array
    """(3,) of the marker's centre [m/s]."""
    turn_rate: Array
    """(3,) angular velocity [rad/s]."""
    covariance: Array
    """(12, 12) of position, small rotation, velocity, turn rate."""
    age_s: float
    """Time since the last measurement that was taken [s]."""


@dataclass(frozen=True, eq=False)
class BaseFromCamera:
    """Where the left camera stands with respect to the robot, as learned from motion (TUM eq. 8 to 12)."""

    T_base_left: Array
    """(4, 4) maps left-camera coordinates into the robot's base frame [m]."""
    rms_m: float
    """Root mean square distance of the pairs after the fit [m]."""
    pairs: int
    """Pairs that the fit used."""
    rotation_sd_deg: float
    """Predicted standard deviation of the rotation [deg]."""
