"""Points in space from two pictures (TUM eq. 1 to 6), and how well they are known.

Equation 6 minimises an algebraic error that has no meaning in the pictures and squares the condition number.
Here its rows are written in normalised coordinates (K taken off), where they are of like size, solved without
squaring, and the result is then moved to where the point is seen nearest to both pixels: the most likely
point under equal noise in both pictures.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.stereo.base import StereoRig
from vita.stereo.projection import NEAREST_M, pixel_slope, project, rays
from vita.types import Array

SIGMA_PX = 0.2
"""What a pixel is off, unless told otherwise [px]."""
CLEAR_ANGLE = 3.0
"""Two rays must meet at this many times the error of their angle: the depth is then known to a third."""
STEPS = 3
"""Gauss-Newton steps; each one squares the error left, and the start is already good to some 1e-3."""


def triangulate(rig: StereoRig, left: Array, right: Array, sigma_px: float = SIGMA_PX) -> Array:
    """(..., 3) points in left-camera coordinates [m] from their undistorted pixels (..., 2) in both pictures.

    `sigma_px` says how far a pixel may be off; it only decides which rays count as parallel. `BadInput`
    says why a point cannot be had: not finite, no baseline, parallel rays, behind a camera.
    """
    left, right = _pixels(left, "left"), _pixels(right, "right")
    if left.shape != right.shape:
        raise BadInput(f"one pixel for each of the left, got shapes {left.shape} and {right.shape}", "right")
    _check_baseline(rig)
    seen_left, seen_right = rays(rig.left, left), rays(rig.right, right)
    R, t = rig.T_right_left[:3, :3], rig.T_right_left[:3, 3]
    _check_angle(rig, seen_left, seen_right @ R, sigma_px)
    # Eq. 4 and 5 with P_L = [I 0] and P_R = [R t]: x (row 3) - (row 1) = 0 and the same for y.
    rows, sides = [], []
    for seen, P in ((seen_left, np.eye(4)[:3]), (seen_right, rig.T_right_left[:3])):
        for k in (0, 1):
            rows.append(seen[..., k, None] * P[2, :3] - P[k, :3])
            sides.append(P[k, 3] - seen[..., k] * P[2, 3])
    A, B = np.stack(rows, axis=-2), np.stack(sides, axis=-1)
    points = _least_squares(A, B)
    _check_front(points, points @ R.T + t)
    for _ in range(STEPS):
        slope = _slope(rig, points)
        missed = np.concatenate(
            [left - project(rig.left, points), right - project(rig.right, points @ R.T + t)], axis=-1
        )
        points = points + _least_squares(slope, missed)
        _check_front(points, points @ R.T + t)
    return points


def triangulation_covariance(rig: StereoRig, point: Array, sigma_px: float = SIGMA_PX) -> Array:
    """(3, 3) covariance [m^2] of `triangulate` at (3,) `point`, for `sigma_px` of noise in each coordinate.

    Refused, as there, where the two rays to the point are as good as parallel.
    """
    point = np.asarray(point, dtype=float)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise BadInput(f"expected three finite coordinates, got {point}", "point")
    if not (np.isfinite(sigma_px) and sigma_px > 0):
        raise BadInput(f"the noise must be above 0 px, got {sigma_px}", "sigma_px")
    _check_baseline(rig)
    R, t = rig.T_right_left[:3, :3], rig.T_right_left[:3, 3]
    _check_front(point, R @ point + t)
    _check_angle(rig, point, point + R.T @ t, sigma_px)
    slope = _slope(rig, point)
    return np.asarray(np.linalg.inv(slope.T @ slope) * sigma_px**2, np.float64)


def _slope(rig: StereoRig, points: Array) -> Array:
    """(..., 4, 3) d (left pixel, right pixel) / d point [px/m]."""
    R, t = rig.T_right_left[:3, :3], rig.T_right_left[:3, 3]
    right = pixel_slope(rig.right, points @ R.T + t) @ R
    return np.concatenate([pixel_slope(rig.left, points), right], axis=-2)


def _least_squares(A: Array, B: Array) -> Array:
    """(..., n) the x with the least |A x - B|, for (..., m, n) A and (..., m) B."""
    Q, triangle = np.linalg.qr(A)
    x = np.linalg.solve(triangle, np.swapaxes(Q, -1, -2) @ B[..., None])
    return np.asarray(x[..., 0], np.float64)


def _pixels(values: Array, name: str) -> Array:
    pixels = np.asarray(values, dtype=float)
    if pixels.ndim == 0 or pixels.shape[-1] != 2:
        raise BadInput(f"expected pixels (column, row), got shape {pixels.shape}", name)
    if not np.isfinite(pixels).all():
        raise BadInput(f"pixel{_first(~np.isfinite(pixels).all(axis=-1))} is not finite", name)
    return pixels


def _check_baseline(rig: StereoRig) -> None:
    if rig.baseline < 1e-9:
        raise BadInput("both cameras are at the same place: without a baseline there is no depth", "rig")


def _check_angle(rig: StereoRig, one: Array, other: Array, sigma_px: float) -> None:
    """Refuse rays (..., 3), both in left-camera coordinates, whose angle drowns in the noise."""
    one, other = (v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (one, other))
    angle = np.arctan2(np.linalg.norm(np.cross(one, other), axis=-1), (one * other).sum(axis=-1))
    noise = float(np.hypot(sigma_px / rig.left.fx, sigma_px / rig.right.fx))
    least = max(CLEAR_ANGLE * noise, 1e-9)
    parallel = angle < least
    if parallel.any():
        raise BadInput(
            f"the rays{_first(parallel)} to the two cameras are parallel: they meet at "
            f"{np.degrees(angle[parallel].flat[0] if angle.ndim else angle):.2g} degrees, and less than "
            f"{np.degrees(least):.2g} says nothing about the distance",
            "right",
        )


def _check_front(left: Array, right: Array) -> None:
    """Refuse points, given (..., 3) in each camera's coordinates, that are not in front of both."""
    for name, points in (("left", left), ("right", right)):
        behind = ~(points[..., 2] > NEAREST_M)
        if behind.any():
            raise BadInput(f"the point{_first(behind)} lies behind the {name} camera", name)


def _first(bad: NDArray[np.bool_] | np.bool_) -> str:
    """' 3' where the bad one is the fourth of several, nothing where there is only one."""
    if np.ndim(bad) == 0:
        return ""
    where = np.argwhere(bad)[0].tolist()
    return f" {where[0] if len(where) == 1 else tuple(where)}"
