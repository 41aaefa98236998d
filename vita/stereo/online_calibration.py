"""Where the cameras stand with respect to the robot, learned while the arm moves (TUM II-C, eq. 8 to 12).

Arun's fit treats every direction alike, but a point seen by two cameras is several times less certain along
the ray than across it. Its result is therefore only the start: a few Newton steps then weigh each pair by its
own covariance, with Tukey's weights against wild pairs.
"""

from __future__ import annotations

import math

import numpy as np

from vita.errors import BadInput
from vita.stereo.base import BaseFromCamera
from vita.stereo.pair_store import PairStore
from vita.stereo.rigid_fit import Undetermined, consensus, rigid_fit
from vita.stereo.rotations import orthonormal, rigid, rotation_exp, skew, skews
from vita.types import Array

LEAST = 8
"""Pairs below which no estimate is given: three fit anything."""
LARGEST_SD_DEG = 2.0
"""An estimate whose rotation is less certain than this is not given [deg]."""
ARM_SD_M = 2e-4
"""What the joints do not tell about the arm's own marker, per coordinate [m]."""
NEWTON_STEPS = 5
SMALL_STEP = 2e-4
"""A Newton step below 0.2 mm and 0.2 mrad is the last: the next would be its square."""
TUKEY = 4.7
"""Pairs beyond so many standard deviations have no weight; Gaussian noise loses about 5 % by it."""
_CHI3_MEDIAN = 2.366


