"""Two motions around a click: the thing that was meant, and what lies behind it.

At the click nothing moves yet, and a click on a corner, an edge or a tool tip has more background
around it than target. The background fits perfectly as long as it stands still, so a tracker that
believes the larger part holds on to the wrong one. Here both motions are looked for as soon as what
is seen around the click no longer agrees with one.
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
from vita.vision.template import Template

REACH_PX = 4.0
"""A click this near to a moving thing means that thing, not the still background beside it [px]."""
APART_PX = 0.7
"""Least difference of two motions at the click [px]."""
STILL_PX = 0.5
"""What moved less than this since the click stands still [px]."""
LEAST_PX2 = 25.0
"""Least area that shows a motion of its own [px^2]."""
SEARCH_PX = 16
"""How far from the first motion the second is sought [px]."""
_CELLS = 48
_NEAR = 5


@dataclass(frozen=True)
class Layers:
    """Two motions since the first frame, and the pixels that only one of them explains."""

    motions: tuple[Array, Array]
    """(3, 3) each, from the first frame's pixels to this frame's; the known motion first."""
    masks: tuple[NDArray[np.bool_], NDArray[np.bool_]]
    """(n, n) each, on the grid of `square`: explained by this motion and not by the other."""
    explained: tuple[NDArray[np.bool_], NDArray[np.bool_]]
    """(n, n) each: explained by this motion, maybe by the other too (pixels without texture)."""
    square: Array
    """(3, 3) warp of the area that was looked at, in the first frame."""
    click: Array
    """(2,) the clicked pixel of the first frame."""

    def of_target(self) -> int | None:
        """0 or 1, the motion of what was clicked; None when that cannot be told.

        Of a still and a moving thing the moving one is in front, so its edge is its own: a click
        on the edge means it. Of two that move, the nearer one.
        """
        still = [_travel(m, self.click) < STILL_PX for m in self.motions]
        away = [self._distance(mask) for mask in self.masks]
        if still[0] != still[1]:
            moving = 1 if still[0] else 0
            return moving if away[moving] <= REACH_PX else None
        if min(away) > REACH_PX or abs(away[0] - away[1]) < 1.0:
            return None
        return 0 if away[0] < away[1] else 1

    def _distance(self, mask: NDArray[np.bool_]) -> float:
        """From the click to the nearest of the pixels in `mask` [px]."""
        rows, columns = np.nonzero(_opened(mask))
        if not len(rows):
            return math.inf
        n = mask.shape[0]
        at = np.stack([(columns + 0.5) * 2 / n - 1, (rows + 0.5) * 2 / n - 1], axis=1)
        return float(np.linalg.norm(warps.apply(self.square, at) - self.click, axis=1).min())


def _opened(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """`mask` without single pixels."""
    return cv2.medianBlur(mask.astype(np.uint8), 3) > 0


def _travel(motion: Array, point: Array) -> float:
    return float(np.linalg.norm(warps.apply(motion, point[None])[0] - point))


def split(first: Crop, now: Crop, motion: Array, click: Array, side: float) -> Layers | None:
    """Look for a second motion around `click` (2,) [px of the first frame]; None when there is none.

    `motion` (3, 3) is the known one, from the first frame to `now`; `side` [px] the region's side.
    """
    half = 0.5 * min(max(1.6 * side, 50.0), 110.0)
    n = min(_CELLS, round(2 * half))
    cell = 2 * half / n
    area = warps.square(click, half)
    whole = Template(first, area, n, 4)
    # Before two motions are told apart, the fit may lie between them; what stands still does so exactly.
    looks = [(whole.judge(now, m @ area), m) for m in (motion, np.eye(3))]
    known, motion = looks[0] if 0.95 * looks[0][0].quality > looks[1][0].quality else looks[1]
    if known.agree is None:
        return None
    odd = _near_click(_opened(~known.agree), cell)
    if odd.sum() * cell**2 < LEAST_PX2:
        return None
    other = Template(first, area, n, 4 if odd.sum() > 150 else 2, odd.astype(np.float32))
    starts = [*_starts(whole, now, motion @ area, odd, cell), area]
    fits = [other.align_robustly(now, start, rounds=12) for start in starts]
    best = max(fits, key=lambda fit: fit.quality)
    if best.score < 0.88 or best.share < 0.45:
        return None
    back = np.linalg.inv(area)
    second = best.warp @ back
    there = warps.apply(second, click[None])
    # Another motion that explains it about as well makes both worthless.
    for fit in fits:
        gap = float(np.linalg.norm(warps.apply(fit.warp @ back, click[None]) - there))
        if gap > 1.0 and fit.quality > 0.9 * best.quality:
            return None
    if float(np.linalg.norm(there - warps.apply(motion, click[None]))) < APART_PX:
        return None
    again = other.judge(now, best.warp).agree
    if again is None:
        return None
    masks = known.agree & ~again, again & ~known.agree
    # What a second motion explains must be a patch of its own, and most of what the first leaves open.
    own = _opened(masks[1])
    if own.sum() * cell**2 < LEAST_PX2 or (own & odd).sum() < 0.35 * odd.sum():
        return None
    return Layers((motion, second), masks, (known.agree, again), area, click)


def _near_click(odd: NDArray[np.bool_], cell: float) -> NDArray[np.bool_]:
    """The connected parts of `odd` that come within reach of the click, the grid's middle."""
    kernel = np.ones((_NEAR, _NEAR), np.uint8)
    grown = cv2.dilate(odd.astype(np.uint8), kernel)
    _, labels = cv2.connectedComponents(grown)
    n = odd.shape[0]
    rows, columns = np.mgrid[:n, :n] - (n - 1) / 2
    near = labels[np.hypot(rows, columns) * cell < REACH_PX + 2 * cell]
    return odd & np.isin(labels, near[near > 0])


