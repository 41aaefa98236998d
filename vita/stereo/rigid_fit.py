"""The rigid motion between two sets of points (TUM II-C, eq. 9 to 12; Arun, Huang and Blostein, 1987).

The report's eq. 11, R = U diag(1, 1, det(U V')) V' with M = U S V' the sum of (a - c_a)(b - c_b)', is the
*transpose* of the rotation that its eq. 9 asks for, P_B = R P_A + t. Built as printed the arm is sent the
wrong way round. Maximising trace(R M) gives R = V diag(1, 1, det(V U')) U', which is what stands here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.stereo.rotations import rigid, skew
from vita.types import Array

LEAST_PAIRS = 3
WIDER_THAN_NOISE = 3.0
"""A set must be this many times wider, in its second direction, than the noise of its points."""
HYPOTHESES = 64
"""Triples that `robust_fit` tries: with two pairs in five wild, one in five triples is clean, and the chance
that none of 64 is stays below one in a million. With one pair in five, half of them are."""
_CHI3_MEDIAN, _CHI3_99 = 2.366, 11.34
"""Median and 99 % point of the chi-square of three degrees of freedom."""


class Undetermined(BadInput):
    """The pairs do not determine a rigid motion; the message names what they lack."""


@dataclass(frozen=True, eq=False)
class RigidFit:
    """The rigid motion b = T a that leaves the least sum of squared distances."""

    T: Array
    """(4, 4)."""
    rms_m: float
    """Root mean square distance that is left [m]."""
    rotation_sd_deg: float
    """Predicted root mean square angle by which the rotation is off [deg]."""
    covariance: Array
    """(6, 6) of translation [m] and of a small rotation about the axes of b [rad]."""
    inliers: NDArray[np.bool_]
    """(k,) whether each pair was used."""


def _checked(a: Array, b: Array, weights: Array | None) -> tuple[Array, Array, Array]:
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    if a.ndim != 2 or a.shape[1] != 3 or a.shape != b.shape:
        raise Undetermined(f"expected two sets of shape (k, 3), got {a.shape} and {b.shape}", "pairs")
    w = np.ones(len(a)) if weights is None else np.asarray(weights, dtype=float)
    if w.shape != (len(a),):
        raise Undetermined(f"expected one weight per pair, got shape {w.shape} for {len(a)} pairs", "weights")
    bad = ~(np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1) & np.isfinite(w)) | (w < 0)
    if bad.any():
        raise Undetermined(f"pair {int(np.argmax(bad))} is not finite or has a weight below 0", "pairs")
    if np.count_nonzero(w) < LEAST_PAIRS:
        raise Undetermined(f"at least 3 pairs are needed, got {np.count_nonzero(w)}", "pairs")
    return a, b, w


def rotations_of(M: Array) -> Array:
    """(..., 3, 3) rotations that maximise trace(R M), for M (..., 3, 3) (TUM eq. 10 and the right eq. 11)."""
    U, _, Vt = np.linalg.svd(M)
    V, Ut = np.swapaxes(Vt, -1, -2), np.swapaxes(U, -1, -2)
    flips = np.linalg.det(V @ Ut)
    V = V.copy()
    V[..., :, 2] *= np.sign(flips)[..., None]
    return V @ Ut


def rigid_fit(a: Array, b: Array, weights: Array | None = None, sigma_m: float | None = None) -> RigidFit:
    """The rigid motion from `a` (k, 3) to `b` (k, 3) [m], eq. 9 to 12, with `weights` (k,) >= 0.

    `sigma_m` is the noise per coordinate of a pair of weight 1 (both ends together); without it, what the fit
    leaves tells. A pair of weight w counts as one of sigma_m / sqrt(w).
    Refuses (`Undetermined`) sets that are too small, not finite, or no wider than their noise in a second
    direction: coincident and collinear ones leave a turn about the line open.
    """
    a, b, w = _checked(a, b, weights)
    total = w.sum()
    centre_a, centre_b = w @ a / total, w @ b / total
    da, db = a - centre_a, b - centre_b
    R = rotations_of((w[:, None] * da).T @ db)
    left = db - da @ R.T
    squares = np.einsum("ij,ij->i", left, left)
    used = w > 0
    freedom = 3 * np.count_nonzero(used) - 6
    variance = float(w @ squares) / freedom if sigma_m is None else sigma_m**2
    _refuse_narrow(da, db, w, math.sqrt(variance / w[used].mean()))

    turned = da @ R.T
    spread = (w[:, None] * turned).T @ turned
    rotation = variance * np.linalg.inv(np.trace(spread) * np.eye(3) - spread)
    t = centre_b - R @ centre_a
    # The centroid is known best; the translation at the base's origin hangs on the rotation by its lever.
    lever = skew(R @ centre_a)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = variance / total * np.eye(3) + lever @ rotation @ lever.T
    covariance[:3, 3:], covariance[3:, :3] = lever @ rotation, rotation @ lever.T
    covariance[3:, 3:] = rotation
    degrees = math.degrees(math.sqrt(np.trace(rotation)))
    return RigidFit(rigid(R, t), math.sqrt(float(squares[used].mean())), degrees, covariance, used)


def _refuse_narrow(da: Array, db: Array, w: Array, sigma: float) -> None:
    """Raise unless both centred sets are wider than the noise in two directions."""
    roots = np.sqrt(w / w.sum())[:, None]
    # The set that is narrower decides: the other may owe its width to noise alone.
    widths = np.minimum(
        np.linalg.svd(roots * da, compute_uv=False), np.linalg.svd(roots * db, compute_uv=False)
    )
    rounding = 1e-9 * (1.0 + float(np.abs(da).max()))
    least = max(WIDER_THAN_NOISE * sigma, rounding)
    if widths[0] <= least:
        raise Undetermined(_narrow("all points are (nearly) the same", widths[0], sigma), "pairs")
    if widths[1] <= max(least, 1e-6 * widths[0]):
        raise Undetermined(_narrow("all points are (nearly) on one line", widths[1], sigma), "pairs")


def _narrow(what: str, width: float, sigma: float) -> str:
    return f"{what}: rms width {width * 1e3:.3g} mm at a noise of {sigma * 1e3:.3g} mm"


def robust_fit(
    a: Array, b: Array, weights: Array | None = None, sigma_m: float | None = None, seed: int = 0
) -> RigidFit:
    """`rigid_fit` of the pairs that agree with one another; up to two wild pairs in five are left out.

    Least median of squares over seeded triples finds a motion that most pairs agree with, whatever the
    others say; the pairs within its noise (99 %) are then fitted, twice, as the first fit is coarse.
    """
    a, b, w = _checked(a, b, weights)
    T = consensus(a, b, w, seed)
    keep = w > 0
    for _ in range(3):
        left = b - a @ T[:3, :3].T - T[:3, 3]
        squares = w * np.einsum("ij,ij->i", left, left)
        if sigma_m is None:
            # The median is the noise's own scale as long as fewer than half are wild; small sets need more.
            few = 1.0 + 5.0 / max(1, np.count_nonzero(w) - 3)
            variance = np.median(squares[w > 0]) / _CHI3_MEDIAN * few
        else:
            variance = sigma_m**2
        keep = (squares <= _CHI3_99 * variance + 1e-18) & (w > 0)
        if np.count_nonzero(keep) < LEAST_PAIRS:
            raise Undetermined("no three pairs agree with one another", "pairs")
        fit = rigid_fit(a, b, np.where(keep, w, 0.0), sigma_m)
        T = fit.T
    return fit


def consensus(a: Array, b: Array, w: Array, seed: int = 0) -> Array:
    """(4, 4) motion of the triple of pairs that leaves the smallest median distance over all pairs."""
    draw = np.random.default_rng(seed)
    usable = np.flatnonzero(w > 0)
    picks = draw.integers(0, len(usable), (HYPOTHESES, 3))
    twice = (picks[:, 0] == picks[:, 1]) | (picks[:, 1] == picks[:, 2]) | (picks[:, 2] == picks[:, 0])
    picks[twice] = picks[twice, :1] + (0, 1, 2)
    picks = usable[picks % len(usable)]
    pa, pb = a[picks], b[picks]
    ca, cb = pa.mean(axis=1), pb.mean(axis=1)
    R = rotations_of(np.swapaxes(pa - ca[:, None], 1, 2) @ (pb - cb[:, None]))
    t = cb - np.matmul(R, ca[:, :, None])[:, :, 0]
    left = b[usable] - t[:, None] - np.matmul(a[usable], np.swapaxes(R, 1, 2))
    squares = w[usable] * np.einsum("hki,hki->hk", left, left)
    # A triple always agrees with itself: of few pairs, more than half must agree with it.
    rank = min(len(usable) - 1, (len(usable) + 4) // 2 - 1)
    best = int(np.argmin(np.partition(squares, rank, axis=1)[:, rank]))
    return rigid(R[best], t[best])
