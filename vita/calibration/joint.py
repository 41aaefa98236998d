"""Least squares over two cameras, how they stand to one another, and the board's pose in every view."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from vita.calibration.board import Board
from vita.calibration.detect import Sighting
from vita.calibration.solve import NAMES, CameraFit
from vita.stereo.base import StereoRig
from vita.types import Array


@dataclass(frozen=True, eq=False)
class PairFit:
    """What the pairs of pictures tell."""

    rig: StereoRig
    cameras: tuple[CameraFit, CameraFit]
    """Both cameras after the common fit."""
    pairs: tuple[str, ...]
    """Names of the views that both cameras see."""
    rms_px: float
    baseline_sd: float
    """Predicted standard deviation of the distance between the cameras [m]."""
    rotation_sd_deg: float
    """Predicted standard deviation of their rotation, all three axes together [deg]."""


class Joint:
    """All unknowns at once, started from the fits of the single cameras.

    OpenCV's `stereoCalibrate` uses common corners only and tells no standard deviations; this one also uses
    the views that a single camera sees, which tell most about the rims of the pictures.
    """

    def __init__(self, board: Board, fits: tuple[CameraFit, CameraFit], dropped: set[str]) -> None:
        self._board, self._fits = board, fits
        self._names = [n for n in dict.fromkeys([*fits[0].errors, *fits[1].errors]) if n not in dropped]
        # The columns of `NAMES` that are solved for; the others stay 0.
        self._free = [[0, 1, 2, 3, *(NAMES.index(term) for term in fit.terms)] for fit in fits]
        self._start = [0, len(self._free[0]), len(self._free[0]) + len(self._free[1])]
        self._poses = self._start[2] + 6

    def solve(self, T: Array, pairs: list[str]) -> PairFit:
        x0 = np.concatenate([self._fits[0].values[self._free[0]], self._fits[1].values[self._free[1]], T])
        x0 = np.concatenate([x0, *(self._pose(name, T) for name in self._names)])
        done = least_squares(
            lambda x: self._evaluate(x)[0],
            x0,
            lambda x: self._evaluate(x)[1],  # type: ignore[arg-type]
            x_scale="jac",
            xtol=1e-10,
            ftol=1e-10,
            max_nfev=30,
        )
        residuals, J = self._evaluate(done.x)
        sigma2 = float(residuals @ residuals) / max(len(residuals) - len(done.x), 1)
        covariance = sigma2 * _inverse(J.T @ J)
        return self._result(done.x, residuals, covariance, pairs)

    def _pose(self, name: str, T: Array) -> Array:
        """(6,) first guess of the board's pose in the left camera."""
        if name in self._fits[0].poses:
            return self._fits[0].poses[name]
        back = np.asarray(cv2.Rodrigues(T[:3])[0]).T
        seen = self._fits[1].poses[name]
        r, t = cv2.composeRT(seen[:3], seen[3:], np.ravel(-T[:3]), np.ravel(-back @ T[3:]))[:2]
        return _six(r, t)

    def _evaluate(self, x: Array) -> tuple[Array, Array]:
        """Residuals (m,) [px] and their derivatives (m, n)."""
        rows, blocks, T = [], [], x[self._start[2] : self._poses]
        for i, name in enumerate(self._names):
            at = slice(self._poses + 6 * i, self._poses + 6 * i + 6)
            for camera in (0, 1):
                if name not in self._fits[camera].errors:
                    continue
                residual, intrinsic, by_pose, by_T = self._one(
                    x, camera, self._fits[camera].sights[name], x[at], T
                )
                J = np.zeros((len(residual), len(x)))
                J[:, self._start[camera] : self._start[camera + 1]] = intrinsic
                J[:, at] = by_pose
                if by_T is not None:
                    J[:, self._start[2] : self._poses] = by_T
                rows.append(residual)
                blocks.append(J)
        return np.concatenate(rows), np.concatenate(blocks)

    def _one(
        self, x: Array, camera: int, sight: Sighting, pose: Array, T: Array
    ) -> tuple[Array, Array, Array, Array | None]:
        """One picture: residuals and derivatives by the intrinsics, by the board's pose, by the cameras'."""
        chain_pose, chain_T = np.eye(6), None
        r, t = pose[:3], pose[3:]
        if camera == 1:
            r, t, *d = cv2.composeRT(r, t, T[:3], T[3:])
            # dr3dr1, dr3dt1, dr3dr2, dr3dt2, dt3dr1, dt3dt1, dt3dr2, dt3dt2
            chain_pose = np.block([[d[0], d[1]], [d[4], d[5]]])
            chain_T = np.block([[d[2], d[3]], [d[6], d[7]]])
        values = self._values(x, camera)
        K = np.array([[values[0], 0, values[2]], [0, values[1], values[3]], [0, 0, 1.0]])
        points = self._board.corners[sight.ids]
        uv, J = cv2.projectPoints(points, np.ravel(r), np.ravel(t), K, np.append(values[4:], 0.0))[:2]
        J = np.asarray(J, np.float64)
        # OpenCV's columns: rotation, translation, fx fy, cx cy, k1 k2 p1 p2 k3.
        intrinsic = J[:, 6:14][:, self._free[camera]]
        residual = np.ravel(uv).astype(float) - sight.uv.ravel()
        return residual, intrinsic, J[:, :6] @ chain_pose, None if chain_T is None else J[:, :6] @ chain_T

    def _values(self, x: Array, camera: int) -> Array:
        values = np.zeros(len(NAMES))
        values[self._free[camera]] = x[self._start[camera] : self._start[camera + 1]]
        return values

    def _result(self, x: Array, residuals: Array, covariance: Array, pairs: list[str]) -> PairFit:
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        squares = (residuals**2).reshape(-1, 2).sum(axis=1)
        errors: tuple[dict[str, float], dict[str, float]] = ({}, {})
        poses: tuple[dict[str, Array], dict[str, Array]] = ({}, {})
        T, first = x[self._start[2] : self._poses], 0
        for i, name in enumerate(self._names):
            pose = x[self._poses + 6 * i : self._poses + 6 * i + 6]
            for camera in (0, 1):
                if name not in self._fits[camera].errors:
                    continue
                count = len(self._fits[camera].sights[name].ids)
                errors[camera][name] = float(np.sqrt(squares[first : first + count].mean()))
                first += count
                r, t = (
                    (pose[:3], pose[3:])
                    if camera == 0
                    else cv2.composeRT(pose[:3], pose[3:], T[:3], T[3:])[:2]
                )
                poses[camera][name] = _six(r, t)
        cameras = []
        for camera, fit in enumerate(self._fits):
            own = np.zeros(len(NAMES))
            own[self._free[camera]] = sd[self._start[camera] : self._start[camera + 1]]
            counts = [len(self._fits[camera].sights[n].ids) for n in errors[camera]]
            mean = np.average(np.square(list(errors[camera].values())), weights=counts)
            cameras.append(
                CameraFit(
                    self._values(x, camera),
                    own,
                    fit.terms,
                    fit.size,
                    poses[camera],
                    errors[camera],
                    float(np.sqrt(mean)),
                    fit.sights,
                )
            )
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(T[:3])[0], T[3:]
        shift = covariance[self._start[2] + 3 : self._poses, self._start[2] + 3 : self._poses]
        along = T[3:] / max(float(np.linalg.norm(T[3:])), 1e-12)
        turn = sd[self._start[2] : self._start[2] + 3]
        return PairFit(
            StereoRig(cameras[0].lens, cameras[1].lens, pose),
            (cameras[0], cameras[1]),
            tuple(pairs),
            float(np.sqrt(squares.mean())),
            float(np.sqrt(along @ shift @ along)),
            float(np.degrees(np.linalg.norm(turn))),
        )


def _six(r: ArrayLike, t: ArrayLike) -> Array:
    """(6,) rotation vector and position of OpenCV's two columns."""
    return np.concatenate([np.ravel(r), np.ravel(t)]).astype(float)


def _inverse(normal: Array) -> Array:
    """The inverse of a normal matrix of unknowns with different units; infinite where nothing is known."""
    scale = np.sqrt(np.diag(normal))
    try:
        return np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)
    except np.linalg.LinAlgError:
        return np.diag(np.full(len(normal), np.inf))