class OnlineCalibration:
    """Fed with pairs by `add`; `estimate` is None until they say enough."""

    def __init__(self, spacing_m: float = 0.004, most: int = 200) -> None:
        self._store = PairStore(spacing_m, most, ARM_SD_M)
        self.restart()

    def __len__(self) -> int:
        return len(self._store)

    def restart(self) -> None:
        """Forget everything: the cameras stand elsewhere."""
        self._store.clear()
        self._estimate: BaseFromCamera | None = None
        self._covariance: Array | None = None
        self._T: Array | None = None
        self._fresh = True
        self._lacks = "no pair yet"

    def add(self, stamp: float, x_base: Array, x_left: Array, covariance: Array | float) -> None:
        """Take in one pair of the same point at the same time.

        x_base: (3,) by the joints, in the base frame [m]. x_left: (3,) by the cameras, in the left camera's
        frame [m]. covariance: (3, 3) of x_left [m^2], or one standard deviation for all directions [m].
        """
        x_base, x_left = np.asarray(x_base, dtype=float), np.asarray(x_left, dtype=float)
        C = np.asarray(covariance, dtype=float)
        C = C**2 * np.eye(3) if C.ndim == 0 else C
        if x_base.shape != (3,) or x_left.shape != (3,) or C.shape != (3, 3):
            shapes = f"{x_base.shape}, {x_left.shape} and {C.shape}"
            raise BadInput(f"expected two points (3,) and a (3, 3) covariance, got {shapes}", "pair")
        if not (math.isfinite(stamp) and np.isfinite(x_base).all() and np.isfinite(x_left).all()):
            raise BadInput(f"pair at {stamp} s is not finite: {x_base}, {x_left}", "pair")
        if not (np.isfinite(C).all() and np.linalg.eigvalsh(C)[0] > 0.0):
            raise BadInput(f"covariance at {stamp} s is not positive definite", "pair")
        self._store.add(stamp, x_base, x_left, C)
        self._fresh = False

    @property
    def estimate(self) -> BaseFromCamera | None:
        """Where the left camera stands, from all pairs kept; None until they determine it well."""
        if not self._fresh:
            self._fresh = True
            self._solve()
        return self._estimate

    @property
    def covariance(self) -> Array | None:
        """(6, 6) of the estimate: translation [m], small rotation about the base's axes [rad]."""
        return None if self.estimate is None else self._covariance

    def spread_at(self, x_base: Array) -> Array:
        """(3, 3) covariance of where the estimate puts a point near `x_base` (3,) [m^2]; zero without one."""
        if self.covariance is None or self._T is None:
            return np.zeros((3, 3))
        # A small rotation about the base's axes turns the camera's arm to the point.
        A = np.concatenate([np.eye(3), -skew(np.asarray(x_base, dtype=float) - self._T[:3, 3])], axis=1)
        return A @ self.covariance @ A.T

    @property
    def lacks(self) -> str:
        """Why there is no estimate, for people; empty when there is one."""
        return "" if self.estimate is not None else self._lacks

    # ---- the fit -----------------------------------------------------------------------------------

    def _solve(self) -> None:
        self._estimate = None
        base, left, whiteners = self._store.base, self._store.left, self._store.whiteners
        if len(base) < LEAST:
            self._lacks = f"{len(base)} of at least {LEAST} pairs"
            return
        try:
            T, covariance, weights = refine(self._begin(base, left, whiteners), base, left, whiteners)
        except Undetermined as why:
            self._T, self._lacks = None, str(why)
            return
        used = weights > 0.0
        count = int(np.count_nonzero(used))
        sd = math.degrees(math.sqrt(float(np.trace(covariance[3:, 3:]))))
        if count < max(LEAST, len(base) // 2) or sd > LARGEST_SD_DEG:
            self._T, self._lacks = None, f"the rotation is known to {sd:.1f} degrees from {count} pairs"
            return
        left_over = base[used] - left[used] @ T[:3, :3].T - T[:3, 3]
        rms = math.sqrt(float(np.einsum("ij,ij->", left_over, left_over)) / count)
        self._T, self._covariance = T, covariance
        self._estimate = BaseFromCamera(T, rms, count, sd)

    def _begin(self, base: Array, left: Array, whiteners: Array) -> Array:
        """(4, 4) a start near enough for Newton: the last result, or the consensus of most pairs."""
        if self._T is not None:
            squares = whitened(self._T, base, left, whiteners)[1]
            if np.median(squares) < 4.0 * _CHI3_MEDIAN:
                return self._T
        # The directions are not weighed here: one number per pair, its certainty in all of them together.
        certainty = 1.0 / np.einsum("kii->k", np.linalg.inv(np.swapaxes(whiteners, 1, 2) @ whiteners))
        certainty /= certainty.max()
        T = consensus(left, base, certainty)
        squares = whitened(T, base, left, whiteners)[1]
        # A triple's motion is coarse: whoever is within three times its own spread belongs to it.
        keep = squares <= 9.0 * max(4.0, float(np.median(squares)) / _CHI3_MEDIAN)
        return rigid_fit(left, base, np.where(keep, certainty, 0.0)).T


def whitened(T: Array, base: Array, left: Array, whiteners: Array) -> tuple[Array, Array]:
    """(k, 3) what T leaves of each pair, in standard deviations of the camera's noise, and (k,) squares."""
    # In the camera's frame: there the covariances stand, whatever the rotation.
    gap = (base - T[:3, 3]) @ T[:3, :3] - left
    r = np.matmul(whiteners, gap[:, :, None])[:, :, 0]
    return r, np.einsum("ki,ki->k", r, r)


def refine(T: Array, base: Array, left: Array, whiteners: Array) -> tuple[Array, Array, Array]:
    """Newton steps on the whitened distances: T, its (6, 6) covariance and the pairs' (k,) weights.

    The covariance is that of translation and small rotation about the base's axes.
    """
    R, t = T[:3, :3], T[:3, 3]
    r, squares = whitened(T, base, left, whiteners)
    for _ in range(NEWTON_STEPS):
        scale = max(1.0, float(np.median(squares)) / _CHI3_MEDIAN)
        weights = np.maximum(1.0 - squares / (TUKEY**2 * scale), 0.0) ** 2
        if np.count_nonzero(weights) < LEAST:
            raise Undetermined(f"only {np.count_nonzero(weights)} pairs agree with one another", "pairs")
        # R_true = exp(d) R and t_true = t + s: the gap changes by R' ([y]x d - s) with y = base - t.
        WR = np.matmul(whiteners, R.T)
        A = np.concatenate([-WR, np.matmul(WR, skews(base - t))], axis=2).reshape(-1, 6)
        weighted = A.T * np.repeat(weights, 3)
        N = weighted @ A
        if np.linalg.eigvalsh(N)[0] <= 0.0:
            raise Undetermined("all points are (nearly) on one line", "pairs")
        step: Array = -np.asarray(np.linalg.solve(N, weighted @ r.ravel()), dtype=float)
        R, t = rotation_exp(step[3:]) @ R, t + step[:3]
        r, squares = whitened(rigid(R, t), base, left, whiteners)
        if np.abs(step).max() < SMALL_STEP:
            break
    freedom = max(1.0, 3.0 * float(weights.sum()) - 6.0)
    excess = max(1.0, float(weights @ squares) / freedom)
    return rigid(orthonormal(R), t), excess * np.linalg.inv(N), weights
