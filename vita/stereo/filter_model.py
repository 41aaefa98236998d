"""The two models of the pose filter: how a marker moves, and which pixels it is seen at.

All in left-camera coordinates. The state is the marker's centre p, its orientation R (marker to camera), its
velocity v and its turn rate w. The error that the covariance speaks of is (dp, dr, dv, dw) with
R_true = exp(dr) R: an error-state filter, whose rotation never needs more than three numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vita.errors import BadInput
from vita.stereo.base import MarkerCorners, StereoRig, marker_square
from vita.stereo.projection import NEAREST_M
from vita.stereo.rotations import left_jacobian, orthonormal, rotation_exp, skews
from vita.types import Array

P, TURN, V, W = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
"""Where position, small rotation, velocity and turn rate stand in the error (12,)."""
_EYE12 = np.eye(12)


@dataclass(frozen=True)
class FilterSettings:
    """How the marker may move, and what to make of measurements that do not fit.

    The same settings serve tool and target: two filters of the same gains lag by the same time, and the lag
    cancels in the difference that the tool is steered by.

    The densities were chosen by trial on circles at 0.08 and 0.15 m/s, on a hand that carries from place to
    place and on one that turns back within 0.1 to 0.25 s. One density for all would have to be 30 times the
    calm one: with less, the turning back is refused by the gate and missed by 20 mm.
    """

    acceleration_density: float = 0.001
    """Spectral density of the white acceleration of a calm motion [m^2/s^3]."""
    turn_density: float = 0.007
    """Spectral density of the white angular acceleration of a calm motion [rad^2/s^3]."""
    vigour: tuple[float, ...] = (1.0, 8.0, 64.0, 512.0)
    """Both densities times these are tried against each picture: a hand that turns back at once is not
    calm, and a filter that is always ready for that passes three times the noise on."""
    memory: float = 0.7
    """Share of what earlier pictures said of the vigour that the next one leaves."""
    start_speed: float = 0.15
    """Standard deviation of each component of a new marker's velocity [m/s]."""
    start_turn_rate: float = 0.5
    """Standard deviation of each component of a new marker's turn rate [rad/s]."""
    gate: float = 35.0
    """Squared Mahalanobis distance beyond which one camera's eight numbers are not believed."""
    patience: int = 3
    """Pictures in a row that may be refused before the filter starts anew from the pose they show."""
    coast_s: float = 0.25
    """A hidden marker is expected to go on as it went for so long [s]."""
    decay_s: float = 0.3
    """After that its expected velocity dies away with this time constant [s]."""
    forget_s: float = 1.0
    """A marker that comes back after so long is a new one [s]."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value).all() and np.min(value) > 0):
                raise BadInput(f"must be above 0, got {value!r}", f"filter.{name}")
        if self.memory >= 1.0:
            raise BadInput(f"must be below 1, got {self.memory!r}", "filter.memory")


@dataclass(frozen=True, eq=False)
class MotionState:
    """Where the marker is and how it moves, at one instant."""

    p: Array
    """(3,) its centre [m]."""
    R: Array
    """(3, 3) marker to left camera."""
    v: Array
    """(3,) [m/s]."""
    w: Array
    """(3,) [rad/s]."""
    covariance: Array
    """(12, 12) of (dp, dr, dv, dw)."""

    def shifted(self, error: Array, covariance: Array) -> MotionState:
        """The state with an error (12,) put in, and a new covariance."""
        R = orthonormal(rotation_exp(error[TURN]) @ self.R)
        return MotionState(self.p + error[P], R, self.v + error[V], self.w + error[W], covariance)


def _reach(dt: float, settings: FilterSettings) -> tuple[float, float]:
    """Seconds of full speed that the expected motion goes on within `dt`, and the share of speed left."""
    over = dt - settings.coast_s
    if over <= 0.0:
        return dt, 1.0
    left = math.exp(-over / settings.decay_s)
    return settings.coast_s + settings.decay_s * (1.0 - left), left


def predict(state: MotionState, dt: float, settings: FilterSettings) -> MotionState:
    """The state `dt` seconds after (or, if negative, before) the last measurement, without `noise`.

    Constant velocity and turn rate, to which `noise` adds white acceleration. Beyond `coast_s` the expected
    motion dies away, as somebody who has put a thing out of sight has often stopped. Whether they stopped is
    not known: the covariance stays that of going on, widened by the whole difference between the two.
    """
    far, left = _reach(dt, settings)
    turn = far * state.w
    E = rotation_exp(turn)
    J = left_jacobian(turn if left == 1.0 else dt * state.w)

    F = _EYE12.copy()
    F[TURN, TURN] = E if left == 1.0 else rotation_exp(dt * state.w)
    F[0, 6] = F[1, 7] = F[2, 8] = dt
    F[TURN, W] = dt * J
    covariance = F @ state.covariance @ F.T
    if left < 1.0:
        short, slow = dt - far, 1.0 - left
        missed = np.concatenate([short * state.v, short * state.w, slow * state.v, slow * state.w])
        covariance += np.outer(missed, missed)
    return MotionState(state.p + far * state.v, E @ state.R, left * state.v, left * state.w, covariance)


def noise(dt: float, settings: FilterSettings) -> Array:
    """(12, 12) what the white acceleration of a calm motion adds to the covariance in `dt`: exact."""
    size = abs(dt)
    Q = np.zeros((12, 12))
    flat = Q.ravel()
    for at, density in ((0, settings.acceleration_density), (3, settings.turn_density)):
        # Row 12 i + column: strides of 13 walk along a diagonal.
        begin, end = 13 * at, 13 * at + 39
        flat[begin:end:13] = density * size**3 / 3.0
        flat[begin + 6 : end + 6 : 13] = density * dt * size / 2.0
        flat[begin + 72 : end + 72 : 13] = density * dt * size / 2.0
        flat[begin + 78 : end + 78 : 13] = density * size
    return Q


class CornerModel:
    """Where the two cameras see the corners of a marker of a given size."""

    def __init__(self, rig: StereoRig, size_m: float) -> None:
        if not (math.isfinite(size_m) and size_m > 0):
            raise BadInput(f"a marker's side must be above 0, got {size_m!r}", "size_m")
        self._square = marker_square(size_m)
        lenses = (rig.left, rig.right)
        self._focal = np.array([(lens.fx, lens.fy) for lens in lenses])[:, None, :]
        self._centre = np.array([(lens.cx, lens.cy) for lens in lenses])[:, None, :]
        turns = np.stack([np.eye(3), rig.T_right_left[:3, :3]])
        self._R, self._Rt = turns[:, None], np.ascontiguousarray(np.swapaxes(turns, 1, 2))
        self._t = np.stack([np.zeros(3), rig.T_right_left[:3, 3]])[:, None, :]

    def expected(self, state: MotionState) -> tuple[Array, Array]:
        """(2, 8) pixels of the four corners in the left and the right camera and (2, 8, 6) their slope over
        (dp, dr) [px/m, px/rad]; NaN in a camera that a corner would be behind."""
        # The formulas of `projection`, for all corners and cameras at once: this runs in the control loop.
        arms = self._square @ state.R.T
        points = np.matmul(state.p + arms, self._Rt) + self._t
        depth = points[..., 2:]
        if depth.min() <= NEAREST_M:
            depth = np.where(depth.min(axis=1, keepdims=True) > NEAREST_M, depth, np.nan)
        scale = self._focal / depth
        flat = points[..., :2] * scale
        slope = np.zeros((2, 4, 2, 3))
        slope[..., 0, 0], slope[..., 1, 1] = scale[..., 0], scale[..., 1]
        slope[..., 2] = -flat / depth
        H = np.empty((2, 4, 2, 6))
        np.matmul(slope, self._R, out=H[..., :3])
        # exp(dr) turns the arm from the centre to the corner by dr cross arm = -[arm]x dr.
        np.matmul(H[..., :3], skews(-arms), out=H[..., 3:])
        return (flat + self._centre).reshape(2, 8), H.reshape(2, 8, 6)


def seen_corners(corners: MarkerCorners) -> list[tuple[int, Array]]:
    """Camera number and (8,) pixels of each camera that sees the marker."""
    seen = []
    for camera, pixels in enumerate((corners.left, corners.right)):
        if pixels is None:
            continue
        if np.shape(pixels) != (4, 2):
            raise BadInput(f"expected four corners (4, 2), got shape {np.shape(pixels)}", "corners")
        if np.isfinite(pixels).all():
            seen.append((camera, np.asarray(pixels, dtype=float).ravel()))
    return seen
