"""Regions of one colour: growing one from a click, and measuring its centre to sub-pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.errors import Untrackable
from vita.types import Array, Image
from vita.vision.colour import COLOURED, Mask, lab_of, to_lab

SMALLEST_AREA = 12
"""Fewer pixels than this are noise [px^2]."""
LIKELY = 90
"""Likelihood, 0 to 255, from which on a pixel has the blob's colour."""
LARGEST_SHARE = 0.12
"""A blob that takes more of the picture than this is background."""
_TOLERANCES = (5.0, 7.0, 10.0, 14.0, 19.0, 25.0, 32.0, 40.0)
_OUTLINE = np.linspace(0, 2 * np.pi, 24, endpoint=False)


@dataclass(frozen=True)
class Region:
    """A blob as measured in one frame."""

    center: Array
    """(2,) centroid [px]."""
    spread: Array
    """(2, 2) covariance of its pixels [px^2]."""
    area: float
    """[px^2]"""
    lab: Array
    """(3,) mean colour of its middle."""
    contrast: float
    """How well it stands out from its surroundings, 0 to 1."""
    cut: bool
    """Whether the image's edge cuts it."""

    @property
    def diameter(self) -> float:
        """Of the circle with the same area [px]."""
        return 2 * math.sqrt(self.area / math.pi)

    @property
    def roundness(self) -> float:
        """Short by long axis, 1 for a circle and near 0 for a line."""
        low, high = np.linalg.eigvalsh(self.spread).tolist()
        return math.sqrt(max(low, 1e-6) / max(high, 1e-6))

    def outline(self) -> Array:
        """(24, 2) the ellipse with the same moments [px]."""
        values, vectors = np.linalg.eigh(self.spread)
        axes = vectors * (2 * np.sqrt(np.maximum(values, 0)))
        return self.center + np.stack([np.cos(_OUTLINE), np.sin(_OUTLINE)], axis=1) @ axes.T


def grown(rgb: Image, pixel: Array, size_px: float | None) -> Mask:
    """(h, w) the blob of one colour around `pixel`; raises `Untrackable`.

    Of growing tolerances the one counts whose region changes least when the tolerance grows on, the
    idea of maximally stable regions (Matas et al., BMVC 2002).
    """
    height, width = rgb.shape[:2]
    u, v = (int(np.clip(round(x), 0, n - 1)) for x, n in zip(pixel.tolist(), (width, height), strict=True))
    lab = cv2.GaussianBlur(to_lab(rgb), (0, 0), 0.7)
    seed = np.median(lab[max(0, v - 1) : v + 2, max(0, u - 1) : u + 2].reshape(-1, 3), axis=0)
    # Light and shade vary over a coloured ball more than its colour does.
    weight = np.array([0.35 if math.hypot(seed[1], seed[2]) > COLOURED else 1.0, 1, 1], np.float32)
    away = np.sqrt(np.square((lab - seed.astype(np.float32)) * weight).sum(axis=2))
    if size_px is not None:
        rows, columns = np.ogrid[:height, :width]
        away[(columns - u) ** 2 + (rows - v) ** 2 > size_px**2] = np.inf
    away[v, u] = 0.0
    steps: list[tuple[Mask, int, bool]] = []
    for tolerance in _TOLERANCES:
        _, labels = cv2.connectedComponents((away < tolerance).astype(np.uint8), connectivity=4)
        mask = labels == labels[v, u]
        edge = bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
        steps.append((mask, int(np.count_nonzero(mask)), edge))
        if steps[-1][1] > LARGEST_SHARE * mask.size:
            break
    best, best_growth = None, math.inf
    for (mask, area, edge), (_, larger, _) in zip(steps, steps[1:], strict=False):
        growth = larger / area
        if area >= SMALLEST_AREA and not edge and area < LARGEST_SHARE * mask.size and growth <= best_growth:
            best, best_growth = mask, growth
    if best is None:
        if steps[-1][2]:
            raise Untrackable("the colour under the click reaches the image's edge: this is no blob.")
        raise Untrackable("no blob of one colour here.")
    if best_growth > 1.6:
        raise Untrackable("the colour here passes gradually into its surroundings: there is no outline.")
    return _filled(best)


def surroundings(blob: Mask) -> Mask:
    """(h, w) the ring around a blob, about half as wide as it; its very rim is left out as mixed."""
    width = int(np.clip(0.5 * math.sqrt(np.count_nonzero(blob)), 4, 24))
    solid = blob.astype(np.uint8)
    return (_dilated(solid, width + 2) > 0) & (_dilated(solid, 2) == 0)


