"""The pose of a square marker from its four corners in one or both pictures of a stereo rig.

A flat square seen small looks nearly the same when it is tilted the other way: each single picture has two
solutions. Both are starts of a least-squares fit to everything that is seen, and what is seen decides; where
it cannot, the last known pose does. From frame to frame it is enough to refine the last, while that fits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from vita.errors import BadInput
from vita.stereo.base import Lens, MarkerCorners, PoseSight, StereoRig, marker_square
from vita.stereo.projection import NEAREST_M
from vita.types import Array, frozen
from vita.vision import warps

ROUNDS = 12
SAME_FIT = 9.0
"""Two poses whose sums of squared residuals differ by less than this many variances are both possible."""
SAME_TURN = 0.2
"""A pose that fits and is turned like the last one within this needs no other to be compared with [rad]."""


DONE_PX = 1e-3
"""A step that moves no pixel further is the last one; what it leaves is of the order of its square."""


@dataclass(frozen=True, eq=False)
class _Eyes:
    """The k cameras that see the marker, the one in which it is larger first."""

    lenses: tuple[Lens, ...]
    R: Array
    """(k, 3, 3) rotation of left-camera coordinates into each camera's."""
    t: Array
    """(k, 1, 3) [m]."""
    focal: Array
    """(k, 1, 2) [px]."""
    centre: Array
    """(k, 1, 2) [px]."""


@dataclass(frozen=True, eq=False)
class _Views:
    """What they saw."""

    eyes: _Eyes
    corners: Array
    """(k, 4, 2) [px]."""


@dataclass(frozen=True, eq=False)
class _Fit:
    T: Array
    """(4, 4) T_left_marker."""
    residual: Array
    """(8 k,) seen minus expected [px]."""
    slope: Array
    """(8 k, 6) d pixels / d (translation, small rotation)."""
    cost: float
    """Sum of squared residuals [px^2]."""


def marker_pose(
    rig: StereoRig, corners: MarkerCorners, size_m: float, near: Array | None = None
) -> PoseSight:
    """The pose of a marker of side `size_m` [m] that shows these corners.

    `near` (4, 4), the last known T_left_marker, decides between two poses that fit alike. `BadInput` when
    neither camera sees the marker.
    """
    if not (math.isfinite(size_m) and size_m > 0):
        raise BadInput(f"the marker's side must be above 0 m, got {size_m}", "size_m")
    if not (math.isfinite(corners.sigma_px) and corners.sigma_px > 0):
        raise BadInput(f"the corners' noise must be above 0 px, got {corners.sigma_px}", "sigma_px")
    views = _views(rig, corners)
    square = marker_square(size_m)
    variance = corners.sigma_px**2
    last = None if near is None else np.asarray(near, dtype=float)
    best = None if last is None else _refined(views, square, last)
    fits = best is not None and best.cost <= _usual(len(best.residual)) * variance
    if best is None or last is None or not (fits and _angle(best.T, last) <= SAME_TURN):
        best = _chosen(_all_fits(views, square, best), variance, last)
    information = best.slope.T @ best.slope / variance
    return PoseSight(
        frozen(best.T), frozen(np.linalg.inv(information)), math.sqrt(best.cost / len(best.slope))
    )


def _all_fits(views: _Views, square: Array, known: _Fit | None) -> list[_Fit]:
    """What the first picture shows and its mirrored pose, both refined, and `known` if there is that."""
    first = _refined(views, square, _start(views, square))
    if first is None:
        raise BadInput("no square in front of the cameras has its corners there", "corners")
    fits = first, _refined(views, square, _mirrored(views, first.T)), known
    return [fit for fit in fits if fit is not None]


def _views(rig: StereoRig, corners: MarkerCorners) -> _Views:
    seen = []
    for name, pixels in (("left", corners.left), ("right", corners.right)):
        if pixels is None:
            continue
        pixels = np.asarray(pixels, dtype=float)
        # No number that is not finite leaves the area finite.
        if pixels.shape != (4, 2) or not math.isfinite(area := abs(warps.area(pixels))):
            raise BadInput(f"expected four finite pixels, got shape {pixels.shape}", f"corners.{name}")
        if area < 1.0:
            raise BadInput("the four corners are on one line: the marker is seen edge on", f"corners.{name}")
        seen.append((area, name, pixels))
    if not seen:
        raise BadInput("neither camera sees the marker", "corners")
    _, names, quads = zip(*sorted(seen, key=lambda view: -view[0]), strict=True)
    return _Views(_eyes(rig, names), np.array(quads))


@lru_cache(maxsize=16)
def _eyes(rig: StereoRig, names: tuple[str, ...]) -> _Eyes:
    """The same for every frame of a rig, which is known by its identity."""
    lenses = tuple(rig.left if name == "left" else rig.right for name in names)
    T = np.stack([np.eye(4) if name == "left" else rig.T_right_left for name in names])
    return _Eyes(
        lenses,
        T[:, :3, :3],
        T[:, None, :3, 3],
        np.array([[(lens.fx, lens.fy)] for lens in lenses]),
        np.array([[(lens.cx, lens.cy)] for lens in lenses]),
    )


