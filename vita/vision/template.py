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

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.types import Array
from vita.vision import warps
from vita.vision.images import Crop, Gray

TUKEY = 4.685
"""Residuals beyond this many standard deviations do not count in the robust fit."""
LEARN = 0.15
"""Share of the way that a pixel's trust goes towards what the last frame showed."""
MIN_TRUST = 0.3
"""Least share of the region that must stay trusted: fewer pixels could be anything."""


@dataclass(frozen=True)
class Fit:
    """A pose of the region and how well the image there agrees with the template."""

    warp: Array
    """(3, 3) from the region's square to the image."""
    score: float
    """Correlation with the template over the pixels that count, -1 to 1."""
    share: float = 1.0
    """Share of the region's trusted pixels that agree with the template."""
    agree: NDArray[np.bool_] | None = None
    """(n, n) which pixels agree; None from a plain fit, which is only believed if all do."""

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
        diagonal = np.square(self._design).sum(axis=1, dtype=np.float64)
        self._ridge = np.diag(1e-6 * diagonal + 1e-9)
        self._shape = unit.astype(np.float32)
        # How far each pixel belongs to the target: a region around an object's edge has background
        # in it, which moves differently and stops agreeing as soon as anything moves.
        self._trust: Gray = np.ones(n * n, np.float32)

    def sample(self, crop: Crop, warp: Array) -> Gray:
        """(n, n) blurred image under the region at `warp`."""
        return crop.sample(crop.blurred(self.sigma), warp @ self._grid, self.n)

    @property
    def shape(self) -> Gray:
        """(n, n) what the target looks like; zero, the mean, where the region is not part of it."""
        return self._shape * self._trust.reshape(self.n, self.n)

    def learn(self, agree: NDArray[np.bool_] | None) -> None:
        """Trust the pixels that agree more and the others less; `agree` may have another resolution."""
        if agree is None:
            target = np.ones_like(self._trust)
        else:
            size = (self.n, self.n)
            soft = cv2.resize(agree.astype(np.float32), size, interpolation=cv2.INTER_AREA)
            target = soft.astype(np.float32).ravel()
        trust = np.asarray(self._trust + LEARN * (target - self._trust), dtype=np.float32)
        if float(trust.mean()) >= MIN_TRUST:
            self._trust = trust

    def align(self, crop: Crop, warp: Array, rounds: int, small: float = 0.01) -> Fit:
        """Register by least squares, until the corners move by less than `small` [px]."""
        score = -1.0
        for left in range(rounds, -1, -1):
            values = self.sample(crop, warp).ravel()
            *step, agree, mean = (self._read @ values).tolist()
            score = agree / math.sqrt(max(float(values @ values) - mean * mean, 1e-3))
            if left == 0 or score < 0.2:
                break
            p, size = _bounded(step, agree)
            warp = warps.undo(warp, p)
            if size * self._half < small:
                break
        return Fit(warp, score)

    def align_robustly(self, crop: Crop, warp: Array, rounds: int, small: float = 0.02) -> Fit:
        """Register with Tukey weights, so that what covers a part of the region does not count."""
        template, design, trust = self._design[self.dof], self._design, self._trust
        gain, bias = self._light(self.sample(crop, warp).ravel())
        left = rounds
        while True:
            values = self.sample(crop, warp).ravel()
            residual = np.abs(values - gain * template - bias)
            # The floor keeps a perfect picture from calling its own rounding errors outliers.
            weights = _tukey(residual, trust, max(0.06 * abs(gain), 0.7))
            if left == 0:
                break
            weighted = design * weights
            normal = (weighted @ design.T).astype(np.float64) + self._ridge
            right = (weighted @ values).astype(np.float64)
            solved, solution = cv2.solve(normal, right[:, None], flags=cv2.DECOMP_CHOLESKY)
            *step, gain, bias = solution.ravel().tolist()
            if not solved or not gain > 1e-3:
                return Fit(warp, -1.0, 0.0)
            p, size = _bounded(step, gain)
            warp = warps.undo(warp, p)
            # One more look after the last step, to judge the pose where it ended.
            left = 0 if size * self._half < small else left - 1
        # Judged against the template's own contrast: a wrong place has a large scale, and then
        # every pixel would count as an inlier of it.
        if gain < 0.2 * self.deviation:
            return Fit(warp, -1.0, 0.0)
        agree = residual < max(0.35 * gain, 2.0)
        share = float(trust @ agree) / float(trust.sum())
        return Fit(warp, self._weighted(values, weights), share, agree.reshape(self.n, self.n))

    def _light(self, values: Gray) -> tuple[float, float]:
        """Gain and bias of the image against the template, by reweighted least squares."""
        template, weights = self._design[self.dof], self._trust
        gain = bias = 0.0
        for k in range(3):
            if k:
                weights = _tukey(np.abs(values - gain * template - bias), self._trust, 1e-3)
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


def _bounded(step: list[float], gain: float) -> tuple[list[float], float]:
    """A step divided by the gain and cut to half the region, and the size that it would have had."""
    size = max(map(abs, step)) / gain
    scale = min(1.0, 0.5 / size) / gain if size > 0 else 0.0
    return [x * scale for x in step], size


def _tukey(residual: Gray, trust: Gray, floor: float) -> Gray:
    """Weights that fall to zero for absolute residuals that the bulk of the trusted pixels does not have."""
    trusted = residual[trust > 0.5]
    scale = max(1.4826 * _median(trusted if len(trusted) > 16 else residual), floor)
    return trust * np.square(np.maximum(0.0, 1.0 - np.square(residual * (1 / (TUKEY * scale)))))


def _median(values: Gray) -> float:
    """The upper median; numpy's own spends five times as long on its checks."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])
