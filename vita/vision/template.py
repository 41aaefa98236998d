"""Registration of a template by inverse compositional alignment, the heart of the patch tracker.

Where the region is now, I(W(x)) = a T(x + M(x) p) + b: the template T seen under a small motion p
and another light (gain a, bias b). To first order I = a T + b + a J p, with J the template's
gradient times the motions of `warps`. J never changes, so all of its algebra is done once
(Baker and Matthews, "Lucas-Kanade 20 years on", IJCV 2004). Always aligning with the first
template is what keeps the tracker from drifting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vita.types import Array
from vita.vision import warps
from vita.vision.images import Crop, Gray

TUKEY = 4.685
"""Residuals beyond this many standard deviations do not count in the robust fit."""


@dataclass(frozen=True)
class Fit:
    """A pose of the region and how well the image there agrees with the template."""

    warp: Array
    """(3, 3) from the region's square to the image."""
    score: float
    """Correlation with the template over the pixels that count, -1 to 1."""
    share: float = 1.0
    """Share of the region's pixels that agree with the template."""

    @property
    def quality(self) -> float:
        """0 to 1; both a poor correlation and a covered region lower it."""
        return max(0.0, self.score) * self.share


class Template:
    """One level: an (n, n) grid over the region, blurred to suit, with `dof` degrees of freedom."""

    def __init__(self, crop: Crop, warp: Array, n: int, dof: int) -> None:
        self.n, self.dof = n, dof
        side = 2 * float(np.sqrt(abs(np.linalg.det(warp[:2, :2]))))
        # Template and image get the same blur before sampling. Leaving out either costs accuracy.
        self.sigma = max(0.9, 0.55 * side / n)
        step = 2.0 / n
        self._grid = np.array([[step, 0, step / 2 - 1], [0, step, step / 2 - 1], [0, 0, 1.0]])
        raw = crop.sample(crop.blurred(self.sigma), warp @ self._grid, n).astype(np.float64)
        self.deviation = float(raw.std()) + 1e-9
        unit = (raw - raw.mean()) / self.deviation
        axis = np.arange(n, dtype=np.float64) * step + step / 2 - 1
        x, y = (a.ravel() for a in np.meshgrid(axis, axis))
        gy, gx = (g.ravel() for g in np.gradient(unit, step))
        motion = warps.motions(x, y)[:dof]
        jacobian = motion[:, 0] * gx + motion[:, 1] * gy
        self._half = side / 2
        # Off the template itself and off the constant: then gain and bias cannot pull the pose.
        flat = unit.ravel() / n  # zero mean, norm one
        free = jacobian - jacobian.mean(axis=1, keepdims=True)
        free -= np.outer(free @ flat, flat)
        damp = 1e-6 * np.trace(free @ free.T) / dof
        solve = np.linalg.solve(free @ free.T + damp * np.eye(dof), free) * n
        # One product with the image gives the step, the correlation and the mean.
        self._read = np.vstack([solve, flat, np.full(n * n, 1 / n)]).astype(np.float32)
        self._design = np.vstack([jacobian, unit.ravel(), np.ones(n * n)]).astype(np.float32)
        self.shape = np.ascontiguousarray(unit, dtype=np.float32)

    def sample(self, crop: Crop, warp: Array) -> Gray:
        """(n, n) blurred image under the region at `warp`."""
        return crop.sample(crop.blurred(self.sigma), warp @ self._grid, self.n)

    def align(self, crop: Crop, warp: Array, rounds: int, small: float = 0.01) -> Fit:
        """Register by least squares, until the corners move by less than `small` [px]."""
        score, dof = -1.0, self.dof
        for left in range(rounds, -1, -1):
            values = self.sample(crop, warp).ravel()
            read = (self._read @ values).astype(np.float64)
            agree, mean = float(read[dof]), float(read[dof + 1])
            score = agree / math.sqrt(max(float(values @ values) - mean * mean, 1e-3))
            if left == 0 or score < 0.2:
                break
            p = read[:dof] / agree
            size = float(np.abs(p).max())
            if size > 0.5:
                p *= 0.5 / size
            warp = warps.undo(warp, p)
            if size * self._half < small:
                break
        return Fit(warp, score)

    def align_robustly(self, crop: Crop, warp: Array, rounds: int, small: float = 0.02) -> Fit:
        """Register with Tukey weights, so that what covers a part of the region does not count."""
        template, design, dof = self._design[self.dof], self._design, self.dof
        weights = np.ones(self.n * self.n, np.float32)
        fresh, left = True, rounds
        while True:
            values = self.sample(crop, warp).ravel()
            gain, bias = self._light(values, weights, again=fresh)
            residual = np.abs(values - gain * template - bias)
            # The floor keeps a perfect picture from calling its own rounding errors outliers.
            weights = _tukey(residual, max(0.06 * abs(gain), 0.7))
            if left == 0:
                break
            weighted = design * weights
            normal = (weighted @ design.T).astype(np.float64)
            normal[np.diag_indices(dof)] *= 1 + 1e-6
            normal[np.diag_indices(dof + 2)] += 1e-9
            solution = np.linalg.solve(normal, (weighted @ values).astype(np.float64))
            if not solution[dof] > 1e-3:
                return Fit(warp, -1.0, 0.0)
            p = solution[:dof] / solution[dof]
            size = float(np.abs(p).max())
            if size > 0.5:
                p *= 0.5 / size
            warp = warps.undo(warp, p)
            fresh = False
            # One more look after the last step, to judge the pose where it ended.
            left = 0 if size * self._half < small else left - 1
        # Judged against the template's own contrast: a wrong place has a large scale, and then
        # every pixel would count as an inlier of it.
        if gain < 0.2 * self.deviation:
            return Fit(warp, -1.0, 0.0)
        share = float(np.mean(residual < max(0.35 * gain, 2.0)))
        return Fit(warp, self._weighted(values, weights), share)

    def _light(self, values: Gray, weights: Gray, again: bool) -> tuple[float, float]:
        """Gain and bias of the image against the template, by weighted least squares."""
        template = self._design[self.dof]
        gain = bias = 0.0
        for k in range(3 if again else 1):
            if k:
                weights = _tukey(np.abs(values - gain * template - bias), 1e-3)
            total = float(weights.sum()) + 1e-6
            t, v = float(weights @ template) / total, float(weights @ values) / total
            dt = template - t
            wt = weights * dt
            gain = float(wt @ (values - v)) / (float(wt @ dt) + 1e-6)
            bias = v - gain * t
        return gain, bias

    def _weighted(self, values: Gray, weights: Gray) -> float:
        """Correlation over the weighted pixels."""
        template, total = self._design[self.dof], float(weights.sum()) + 1e-6
        dt = template - float(weights @ template) / total
        dv = values - float(weights @ values) / total
        wt, wv = weights * dt, weights * dv
        return float(wt @ dv) / (float(np.sqrt(float(wt @ dt) * float(wv @ dv))) + 1e-6)


def _tukey(residual: Gray, floor: float) -> Gray:
    """Weights that fall to zero for absolute residuals that the bulk of the pixels does not have."""
    scale = max(1.4826 * _median(residual), floor)
    return np.square(np.maximum(0.0, 1.0 - np.square(residual * (1 / (TUKEY * scale)))))


def _median(values: Gray) -> float:
    """The upper median; numpy's own spends five times as long on its checks."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])
