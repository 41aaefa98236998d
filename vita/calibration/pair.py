"""Two cameras: how they stand to one another."""

from __future__ import annotations

import cv2
import numpy as np

from vita.calibration.board import MIN_CORNERS, Board
from vita.calibration.joint import Joint, PairFit
from vita.calibration.solve import CameraFit, outliers
from vita.errors import BadInput
from vita.types import Array

LEAST_PAIRS = 2
"""Pairs below which nothing would tell a wrong one."""


def solve_pair(board: Board, fits: tuple[CameraFit, CameraFit]) -> tuple[PairFit, list[str]]:
    """The common fit, started from the two single ones, and a line about each pair that was dropped."""
    pairs = _pairs(fits)
    if len(pairs) < LEAST_PAIRS:
        raise BadInput(
            f"only {len(pairs)} pairs show {MIN_CORNERS} corners of the board to both cameras at once; "
            f"{LEAST_PAIRS} are the least, 15 are good"
        )
    said: list[str] = []
    T, errors = _first_guess(board, fits, pairs)
    bad = outliers(errors)
    if len(pairs) - len(bad) < max(LEAST_PAIRS, 0.7 * len(pairs)):
        bad = []
    if bad:
        said = [f"{n}: the two pictures disagree by {errors[n]:.2f} px; was the board moving?" for n in bad]
        pairs = [name for name in pairs if name not in bad]
        T, _ = _first_guess(board, fits, pairs)
    return Joint(board, fits, set(bad)).solve(T, pairs), said


def _pairs(fits: tuple[CameraFit, CameraFit]) -> list[str]:
    names = [n for n in fits[0].errors if n in fits[1].errors]
    return [
        n for n in names if len(np.intersect1d(fits[0].sights[n].ids, fits[1].sights[n].ids)) >= MIN_CORNERS
    ]


def _first_guess(
    board: Board, fits: tuple[CameraFit, CameraFit], pairs: list[str]
) -> tuple[Array, dict[str, float]]:
    """(6,) rotation vector and translation, left camera to right, and each pair's error [px]."""
    points, left, right = [], [], []
    for name in pairs:
        a, b = fits[0].sights[name], fits[1].sights[name]
        ids, i, j = np.intersect1d(a.ids, b.ids, return_indices=True)
        points.append(board.corners[ids].astype(np.float32))
        left.append(a.uv[i].astype(np.float32))
        right.append(b.uv[j].astype(np.float32))
    known = [x for fit in fits for x in (fit.lens.matrix, np.append(fit.values[4:], 0.0))]
    out = cv2.stereoCalibrateExtended(
        points, left, right, *known, fits[0].size, np.eye(3), np.zeros(3), flags=cv2.CALIB_FIX_INTRINSIC
    )  # type: ignore[call-overload]
    R, t, errors = out[5], out[6], np.asarray(out[-1]).reshape(len(pairs), -1)
    guess = np.concatenate([np.ravel(cv2.Rodrigues(np.asarray(R))[0]), np.ravel(t)])
    return guess.astype(float), dict(zip(pairs, errors.max(axis=1).tolist(), strict=True))
