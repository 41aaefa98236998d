"""The parts of the stereo system by themselves: triangulation, the fit of the calibration, the filter."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from vita.experiments.stereo_world import FRAME_S, stereo_rig
from vita.impedance.config import ImpedanceConfig
from vita.poses import look_at
from vita.stereo.base import MarkerCorners, marker_square
from vita.stereo.moved_rig import MovedRig
from vita.stereo.pose_filter import PoseFilter
from vita.stereo.projection import project
from vita.stereo.rigid_fit import rigid_fit
from vita.stereo.triangulate import triangulate, triangulation_covariance
from vita.types import Array
from vita.vision.marker_pose import marker_pose


def triangulations(count: int, seed: int) -> dict[str, float]:
    """TUM eq. 1 to 6 over random points 0.6 to 2 m away: the largest error without noise [m], and the mean
    squared Mahalanobis distance at 0.2 px, which is 3 where the predicted covariance is right."""
    random, rig = np.random.default_rng(seed), stereo_rig(800.0)
    points = random.uniform((-0.3, -0.3, 0.6), (0.3, 0.3, 2.0), (count, 3))
    left, right = project(rig.left, points), project(rig.right, points + rig.T_right_left[:3, 3])
    exact = float(np.linalg.norm(triangulate(rig, left, right) - points, axis=1).max())
    noise = 0.2 * random.standard_normal((2, count, 2))
    off = triangulate(rig, left + noise[0], right + noise[1]) - points
    distances = [
        o @ np.linalg.solve(triangulation_covariance(rig, p, 0.2), o)
        for o, p in zip(off, points, strict=True)
    ]
    return {"exact_m": exact, "mahalanobis": float(np.mean(distances))}


def fits(pairs: int, count: int, seed: int, spread_m: float = 0.2, noise_m: float = 1e-3) -> Array:
    """(count, 3) rotation error [deg], error of a recovered point among the pairs [mm], and the rotation
    error of eq. 11 as it is printed [deg], for random cameras and `pairs` pairs spread over `spread_m`."""
    random = np.random.default_rng([seed, pairs])
    found = np.empty((count, 3))
    for i in range(count):
        R, t = Rotation.random(rng=random).as_matrix(), random.uniform(-1, 1, 3)
        base = random.uniform(-spread_m / 2, spread_m / 2, (pairs, 3))
        left = (base - t) @ R + noise_m * random.standard_normal((pairs, 3))
        T = rigid_fit(left, base).T
        point = random.uniform(-spread_m / 2, spread_m / 2, 3)
        back = T[:3, :3] @ (R.T @ (point - t)) + T[:3, 3]
        printed = _as_printed(left, base)
        found[i] = _angle(T[:3, :3], R), 1e3 * np.linalg.norm(back - point), _angle(printed, R)
    return found


def _as_printed(a: Array, b: Array) -> Array:
    """(3, 3) eq. 10 and 11 letter by letter: the transpose of the rotation that is wanted."""
    U, _, Vt = np.linalg.svd((a - a.mean(axis=0)).T @ (b - b.mean(axis=0)))
    return U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt


def _angle(A: Array, B: Array) -> float:
    return float(np.degrees(Rotation.from_matrix(A.T @ B).magnitude()))


SIGHT_M = np.array([3e-4, 3e-4, 1.5e-3])
"""Noise of where a marker 1.2 m away is seen, along the left camera's axes [m]."""
ALIKE = 0.6
"""Correlation of one picture's error with the next one's: tracked corners err alike while little moves."""


def moved_cameras(pictures: int, moves: int, shift_m: float, seed: int) -> dict[str, float]:
    """False alarms among `pictures` of cameras that stand, steady error included; and, of `moves` by
    `shift_m` in random directions, the share that is noticed within a second and the median time [s]."""
    random, covariance = np.random.default_rng([seed, 7]), np.diag(SIGHT_M**2)
    settings = ImpedanceConfig()

    def watch() -> MovedRig:
        return MovedRig(1e-3 * settings.moved_mm, settings.moved_frames)

    watched, alarms = watch(), 0
    for offset in _sights(random, pictures) + 3e-4:
        if watched.update(offset, covariance):
            alarms += 1
            watched.restart()
    taken = []
    for _ in range(moves):
        way = random.standard_normal(3)
        watched, later = watch(), shift_m / np.linalg.norm(way) * way
        for offset in _sights(random, 60):
            watched.update(offset, covariance)
        after = _sights(random, 300) + later
        noticed = (i for i, offset in enumerate(after) if watched.update(offset, covariance))
        taken.append(next(noticed, np.inf) * FRAME_S)
    within = float(np.mean(np.array(taken) <= 1.0))
    return {"alarms": float(alarms), "within_1_s": within, "median_s": float(np.median(taken))}


def _sights(random: np.random.Generator, count: int) -> Array:
    """(count, 3) offsets of a tool that is seen where it is, noise apart [m]."""
    errors = random.standard_normal((count, 3))
    for k in range(1, count):
        errors[k] = ALIKE * errors[k - 1] + np.sqrt(1 - ALIKE**2) * errors[k]
    return errors * SIGHT_M


def filtered(speed_m_s: float, turn_deg_s: float, seed: int, sigma_px: float = 0.3) -> tuple[float, float]:
    """Root mean square error [mm] over time steps of 1 ms of the filter and of holding the last measurement,
    for a target 1 m away on a circle of 0.1 m (TUM IV-A: pictures each 30 ms, an estimate each 1 ms)."""
    random, rig, size = np.random.default_rng(seed), stereo_rig(800.0), 0.08
    T_left_base = np.linalg.inv(look_at((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    radius = 0.1

    def pose(now: float) -> Array:
        angle = speed_m_s / radius * now
        T = np.eye(4)
        facing = Rotation.from_euler("xyz", (90, 0, 90), degrees=True)
        sway = Rotation.from_rotvec([0, 0, np.radians(15) * np.sin(np.radians(turn_deg_s) / 0.2618 * now)])
        T[:3, :3] = (sway * facing).as_matrix()
        T[:3, 3] = 0.0, radius * np.sin(angle), radius * np.cos(angle)
        return T_left_base @ T

    pose_filter = PoseFilter(rig, size)
    held, errors = None, []
    for k in range(240):
        stamp = k * FRAME_S
        T = pose(stamp)
        points = marker_square(size) @ T[:3, :3].T + T[:3, 3]
        left = project(rig.left, points) + sigma_px * random.standard_normal((4, 2))
        right = project(rig.right, points + rig.T_right_left[:3, 3])
        right = right + sigma_px * random.standard_normal((4, 2))
        corners = MarkerCorners(left, right, sigma_px)
        sight = marker_pose(rig, corners, size)
        pose_filter.update(stamp, corners, sight)
        held = sight.T_left_marker[:3, 3]
        if k < 30:
            continue
        for step in range(33):
            later = stamp + 1e-3 * step
            estimate, truth = pose_filter.at(later), pose(later)[:3, 3]
            assert estimate is not None
            off = estimate.T_left_marker[:3, 3] - truth
            errors.append((off @ off, (held - truth) @ (held - truth)))
    ours, holding = 1e3 * np.sqrt(np.mean(errors, axis=0))
    return float(ours), float(holding)
