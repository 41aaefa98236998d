"""Edges seen across: strips of the image along a curve, and the one-dimensional work on them.

The line and the ellipse tracker follow moving edges (Bouthemy, "A maximum likelihood framework
for determining moving edges", PAMI 1989): the picture is sampled along the normals of the curve,
row by row of a strip, so that looking for an edge becomes a search in one dimension.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.types import Array, Image
from vita.vision.images import Crop, Gray, to_gray

WEAKEST = 8.0
"""Least height of an edge [grey levels]."""
STRANGE = 0.4
"""A change of the grey levels beside an edge by this share of its height is something else."""
LEARN_HEIGHT, LEARN_PROFILE, LEARN_SIDES = 0.3, 0.3, 0.4
"""Shares of the way that a learned look goes towards what the last frame showed."""
TUKEY = 4.685
_SIGMA = 1.2
_TAPS = np.arange(-4, 5, dtype=np.float64)


Tint = tuple[float, float, float] | None
"""How much red, green and blue count in the picture that is worked on; None is plain grey."""
TINTS: tuple[Tint, ...] = (None, (0.5, 0.0, -0.5), (0.5, -0.5, 0.0), (0.0, 0.5, -0.5))
"""An orange ball on wood is as light as the wood: then one of the colour differences tells them apart."""


def tinted(frame: Image, tint: Tint) -> NDArray[np.uint8]:
    """(h, w) of an RGB or grey frame: the grey levels, or a difference of colours around 128."""
    if tint is None or frame.ndim == 2:
        return to_gray(frame)
    return cv2.transform(frame, np.array([[*tint, 128.0]]))  # type: ignore[return-value]


def cut(frame: Image, points: Array, margin: float, tint: Tint) -> Crop:
    """The part of a frame that holds `points` (k, 2) [px] and `margin` [px] around them."""
    limit = np.array([frame.shape[1], frame.shape[0]])
    low = np.clip(np.floor(points.min(axis=0) - margin), 0, limit - 2).astype(int)
    high = np.clip(np.ceil(points.max(axis=0) + margin) + 1, low + 2, limit).astype(int)
    return Crop(tinted(frame[low[1] : high[1], low[0] : high[0]], tint), low.astype(np.float64))


def _derivative() -> Gray:
    """(9, 1) derivative of a Gaussian that answers to a step of height one with about one."""
    bell = np.exp(-0.5 * np.square(_TAPS / _SIGMA))
    kernel = _TAPS * bell
    # A unit step in the middle of a pixel gives the sum over one side.
    return np.asarray(kernel / kernel[_TAPS > 0].sum(), np.float32)[:, None]


_DERIVATIVE = _derivative()


@dataclass(frozen=True)
class Look:
    """What an edge looks like from across."""

    height: float
    """Step from the first rows to the last ones [grey levels]; its sign is the contrast's."""
    profile: Array
    """(2 h + 1,) mean grey levels across the edge, which is the middle one."""
    sides: Array
    """(2, k) grey levels on either side of each sample; NaN where none were learned yet."""

    @classmethod
    def unknown(cls, height: float, half: int, k: int) -> Look:
        """An edge of which nothing but a first guess of its height is known."""
        return cls(height, np.zeros(2 * half + 1), np.full((2, k), np.nan))

    def towards(self, seen: Look) -> Look:
        """This look after learning some of what was seen: the height fastest, since light changes."""
        sides = self.sides + LEARN_SIDES * (seen.sides - self.sides)
        return Look(
            self.height + LEARN_HEIGHT * (seen.height - self.height),
            self.profile + LEARN_PROFILE * (seen.profile - self.profile),
            np.where(np.isnan(self.sides), seen.sides, np.where(np.isnan(seen.sides), self.sides, sides)),
        )

    def slid(self, by: int) -> Look:
        """With the samples slid along the edge by that many; nothing is known of the new ones."""
        if by == 0:
            return self
        sides = np.roll(self.sides, -by, axis=1)
        sides[:, slice(-by, None) if by > 0 else slice(0, -by)] = np.nan
        return Look(self.height, self.profile, sides)

    def familiar(self, sides: Array) -> NDArray[np.bool_]:
        """(k,) whether the `sides` (2, k) of samples look as before, one of the two at least.

        The other one may be background. Where something covers the edge both have changed, and
        then even a perfect edge there is not ours.
        """
        change = np.fmin(*np.abs(sides - self.sides))
        return ~(change > STRANGE * abs(self.height) + 8)

    def agreement(self, known: Look) -> float:
        """0 to 1: how alike this look is to a known one; changes of the light alone cost little."""
        ratio = self.height / known.height
        alike = correlation(self.profile, known.profile)
        change, side = np.abs(self.profile - known.profile), len(self.profile) // 2 - 1
        # One side may be background that changes; both at once are another edge.
        least = min(float(change[:side].mean()), float(change[-side:].mean()))
        level = math.exp(-((least / (0.6 * abs(known.height) + 10)) ** 2))
        return max(0.0, alike) * min(1.0, 1.6 * ratio, 1.6 / max(ratio, 1e-3)) * level