def _starts(whole: Template, now: Crop, warp: Array, odd: NDArray[np.bool_], cell: float) -> list[Array]:
    """Warps where the odd pixels may have gone, by masked correlation around the known motion."""
    n = odd.shape[0]
    reach = math.ceil(SEARCH_PX / cell)
    wide = warp @ np.diag([(n + 2 * reach) / n, (n + 2 * reach) / n, 1.0])
    step = 2.0 / (n + 2 * reach)
    grid = np.array([[step, 0, step / 2 - 1], [0, step, step / 2 - 1], [0, 0, 1.0]])
    scene = now.sample(now.blurred(whole.sigma), wide @ grid, n + 2 * reach)
    rows, columns = np.nonzero(odd)
    low, high = (rows.min(), columns.min()), (rows.max() + 1, columns.max() + 1)
    cut = slice(low[0], high[0]), slice(low[1], high[1])
    look: Gray = np.ascontiguousarray(whole.plain_shape[cut])
    mask = np.ascontiguousarray(odd[cut].astype(np.float32))
    part = np.ascontiguousarray(scene[low[0] : high[0] + 2 * reach, low[1] : high[1] + 2 * reach])
    match = cv2.matchTemplate(part, look, cv2.TM_CCOEFF_NORMED, mask=mask)
    match = np.where(np.isfinite(match) & (np.abs(match) <= 1.001), match, -1.0)
    found = [warp]
    for _ in range(3):
        _, value, _, (x, y) = cv2.minMaxLoc(match)
        if value < 0.3:
            break
        found.append(warp @ warps.shift(np.array([x - reach, y - reach]) * (2.0 / n)))
        match[max(0, y - 2) : y + 3, max(0, x - 2) : x + 3] = -1.0
    return found


def trust_for(layers: Layers, which: int, square: Array, n: int) -> Gray:
    """(n, n) trust on the grid of the first frame's `square`: what motion `which` explains.

    Beyond the area that was looked at, what its border shows is taken to go on.
    """
    # Pixels without texture agree with anything: only those beside proof of this motion are its own.
    proof = cv2.dilate(_opened(layers.masks[which]).astype(np.uint8), np.ones((_NEAR, _NEAR), np.uint8)) > 0
    explained = layers.explained[which] & ~layers.masks[1 - which] & proof
    cells = explained.shape[0]
    into = np.array([[cells / 2, 0, cells / 2 - 0.5], [0, cells / 2, cells / 2 - 0.5], [0, 0, 1.0]])
    step = 2.0 / n
    grid = np.array([[step, 0, step / 2 - 1], [0, step, step / 2 - 1], [0, 0, 1.0]])
    carry = into @ np.linalg.inv(layers.square) @ square @ grid
    soft = cv2.GaussianBlur(explained.astype(np.float32), (3, 3), 0.8)
    return np.asarray(
        cv2.warpPerspective(
            soft,
            carry,
            (n, n),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        dtype=np.float32,
    )


def middle(layers: Layers, which: int) -> Array:
    """(2,) centre of what only motion `which` explains, in the first frame [px]."""
    mask = _opened(layers.masks[which])
    rows, columns = np.nonzero(mask if mask.any() else layers.masks[which])
    n = mask.shape[0]
    at = np.array([[(columns.mean() + 0.5) * 2 / n - 1, (rows.mean() + 0.5) * 2 / n - 1]])
    return warps.apply(layers.square, at)[0]
