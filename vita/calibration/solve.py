"""One camera: its intrinsics from views of the board (Zhang's method, OpenCV's solver)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from vita.calibration.board import MIN_CORNERS, Board
from vita.calibration.detect import Sighting
from vita.errors import BadInput
from vita.stereo.base import Lens
from vita.types import Array

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
LEAST_VIEWS = 3
"""Views below which intrinsics cannot be had: each gives two equations for four unknowns."""
_NO_K = (cv2.CALIB_FIX_K1, cv2.CALIB_FIX_K2, cv2.CALIB_FIX_K3)
MODELS: Mapping[tuple[str, ...], int] = {
    ("k1", "k2", "p1", "p2"): _NO_K[2],
    ("k1", "k2"): cv2.CALIB_ZERO_TANGENT_DIST | _NO_K[2],
    ("k1",): cv2.CALIB_ZERO_TANGENT_DIST | _NO_K[1] | _NO_K[2],
    (): cv2.CALIB_ZERO_TANGENT_DIST | _NO_K[0] | _NO_K[1] | _NO_K[2],
}
"""Distortion coefficients that are solved for, from all to none, and OpenCV's flags for it."""
KNOWN = {"k1": 0.3, "k2": 0.5, "p1": 0.003, "p2": 0.003}
"""Standard deviations above which a coefficient is not borne by the data: it could be as large as any lens'.

A test of whether a coefficient differs from 0 would not do: tangential ones that noise hides would be dropped
and the principal point, which they trade with, would be off by several of its own standard deviations.
"""
_ROUNDS = 5
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-10)


@dataclass(frozen=True, eq=False)
class CameraFit:
    """What the views of one camera tell about it."""

    values: Array
    """(8,) of `NAMES`."""
    sd: Array
    """(8,) predicted standard deviations; 0 for what was not solved for."""
    terms: tuple[str, ...]
    """Distortion coefficients that the data bear."""
    size: tuple[int, int]
    """Width and height of the pictures [px]."""
    poses: Mapping[str, Array]
    """View name to (6,): rotation vector and position [m] of the board in this camera."""
    errors: Mapping[str, float]
    """View name to root mean square of its corners' distances [px]."""
    rms_px: float
    """Of all of them."""
    sights: Mapping[str, Sighting]
    """View name to the corners that the fit used."""

    @property
    def lens(self) -> Lens:
        last = max((NAMES.index(term) for term in self.terms), default=3)
        distortion = tuple(map(float, self.values[4:8])) if last > 3 else ()
        fx, fy, cx, cy = map(float, self.values[:4])
        return Lens(fx, fy, cx, cy, distortion)


def solve_camera(
    board: Board, sights: Mapping[str, Sighting], size: tuple[int, int]
) -> tuple[CameraFit, list[str]]:
    """The fit to the views that agree, and a line about each view that was dropped."""
    if len(sights) < LEAST_VIEWS:
        raise BadInput(
            f"only {len(sights)} views show {board.words}; {LEAST_VIEWS} are the least, 15 are good"
        )
    left, said = dict(sights), []
    fit = _best_model(board, left, size)
    for _ in range(_ROUNDS):
        # Single corners first: a view must not go for one finger that covers it.
        kept = {name: _without_strays(board, sight, fit, name) for name, sight in left.items()}
        if sum(len(s.ids) for s in kept.values()) == sum(len(s.ids) for s in left.values()):
            bad = outliers(fit.errors)
            if not bad or len(left) - len(bad) < max(LEAST_VIEWS, 0.7 * len(sights)):
                break  # If so many disagree, who is right is not for us to say; the rms will tell.
            said += [f"{name}: {fit.errors[name]:.2f} px off what the others agree on" for name in bad]
            kept = {name: sight for name, sight in left.items() if name not in bad}
        left = kept
        fit = _best_model(board, left, size)
    return fit, said


def _without_strays(board: Board, sight: Sighting, fit: CameraFit, name: str) -> Sighting:
    """Without the corners that lie far off: a marker's edge was taken for the square's, or a finger's."""
    pose = fit.poses[name]
    distortion = np.append(fit.values[4:], 0.0)
    uv = cv2.projectPoints(board.corners[sight.ids], pose[:3], pose[3:], fit.lens.matrix, distortion)[0]
    off = np.linalg.norm(np.reshape(uv, (-1, 2)) - sight.uv, axis=1)
    near = off < max(6 * float(np.median(off)), 0.25)
    return sight if near.all() or near.sum() < MIN_CORNERS else sight.only(near)


def outliers(errors: Mapping[str, float]) -> list[str]:
    """Names of the views that fit much worse than most."""
    values = np.array(list(errors.values()))
    middle = float(np.median(values))
    spread = 1.4826 * float(np.median(np.abs(values - middle)))
    # Twice the usual is no reason alone: blur and distance make honest views differ by that much.
    limit = max(2.5 * middle, middle + 5 * spread, 0.2)
    return [name for name, value in errors.items() if value > limit]


def _best_model(board: Board, sights: Mapping[str, Sighting], size: tuple[int, int]) -> CameraFit:
    """The fit with as many coefficients as the data bear."""
    for terms in MODELS:
        fit = _fit(board, sights, size, terms)
        if fit is not None and all(fit.sd[NAMES.index(term)] <= KNOWN[term] for term in terms):
            return fit
    raise BadInput(
        "no camera explains these views: is the number of squares right, and is every picture from the "
        "same camera with the same zoom?"
    )


def _fit(
    board: Board, sights: Mapping[str, Sighting], size: tuple[int, int], terms: tuple[str, ...]
) -> CameraFit | None:
    points = [board.corners[sight.ids].astype(np.float32) for sight in sights.values()]
    pixels = [sight.uv.astype(np.float32) for sight in sights.values()]
    # Views that are all parallel leave the solver's own first guess without an answer; this one always works.
    guess = Lens(1.2 * size[0], 1.2 * size[0], (size[0] - 1) / 2, (size[1] - 1) / 2).matrix
    found = []
    for extra in (0, cv2.CALIB_USE_INTRINSIC_GUESS):
        flags = MODELS[terms] | extra
        try:
            out = cv2.calibrateCameraExtended(
                points, pixels, size, guess.copy(), np.zeros(5), flags=flags, criteria=_STOP
            )
        except cv2.error:
            continue
        K_found = np.asarray(out[1])
        if np.isfinite(out[0]) and np.isfinite(K_found).all() and K_found[0, 0] > 0 and K_found[1, 1] > 0:
            found.append(out)
            break
    if not found:
        return None
    rms, K, dist, rvecs, tvecs, sd, _, errors = found[0]
    names = list(sights)
    values = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *np.ravel(dist)[:4]])
    return CameraFit(
        values,
        np.ravel(sd)[:8].astype(float),
        terms,
        size,
        {n: np.concatenate([np.ravel(r), np.ravel(t)]) for n, r, t in zip(names, rvecs, tvecs, strict=True)},
        dict(zip(names, np.ravel(errors).astype(float).tolist(), strict=True)),
        float(rms),
        dict(sights),
    )
