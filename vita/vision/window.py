"""Registration of a small window that counts most in its middle, the heart of the point tracker.

The same inverse compositional alignment as `template`, with weights: a Gaussian around the clicked
point, since a corner of a moving thing has background in its window, and a trust in every pixel
that is learned from the frames. Gain and bias of the light are two more unknowns of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from vita.types import Array
from vita.vision import warps
from vita.vision.edges import TUKEY, median
from vita.vision.images import Crop, Gray

SPREAD = 0.4
"""Standard deviation of the weights, in half sides of the window."""
LEARN = 0.3
"""Share of the way that a pixel's trust goes towards what the last frame showed."""
LEAST = 0.25
"""Share of the weights that must stay trusted: fewer pixels could be anything."""


@dataclass(frozen=True)
class Found:
    """A pose of the window and how well the image there agrees."""

    warp: Array
    """(3, 3) from the window's square [-1, 1]^2 to the image."""
    score: float
    """Weighted correlation, which changes of the light leave alone; -1 to 1."""
    share: float
    """Weighted share of the pixels that agree."""
    agree: Array
    """(n n,) 1 where they do, else 0."""

    @property
    def quality(self) -> float:
        return max(0.0, self.score) * self.share


class Window:
    """The first picture of a small region, seen at `warp` in `crop`, on an (n, n) grid."""

    def __init__(self, crop: Crop, warp: Array, n: int, dof: int, point: Array) -> None:
        """`point` (2,) is the clicked place in the window's square; `dof` is as in `warps`."""
        self.n, self.dof = n, dof
        self._half = float(np.sqrt(abs(np.linalg.det(warp[:2, :2]))))
        # Window and image get the same blur before sampling. Leaving out either costs accuracy.
        self._sigma = max(0.9, 0.55 * 2 * self._half / n)
        step = 2.0 / n
        self._grid = np.array([[step, 0, step / 2 - 1], [0, step, step / 2 - 1], [0, 0, 1.0]])
        raw = self._sample(crop, warp).reshape(n, n).astype(np.float64)
        axis = np.arange(n, dtype=np.float64) * step + step / 2 - 1
        x, y = np.tile(axis, n), np.repeat(axis, n)
        far = np.square(x - point[0]) + np.square(y - point[1])
        bell = np.exp(-0.5 * far / SPREAD**2)
        self._bell = np.asarray(bell / bell.sum(), np.float32)
        middle = float(self._bell @ raw.ravel())
        self.deviation = float(np.sqrt(self._bell @ np.square(raw.ravel() - middle))) + 1e-9
        unit = (raw - middle) / self.deviation
        gy, gx = np.gradient(unit, step)
        motion = warps.motions(x, y)[:dof]
        jacobian = motion[:, 0] * gx.ravel() + motion[:, 1] * gy.ravel()
        self._design = np.vstack([jacobian, unit.ravel(), np.ones(n * n)]).astype(np.float32)
        self._trust = np.ones(n * n, np.float32)
        self._weigh()

    @property
    def shape(self) -> Gray:
        """(n, n) what it looks like; zero where the pixels are not trusted."""
        return (self._design[self.dof] * self._trust).reshape(self.n, self.n)

    def _weigh(self) -> None:
        weights = self._bell * self._trust
        self._weights: Gray = weights / weights.sum()
        self._read = self._solver(self._weights)

    def _solver(self, weights: Gray) -> Gray:
        """(dof + 2, n n) that turns the image's values into the fit's unknowns."""
        weighted = self._design * weights
        normal = (weighted @ self._design.T).astype(np.float64)
        normal.flat[:: len(normal) + 1] *= 1 + 1e-6
        normal.flat[:: len(normal) + 1] += 1e-9
        return cv2.solve(normal, weighted.astype(np.float64), flags=cv2.DECOMP_CHOLESKY)[1].astype(np.float32)

    def _sample(self, crop: Crop, warp: Array) -> Gray:
        return crop.sample(crop.blurred(self._sigma), warp @ self._grid, self.n).ravel()

    def align(
        self, crop: Crop, warp: Array, rounds: int, robust: bool = False, dof: int | None = None
    ) -> Found:
        """Register from `warp` on, until the window's border moves by less than 0.01 px.

        Robustly, what covers a part of the window does not count; a smaller `dof` than the
        window's own is a steadier first stage.
        """
        template, weights, read = self._design[self.dof], self._weights, self._read
        values = self._sample(crop, warp)
        gain, bias = self._light(values, weights)
        for _ in range(rounds):
            if robust:
                size = np.abs(values - gain * template - bias)
                scale = max(1.4826 * median(size[self._weights > 5e-4]), 0.06 * abs(gain), 0.7)
                weights = self._weights * np.square(np.maximum(0.0, 1.0 - np.square(size / (TUKEY * scale))))
                read = self._solver(weights)
            *step, gain, bias = (read @ values).tolist()
            if gain < 0.1 * self.deviation:
                break
            p = [x / gain for x in step[: dof or self.dof]]
            largest = max(map(abs, p))
            warp = warps.undo(warp, [x * min(1.0, 0.4 / max(largest, 1e-9)) for x in p])
            values = self._sample(crop, warp)
            if largest * self._half < 0.01:
                break
        return self._judge(values, warp, weights)

    def _light(self, values: Gray, weights: Gray) -> tuple[float, float]:
        template, total = self._design[self.dof], float(weights.sum()) + 1e-9
        t, v = float(weights @ template) / total, float(weights @ values) / total
        wt = weights * (template - t)
        gain = float(wt @ values) / (float(wt @ template) + 1e-9)
        return gain, v - gain * t

    def _judge(self, values: Gray, warp: Array, weights: Gray) -> Found:
        template, total = self._design[self.dof], float(weights.sum()) + 1e-9
        gain, bias = self._light(values, weights)
        if gain < 0.2 * self.deviation:
            return Found(warp, -1.0, 0.0, np.zeros(self.n**2))
        dt = template - float(weights @ template) / total
        dv = values - float(weights @ values) / total
        wt = weights * dt
        score = float(wt @ dv) / (float(np.sqrt(float(wt @ dt) * float((weights * dv) @ dv))) + 1e-6)
        # Judged against the window's own contrast: in a wrong place nearly nothing agrees.
        agree = np.abs(values - gain * template - bias) < max(0.4 * gain, 4.0)
        return Found(warp, score, float(self._weights @ agree), agree.astype(np.float64))

    def learn(self, agree: Array) -> None:
        """Trust the pixels that agree more and the others less."""
        if agree.all() and self._trust.min() > 0.95:
            return
        trust = np.asarray(self._trust + LEARN * (agree - self._trust), np.float32)
        if float(self._bell @ trust) >= LEAST:
            self._trust = trust
            self._weigh()
