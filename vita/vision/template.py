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
from vita.vision import robust, warps
from vita.vision.images import Crop, Gray

LEARN = 0.15
"""Share of the way that a pixel's trust goes towards what the last frame showed."""
MIN_TRUST = 0.3
"""Least share of the region that must stay trusted: fewer pixels could be anything."""
AGREE, AGREE_GREY = 0.35, 2.0
"""A pixel agrees when it is off by less than this share of the contrast, or this many grey levels."""
NOISE_GREY = 2.0
"""Camera noise for which the degrees of freedom are chosen [grey levels]."""
TILT_PX = {8: 0.15, 6: 0.5, 4: 1.0}
"""Degrees of freedom are left out while this noise would shake the region's corners by more [px]."""


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
    """(n, n) which pixels agree; None when nobody looked."""
    residual: Gray | None = None
    """(n * n,) what is seen minus the template, in units of the template's deviation."""

    @property
    def quality(self) -> float:
        """0 to 1; both a poor correlation and a covered region lower it."""
        return max(0.0, self.score) * self.share


class Template:
    """One level: an (n, n) grid over the region, blurred to suit, with `dof` degrees of freedom."""

    def __init__(self, crop: Crop, warp: Array, n: int, dof: int, trust: Gray | None = None) -> None:
        """`trust` (n, n), 0 to 1, says how far each pixel belongs to the target; None trusts all."""
        self.n = n
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
        motion = warps.motions(x, y)
        self._jacobian = motion[:, 0] * gx + motion[:, 1] * gy
        self._half = side / 2
        self._shape = unit.astype(np.float32)
        self._template = self._shape.ravel()
        # How far each pixel belongs to the target: a region around an object's edge has background
        # in it, which moves differently and stops agreeing as soon as anything moves.
        self._trust: Gray = np.ones(n * n, np.float32) if trust is None else trust.astype(np.float32).ravel()
        # What was seen to belong to something else is never trusted again.
        self._most = self._trust
        # Blur makes the noise of neighbours alike: so many pixels say what one would say alone.
        self._alike = max(1.0, 4 * math.pi * (self.sigma * n / side) ** 2)
        self.dof = dof
        self._weigh()
        while self.dof > 2 and self._tilt() > TILT_PX[self.dof]:
            self.dof -= 2
            self._weigh()
        self.shake = self._tilt()
        """How far camera noise of 2 grey levels shakes the region's corners [px]."""

    def _weigh(self) -> None:
        """Do the algebra of the least-squares fit for the present trust."""
        self._trust = np.maximum(self._trust, np.float32(1e-6))
        dof, trust = self.dof, self._trust.astype(np.float64)
        total = trust.sum()
        jacobian, unit = self._jacobian[:dof], self._shape.ravel().astype(np.float64)
        # Off the template itself and off the constant: then gain and bias cannot pull the pose.
        flat = unit - trust @ unit / total
        power = float(flat @ (trust * flat))
        free = jacobian - (jacobian @ trust / total)[:, None]
        free -= np.outer(free @ (trust * flat) / power, flat)
        weighted = free * trust
        information = weighted @ free.T
        damp = 1e-6 * np.trace(information) / dof
        solve = np.linalg.solve(information + damp * np.eye(dof), weighted)
        # One product with the image gives the step, the gain and the mean.
        self._read = np.vstack([solve, trust * flat / power, trust / total]).astype(np.float32)
        self._power, self._total, self._used = power, float(total), self._trust
        self._level = float(trust @ unit / total)
        self._even = bool(self._trust.min() > 0.98)
        self.information = information
        design = np.vstack([jacobian, unit, np.ones(self.n**2)])
        self._design = design.astype(np.float32)
        self._ridge = np.diag(1e-6 * np.square(design).sum(axis=1) + 1e-9)

    def _tilt(self) -> float:
        """How far noise shakes the region's corners [px], root mean square over the corners."""
        spread = np.linalg.inv(self.information + 1e-9 * np.eye(self.dof)) * self._alike
        spread *= (NOISE_GREY / self.deviation) ** 2 / (4 * math.pi * self.sigma**2)
        moved = warps.motions(np.array([-1.0, 1.0, 1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0]))[: self.dof]
        return self._half * math.sqrt(float(np.einsum("ick,ij,jck->", moved, spread, moved)) / 4)

    @property
    def grain(self) -> float:
        """Variance of a fit's step, over the information and the noise of one pixel."""
        return self._alike * self._power / self._total

    def sample(self, crop: Crop, warp: Array) -> Gray:
        """(n, n) blurred image under the region at `warp`."""
        return crop.sample(crop.blurred(self.sigma), warp @ self._grid, self.n)

    @property
    def shape(self) -> Gray:
        """(n, n) what the target looks like; zero, the mean, where the region is not part of it."""
        return self._shape * self._trust.reshape(self.n, self.n)

    @property
    def plain_shape(self) -> Gray:
        """(n, n) the same without regard to trust."""
        return self._shape

    @property
    def trust(self) -> Gray:
        """(n, n) how far each pixel belongs to the target, 0 to 1."""
        return self._trust.reshape(self.n, self.n)

    @property
    def used(self) -> float:
        """Share of the region that the least-squares fit uses, 0 to 1."""
        return self._total / self.n**2

    def learn(self, fit: Fit) -> bool:
        """Trust the pixels that agree more and the others less; True when that changed the algebra."""
        if fit.agree is None or (self._even and fit.share > 0.995):
            return False
        step = np.float32(LEARN) * (fit.agree.ravel() - self._trust)
        trust = np.minimum(self._trust + step, self._most)
        total = float(trust.sum())
        if total < min(MIN_TRUST * self.n**2, float(self._trust.sum())):
            return False
        self._trust = trust
        if float(np.abs(trust - self._used).sum()) < 0.08 * self.n**2:
            return False
        self._weigh()
        return True

    def believe(self, trust: Gray) -> None:
        """Take over a trust of any resolution."""
        size = (self.n, self.n)
        self._trust = np.asarray(cv2.resize(trust, size, interpolation=cv2.INTER_AREA), np.float32).ravel()
        self._weigh()

    def align(self, crop: Crop, warp: Array, rounds: int, small: float = 0.01, look: bool = False) -> Fit:
        """Register by least squares, until the corners move by less than `small` [px].

        With `look` the fit says which pixels agree, too.
        """
        score, image = -1.0, crop.blurred(self.sigma)
        values: Gray = self._template
        gain, mean = 1.0, 0.0
        for left in range(rounds, -1, -1):
            values = crop.sample(image, warp @ self._grid, self.n).ravel()
            *step, gain, mean = (self._read @ values).tolist()
            weighted = values if self._even else self._used * values
            spread = float(weighted @ values) - self._total * mean * mean
            score = gain * self._power / math.sqrt(max(spread, 1e-3) * self._power)
            if left == 0 or score < 0.2:
                break
            p, size = _bounded(step, gain)
            warp = warps.undo(warp, p)
            if size * self._half < small:
                break
        if not look or gain < 0.2 * self.deviation:
            return Fit(warp, score)
        residual = values * np.float32(1 / gain) - self._template
        residual -= np.float32(mean / gain - self._level)
        return self.seen(warp, score, residual, gain)

    def seen(self, warp: Array, score: float, residual: Gray, gain: float) -> Fit:
        """A fit that says which pixels agree, from the `residual` (n * n,) in units of the deviation."""
        agree = np.abs(residual) < max(AGREE, AGREE_GREY / gain)
        share = float(self._trust @ agree) / (float(self._trust.sum()) + 1e-6)
        return Fit(warp, score, share, agree.reshape(self.n, self.n), residual)

    def judge(self, crop: Crop, warp: Array) -> Fit:
        """How well the picture under `warp` agrees with the template, without moving it."""
        values = self.sample(crop, warp).ravel()
        gain, bias = robust.light(values, self._template, self._trust)
        return self._verdict(values, warp, gain, bias, self._trust)

    def _verdict(self, values: Gray, warp: Array, gain: float, bias: float, weights: Gray) -> Fit:
        # Judged against the template's own contrast: a wrong place has a large scale, and then
        # every pixel would count as an inlier of it.
        if gain < 0.2 * self.deviation:
            return Fit(warp, -1.0, 0.0)
        score = robust.correlation(values, self._template, weights)
        residual = (values - np.float32(bias)) * np.float32(1 / gain) - self._template
        return self.seen(warp, score, residual, gain)

    def align_robustly(
        self, crop: Crop, warp: Array, rounds: int, small: float = 0.02, bend_px: float = math.inf
    ) -> Fit:
        """Register with Tukey weights, so that what covers a part of the region does not count.

        `bend_px` is how far perspective is expected to move the corners from where `warp` has them,
        a standard deviation: the few pixels of a covered region tell it badly, and then it stays.
        """
        template, design, trust = self._template, self._design, self._trust
        bent = np.zeros(2)
        gain, bias = robust.light(self.sample(crop, warp).ravel(), template, trust)
        left = rounds
        while True:
            values = self.sample(crop, warp).ravel()
            residual = np.abs(values - gain * template - bias)
            # The floor keeps a perfect picture from calling its own rounding errors outliers.
            weights = robust.tukey(residual, trust, max(0.06 * abs(gain), 0.7))
            if left == 0:
                break
            weighted = design * weights
            normal = (weighted @ design.T).astype(np.float64) + self._ridge
            right = (weighted @ values).astype(np.float64)
            if self.dof == 8:
                noise = self._alike * float(weights @ np.square(residual)) / (float(weights.sum()) + 1e-6)
                hold = noise * (self._half / (gain * bend_px)) ** 2
                normal[[6, 7], [6, 7]] += hold
                right[6:8] -= hold * gain * bent
            solved, solution = cv2.solve(normal, right[:, None], flags=cv2.DECOMP_CHOLESKY)
            *step, gain, bias = solution.ravel().tolist()
            if not solved or not gain > 1e-3:
                return Fit(warp, -1.0, 0.0)
            p, size = _bounded(step, gain)
            warp = warps.undo(warp, p)
            bent += p[6:8] if self.dof == 8 else 0.0
            # One more look after the last step, to judge the pose where it ended.
            left = 0 if size * self._half < small else left - 1
        return self._verdict(values, warp, gain, bias, weights)

def _bounded(step: list[float], gain: float) -> tuple[list[float], float]:
    """A step divided by the gain and cut to half the region, and the size that it would have had."""
    gain = max(gain, 1e-6)
    size = max(map(abs, step)) / gain
    scale = min(1.0, 0.5 / size) / gain if size > 0 else 0.0
    return [x * scale for x in step], size
