"""The pose of a square marker from its four corners in one or both pictures of a stereo rig.

A flat square seen small looks nearly the same when it is tilted the other way: each single picture has two
solutions. Both are starts of a least-squares fit to everything that is seen, and what is seen decides; where
it cannot, the last known pose does.
"""

from __future__ import annotations

from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class _Views:
    """What the k cameras that see the marker saw, the one in which it is larger first."""

    lenses: tuple[Lens, ...]
    R: Array
    """(k, 3, 3) rotation of left-camera coordinates into each camera's."""
    t: Array
    """(k, 1, 3) [m]."""
    focal: Array
    """(k, 1, 2) [px]."""
    centre: Array
    """(k, 1, 2) [px]."""
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

    @property
    def cost(self) -> float:
        """Sum of squared residuals [px^2]."""
        return float(self.residual @ self.residual)


def marker_pose(
    rig: StereoRig, corners: MarkerCorners, size_m: float, near: Array | None = None
) -> PoseSight:
    """The pose of a marker of side `size_m` [m] that shows these corners.

    `near` (4, 4), the last known T_left_marker, decides between two poses that fit alike. `BadInput` when
    neither camera sees the marker.
    """
    if not (np.isfinite(size_m) and size_m > 0):
        raise BadInput(f"the marker's side must be above 0 m, got {size_m}", "size_m")
    if not (np.isfinite(corners.sigma_px) and corners.sigma_px > 0):
        raise BadInput(f"the corners' noise must be above 0 px, got {corners.sigma_px}", "sigma_px")
    views = _views(rig, corners)
    square = marker_square(size_m)
    first = _refined(views, square, _start(views, square))
    if first is None:
        raise BadInput("no square in front of the cameras has its corners there", "corners")
    fits, variance = [first], corners.sigma_px**2
    last = None if near is None else np.asarray(near, dtype=float)
    if (
        last is None
        or _angle(first.T, last) > SAME_TURN
        or first.cost > _usual(len(first.residual)) * variance
    ):
        starts = [_mirrored(views, first.T)] if last is None else [_mirrored(views, first.T), last]
        fits += [fit for T in starts if (fit := _refined(views, square, T)) is not None]
    best = _chosen(fits, variance, last)
    information = best.slope.T @ best.slope / variance
    return PoseSight(
        frozen(best.T), frozen(np.linalg.inv(information)), float(np.sqrt(best.cost / len(best.slope)))
    )


def _views(rig: StereoRig, corners: MarkerCorners) -> _Views:
    seen = []
    for name, lens, T, pixels in (
        ("left", rig.left, np.eye(4), corners.left),
        ("right", rig.right, rig.T_right_left, corners.right),
    ):
        if pixels is None:
            continue
        pixels = np.asarray(pixels, dtype=float)
        if pixels.shape != (4, 2) or not np.isfinite(pixels).all():
            raise BadInput(f"expected four finite pixels, got shape {pixels.shape}", f"corners.{name}")
        area = abs(warps.area(pixels))
        if area < 1.0:
            raise BadInput("the four corners are on one line: the marker is seen edge on", f"corners.{name}")
        seen.append((area, lens, T, pixels))
    if not seen:
        raise BadInput("neither camera sees the marker", "corners")
    _, lenses, poses, quads = zip(*sorted(seen, key=lambda view: -view[0]), strict=True)
    T = np.stack(poses)
    return _Views(
        lenses,
        T[:, :3, :3],
        T[:, None, :3, 3],
        np.array([[(lens.fx, lens.fy)] for lens in lenses]),
        np.array([[(lens.cx, lens.cy)] for lens in lenses]),
        np.stack(quads),
    )


def _start(views: _Views, square: Array) -> Array:
    """(4, 4) the pose T_left_marker that the first picture shows.

    OpenCV's IPPE_SQUARE would give it as a rotation vector, but a marker that looks straight at the camera is
    turned by half a turn, for which OpenCV 5.0 answers with no rotation or none that is a number
    (https://github.com/zauberzeug/rosys/pull/479 met the same).
    """
    # The homography from the marker's plane to rays is (r1, r2, t) of its pose up to a factor.
    H = np.linalg.inv(views.lenses[0].matrix) @ _homography(square[:, :2], views.corners[0])
    H *= np.sign(H[2, 2]) * 2.0 / (np.linalg.norm(H[:, 0]) + np.linalg.norm(H[:, 1]))
    U, _, V = np.linalg.svd(np.column_stack([H[:, 0], H[:, 1], np.cross(H[:, 0], H[:, 1])]))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = views.R[0].T @ (U @ V), views.R[0].T @ (H[:, 2] - views.t[0, 0])
    return T


def _mirrored(views: _Views, T: Array) -> Array:
    """(4, 4) `T` tilted as far to the other side of the first camera's line of sight; both look alike."""
    sight = T[:3, 3] + views.R[0].T @ views.t[0, 0]
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
        tried = _judged(views, square, moved)
        if tried is not None and tried.cost <= fit.cost:
            # The error left is of the order of the square of the last step.
            done = np.abs(fit.slope @ step).max() < 1e-4
            fit, damping = tried, 0.1 * damping
            if done:
                break
        elif damping > 1e6:
            break
        else:
            damping *= 10.0
    return fit


def _judged(views: _Views, square: Array, T: Array) -> _Fit | None:
    """How well `T` fits, and how the pixels move with it; None where a corner is behind a camera."""
    arms = square @ T[:3, :3].T
    local = (arms + T[:3, 3]) @ np.swapaxes(views.R, 1, 2) + views.t
    depth = local[:, :, 2:]
    if depth.min() <= NEAREST_M:
        return None
    flat, scale = local[:, :, :2] / depth, views.focal / depth
    # d pixel / d point = focal / depth (R's first two rows - flat times its third).
    shift = scale[..., None] * (views.R[:, None, :2] - flat[..., None] * views.R[:, None, 2:])
    # A small rotation w about the left camera's axes moves a corner by w x arm; a.(w x arm) = w.(arm x a).
    x, y, z = arms.T[:, :, None]
    a, b, c = shift[..., 0], shift[..., 1], shift[..., 2]
    slope = np.empty((*shift.shape[:3], 6))
    slope[..., :3] = shift
    slope[..., 3], slope[..., 4], slope[..., 5] = y * c - z * b, z * a - x * c, x * b - y * a
    residual = views.corners - flat * views.focal - views.centre
    return _Fit(T, residual.ravel(), slope.reshape(-1, 6))


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
    return free + 2.0 * float(np.sqrt(2.0 * free))


def _angle(T: Array, other: Array) -> float:
    """Angle between the rotations of two poses [rad]."""
    turn = T[:3, :3].T @ other[:3, :3]
    return float(np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0)))