def measured(
    crop: Image, likely: NDArray[np.uint8], at: Array, origin: Array, size: tuple[int, int]
) -> Region | None:
    """The blob at (2,) `at` of `crop`, or the nearest to it; None where there is none.

    `crop` has its top-left pixel at (2,) `origin` of a frame of (width, height) `size`; `likely` tells
    where in it the blob's colour is.
    """
    blob = _component(likely > LIKELY, at)
    if blob is None:
        return None
    solid = blob.astype(np.uint8)
    # The pixels of other blobs of the colour are neither blob nor surroundings.
    around = (_dilated(solid, 7) > 0) & (_dilated(solid, 2) == 0) & (likely < LIKELY)
    core = cv2.erode(solid, np.ones((3, 3), np.uint8)) > 0
    if np.count_nonzero(core) < 5:
        core = blob
    # In RGB and not in Lab: a pixel that the blob half covers has the mean of the two colours there.
    colours = crop.astype(np.float32)
    inner, outer = colours[core].astype(np.float64), colours[around].astype(np.float64)
    if len(outer) < 8:
        return None
    mean, beside = inner.mean(axis=0), outer.mean(axis=0)
    # Fisher's direction: along it blob and surroundings differ most against their own variation, so
    # that coloured blobs are told by colour and grey ones by brightness, whatever lies behind them.
    axis = np.linalg.solve(np.cov(inner.T) + np.cov(outer.T) + 25.0 * np.eye(3), mean - beside)
    gap = float(axis @ (mean - beside))
    if gap < 1e-6:
        return None
    cover = _cover((colours - beside.astype(np.float32)) @ axis.astype(np.float32), core, around, gap)
    weight = np.where(core, 1.0, cover) * (_dilated(solid, 2) > 0)
    area = float(weight.sum())
    u, v = np.arange(crop.shape[1]) + origin[0], np.arange(crop.shape[0]) + origin[1]
    center = np.array([weight.sum(axis=0) @ u, weight.sum(axis=1) @ v]) / area
    du, dv = u - center[0], v - center[1]
    xx, yy, xy = weight.sum(axis=0) @ (du * du), weight.sum(axis=1) @ (dv * dv), dv @ weight @ du
    low, high = _extent(blob)
    cut = bool(np.any(low + origin <= 0) or np.any(high + origin >= np.array(size) - 1))
    contrast = float(np.clip(1 - 2 / math.sqrt(gap), 0, 1))
    return Region(center, np.array([[xx, xy], [xy, yy]]) / area, area, lab_of(mean), contrast, cut)


def _cover(values: NDArray[np.float32], core: Mask, around: Mask, gap: float) -> Array:
    """(h, w) how much of each pixel the blob covers, 0 to 1, from `values` along Fisher's direction.

    Compared with blob and surroundings nearby, not on average: a ball's dark side would otherwise
    count for less than its bright one and pull the centre over.
    """
    near = []
    for mask in (core, around):
        share = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 2.0)
        mean = cv2.GaussianBlur(np.where(mask, values, 0).astype(np.float32), (0, 0), 2.0)
        near.append(mean / np.maximum(share, 1e-6))
    rise = np.maximum(near[0] - near[1], 0.3 * gap)
    # An eighth less at either end keeps the noise of empty and full pixels out.
    return np.clip((values - near[1]) / (0.75 * rise) - 1 / 6, 0.0, 1.0).astype(np.float64)


def _extent(blob: Mask) -> tuple[Array, Array]:
    """(2,) first and last column and row that a blob touches."""
    columns, rows = np.flatnonzero(blob.any(axis=0)), np.flatnonzero(blob.any(axis=1))
    return np.array([columns[0], rows[0]]), np.array([columns[-1], rows[-1]])


def _component(mask: Mask, at: Array) -> Mask | None:
    """The connected part of `mask` at or nearest to (2,) `at`, its holes filled."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    large = [k for k in range(1, count) if stats[k, cv2.CC_STAT_AREA] >= SMALLEST_AREA]
    if not large:
        return None
    near = []
    for k in large:
        rows, columns = np.nonzero(labels == k)
        near.append(float(np.min((columns - at[0]) ** 2 + (rows - at[1]) ** 2)))
    return _filled(labels == large[int(np.argmin(near))])


def _filled(blob: Mask) -> Mask:
    """A blob with its holes, such as the glint on a ball, filled."""
    outlines, _ = cv2.findContours(blob.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(np.zeros(blob.shape, np.uint8), outlines, -1, 1, -1) > 0  # type: ignore[return-value]


def _dilated(solid: NDArray[np.uint8], by: int) -> NDArray[np.uint8]:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by + 1, 2 * by + 1))
    return cv2.dilate(solid, kernel)  # type: ignore[return-value]