def _start(views: _Views, square: Array) -> Array:
    """(4, 4) the pose T_left_marker that the first picture shows.

    OpenCV's IPPE_SQUARE would give it as a rotation vector, but a marker that looks straight at the camera is
    turned by half a turn, for which OpenCV 5.0 answers with no rotation or none that is a number
    (https://github.com/zauberzeug/rosys/pull/479 met the same).
    """
    # The homography from the marker's plane to rays is (r1, r2, t) of its pose up to a factor.
    R, t = views.eyes.R[0], views.eyes.t[0, 0]
    H = np.linalg.inv(views.eyes.lenses[0].matrix) @ _homography(square[:, :2], views.corners[0])
    H *= np.sign(H[2, 2]) * 2.0 / (np.linalg.norm(H[:, 0]) + np.linalg.norm(H[:, 1]))
    U, _, V = np.linalg.svd(np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])]))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R.T @ (U @ V), R.T @ (H[:, 2] - t)
    return T


def _mirrored(views: _Views, T: Array) -> Array:
    """(4, 4) `T` tilted as far to the other side of the first camera's line of sight; both look alike."""
    sight = T[:3, 3] + views.eyes.R[0].T @ views.eyes.t[0, 0]
    sight, normal = sight / np.linalg.norm(sight), T[:3, 2]
    axis, cosine = np.cross(normal, sight), float(normal @ sight)
    lean = float(np.linalg.norm(axis))
    flipped = T.copy()
    if lean > 1e-9:
        angle = 2.0 * np.arctan2(lean, abs(cosine)) * np.sign(cosine)
        flipped[:3, :3] = cv2.Rodrigues(axis / lean * angle)[0] @ T[:3, :3]
    return flipped


def _homography(square: Array, corners: Array) -> Array:
    """(3, 3) from (4, 2) places of the marker's plane [m] to the picture [px]."""
    carry = cv2.getPerspectiveTransform(square.astype(np.float32), corners.astype(np.float32))
    return np.asarray(carry, np.float64)


def _refined(views: _Views, square: Array, T: Array) -> _Fit | None:
    """The nearest pose with the least squared residuals (Levenberg-Marquardt); None behind a camera."""
    fit, damping = _judged(views, square, T), 1e-4
    if fit is None:
        return None
    for _ in range(ROUNDS):
        normal = fit.slope.T @ fit.slope
        normal.flat[::7] *= 1.0 + damping
        step = np.linalg.solve(normal, fit.slope.T @ fit.residual)
        moved = np.eye(4)
        moved[:3, :3] = cv2.Rodrigues(step[3:])[0] @ fit.T[:3, :3]
        moved[:3, 3] = fit.T[:3, 3] + step[:3]
        shift = fit.slope @ step
        if np.abs(shift).max() < DONE_PX:
            # So near, nothing is learned from another look.
            residual = fit.residual - shift
            return _Fit(moved, residual, fit.slope, float(residual @ residual))
        tried = _judged(views, square, moved)
        if tried is not None and tried.cost <= fit.cost:
            fit, damping = tried, 0.1 * damping
        elif damping > 1e6:
            break
        else:
            damping *= 10.0
    return fit


def _judged(views: _Views, square: Array, T: Array) -> _Fit | None:
    """How well `T` fits, and how the pixels move with it; None where a corner is behind a camera."""
    eyes, arms = views.eyes, square @ T[:3, :3].T
    local = (arms + T[:3, 3]) @ eyes.R.transpose(0, 2, 1) + eyes.t
    depth = local[:, :, 2:]
    if depth.min() <= NEAREST_M:
        return None
    flat = local[:, :, :2] / depth
    # d pixel / d point = focal / depth (R's first two rows - flat times its third).
    shift = (eyes.focal / depth)[..., None] * (eyes.R[:, None, :2] - flat[..., None] * eyes.R[:, None, 2:])
    motion = _SHIFTED + (arms @ _TURNED).reshape(4, 3, 6)
    residual = (views.corners - eyes.centre - flat * eyes.focal).ravel()
    return _Fit(T, residual, (shift @ motion).reshape(-1, 6), float(residual @ residual))


_SHIFTED = np.eye(3, 6)
"""d point / d (translation, small rotation) of the marker's centre."""
_TURNED = np.dstack([np.zeros((3, 3, 3)), np.cross(np.eye(3)[:, None], np.eye(3))]).reshape(3, 18)
"""What each unit of a corner's arm adds: a small rotation w about the left camera moves it by w x arm."""


def _chosen(fits: list[_Fit], variance: float, near: Array | None) -> _Fit:
    """The fit with the least cost, or of those that are as likely the one that is turned like `near`."""
    best = min(fits, key=lambda fit: fit.cost)
    if near is None:
        return best
    likely = [fit for fit in fits if fit.cost - best.cost < SAME_FIT * variance]
    return min(likely, key=lambda fit: _angle(fit.T, near))


def _usual(rows: int) -> float:
    """What a sum of squared residuals of a right fit stays below nineteen times in twenty, in variances."""
    free = rows - 6
    return free + 2.0 * math.sqrt(2.0 * free)


def _angle(T: Array, other: Array) -> float:
    """Angle between the rotations of two poses [rad]."""
    trace = float(np.vdot(T[:3, :3], other[:3, :3]))
    return math.acos(min(max(0.5 * (trace - 1.0), -1.0), 1.0))