def steps_across(strip: Gray) -> Gray:
    """(rows, k) height of the step from row to row [grey levels], positive where it gets brighter."""
    return cv2.filter2D(strip, -1, _DERIVATIVE, borderType=cv2.BORDER_REPLICATE)  # type: ignore[return-value]


def beside(strip: Gray, row: Array, half: int) -> Array:
    """(2, k) mean grey levels of each column on either side of its edge at `row` (k,)."""
    k = strip.shape[1]
    sums = np.vstack([np.zeros(k, np.float32), strip.cumsum(axis=0)]).ravel()
    middle = np.clip(np.rint(row), half, len(strip) - 1 - half).astype(np.intp)
    rows = (middle + np.array([[-half], [-2], [3], [half + 1]])) * k + np.arange(k)
    edge = sums[rows].astype(np.float64)
    return (edge[1::2] - edge[::2]) / (half - 2)


def peaks(steps: Gray, middle: float, reach: int) -> tuple[Array, Array]:
    """Sub-pixel row and height of the highest step of each column, both (k,).

    Only rows within `reach` of row `middle` are looked at. A peak at the rim of that window is no
    peak: its height is zero.
    """
    low, k = max(1, round(middle) - reach), steps.shape[1]
    best = steps[low : round(middle) + reach + 1].argmax(axis=0)
    at = (np.minimum(best + low, len(steps) - 2) * k + np.arange(k)) + _NEIGHBOURS * k
    before, height, after = steps.ravel()[at].astype(np.float64)
    bend = 2 * height - before - after
    inner = (height >= before) & (height >= after) & (bend > 1e-6)
    offset = 0.5 * (after - before) / np.maximum(bend, 1e-6)
    return best + low + offset * inner, height * inner


_NEIGHBOURS = np.array([[-1], [0], [1]])


def fit_robustly(design: Array, values: Array, rounds: int, floor: float, rigid: int = 0) -> Array:
    """(n,) x with x @ `design` (n, k) = `values` (k,), by least squares with Tukey's weights.

    `floor` is the least standard deviation of the residuals: without it a perfect picture would
    call its own rounding errors outliers. The first round is for the first `rigid` numbers alone
    if that is given: what covers a part of a shape bends it more easily than it shifts it.
    """
    n = len(design)
    weighted, x = design, np.zeros(n)
    for left in range(rounds - 1, -1, -1):
        m = rigid if rigid and left == rounds - 1 else n
        # OpenCV solves small systems in a tenth of the time that numpy spends on its checks.
        normal = weighted[:m] @ design[:m].T
        normal.flat[:: m + 1] += 1e-9
        solution = cv2.solve(normal, (weighted[:m] @ values)[:, None], flags=cv2.DECOMP_CHOLESKY)[1]
        x = np.asarray(solution[:, 0], np.float64)
        if not left:
            break
        size = np.abs(values - x @ design[:m])
        scale = 1 / (TUKEY * max(1.4826 * median(size), floor))
        weighted = design * np.square(np.maximum(0.0, 1.0 - np.square(size * scale)))
    return x


def median(values: Array) -> float:
    """The upper median; numpy's own spends five times as long on its checks."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


def correlation(a: Array, b: Array) -> float:
    """Gain-free correlation of two profiles, -1 to 1; zero when either is flat."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt(float(a @ a) * float(b @ b)))
    return float(a @ b) / size if size > 1e-6 else 0.0


def inside_mask(points: Array, size: tuple[int, int], margin: float = 0.0) -> NDArray[np.bool_]:
    """(k,) which of the `points` (k, 2) are in a frame of (width, height) `size`."""
    limit = np.array(size) - 0.5 - margin
    return np.all((points > margin - 0.5) & (points < limit), axis=1)
