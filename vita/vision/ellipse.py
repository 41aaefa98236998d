"""The ellipse tracker: balls, holes, discs and printed dots, by the edge around them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from vita.errors import Untrackable
from vita.types import Array, Feature, Image, frozen
from vita.vision import edges
from vita.vision.edges import WEAKEST, Look, Tint
from vita.vision.ellipse_search import around, nearest, vote
from vita.vision.images import Gray, check_frame, check_pixel, inside, is_frame
from vita.vision.oval import Oval

GOOD, FOUND = 0.48, 0.78
"""Least score while tracking, and to be found again: stricter, since it may be any round thing."""
SURE = 0.82
"""A fit near the expected place with this score, or with nearly the last one, needs no vote."""
REACH = 14.0
"""Motion from frame to frame that is looked for [px]."""
HALF = 6
"""Rows of the edge's profile to either side [px]."""


@dataclass(frozen=True)
class Fit:
    oval: Oval
    share: float
    """Share of the samples around that lie on the ellipse."""
    agree: float
    """How well the edge's profile agrees with the learned one, 0 to 1."""
    look: Look
    tint: Tint

    @property
    def score(self) -> float:
        return self.share * self.agree


class EllipseTracker:
    """Moving edges around an ellipse: a vote for where it went, then a robust sub-pixel fit."""

    kind = "ellipse"

    def __init__(
        self, frame: Image, uv: object, *, size_px: float | None = None, suggest: bool = True
    ) -> None:
        """`suggest` looks for another ellipse to offer when there is none here, which takes a while."""
        self._size = check_frame(frame)
        pixel = check_pixel(uv, self._size)
        found = _acquire(frame, pixel, size_px)
        if found is None:
            raise _refusal(frame, pixel) if suggest else Untrackable(NONE_HERE)
        self._oval, self._look, self._tint = found.oval, found.look, found.tint
        self._area = found.oval.area
        self._speed = np.zeros(2)
        self._missing = 0
        self._score = 1.0

    def update(self, frame: Image) -> Feature:
        """Find the ellipse in the next frame."""
        if not is_frame(frame, self._size):
            return self._lost("the camera gave no usable frame", 0.0)
        fit = self._follow(frame)
        if fit is None or fit.score < (FOUND if self._missing else GOOD):
            return self._lost("covered, or no such ellipse is here", fit.score if fit else 0.0)
        if not inside(fit.oval.center, self._size):
            return self._lost("left the view", fit.score)
        self._speed = np.zeros(2) if self._missing else fit.oval.center - self._oval.center
        self._oval, self._missing, self._score = fit.oval, 0, fit.score
        self._look = self._look.towards(fit.look)
        a, b = self._oval.diameters
        return self._feature("ok", fit.score, f"ellipse {a:.0f} x {b:.0f} px")

    def _feature(self, status: Literal["ok", "lost"], score: float, detail: str) -> Feature:
        outline = frozen(self._oval.points(32))
        return Feature(
            frozen(self._oval.center), status, min(max(score, 0.0), 1.0), outline=outline, detail=detail
        )

    def _lost(self, why: str, score: float) -> Feature:
        self._missing += 1
        self._speed = np.zeros(2)
        return self._feature("lost", score, why)

    def _follow(self, frame: Image) -> Fit | None:
        best = None
        if not self._missing:
            best = self._try(frame, self._oval.shifted(self._speed))
            if best is not None and best.score > min(SURE, 0.93 * self._score):
                return best
        reach = REACH + float(np.abs(self._speed).max()) if not self._missing else REACH + 4 * self._missing
        for start in vote(frame, self._oval, self._speed, self._look.height, min(reach, 60.0), self._tint):
            fit = self._try(frame, start)
            if fit is not None and (best is None or fit.score > best.score):
                best = fit
            if best is not None and best.score > SURE:
                break
        return best

    def _try(self, frame: Image, start: Oval) -> Fit | None:
        fit = refine(frame, start, self._look, self._tint)
        if fit is None or not 0.7 < fit.oval.area / self._oval.area < 1.4:
            return None
        return fit if 0.08 < fit.oval.area / self._area < 12 else None


def refine(frame: Image, oval: Oval, look: Look, tint: Tint, rounds: int = 2) -> Fit | None:
    """Sub-pixel fit of the ellipse to the highest steps along its normals."""
    height, width = frame.shape[:2]
    samples = look.sides.shape[1]
    columns = samples * int(np.clip(2 * math.sqrt(math.pi * oval.area) / samples, 1, 6))
    reach = int(np.clip(0.08 * oval.radius + 2.5, 3, 8))
    rim = HALF + reach
    while True:
        rounds -= 1
        strip = _strip(frame, oval, samples, columns, rim, tint)
        steps = edges.steps_across(strip) * np.float32(math.copysign(1.0, look.height))
        row, high = edges.peaks(steps, rim, reach)
        row -= rim
        points, normals, turns = oval.samples(samples)
        visible = edges.inside_mask(points, (width, height), 1.0)
        sides = edges.beside(strip, row + rim, HALF)
        seen = visible & (high > max(0.3 * abs(look.height), 0.5 * WEAKEST)) & look.familiar(sides)
        if np.count_nonzero(seen) < max(7, 0.3 * samples):
            return None
        design = oval.motions(normals, turns)
        step = edges.fit_robustly(design[:, seen], row[seen], 5, 0.12, rigid=2)
        moved = oval.changed(step)
        if moved is None:
            return None
        offsets = step @ design
        if rounds <= 0 or np.abs(offsets).max() < 0.6:
            break
        oval = moved
    on = seen & (np.abs(row - offsets) < 0.8)
    count = np.count_nonzero(on)
    if count < 5:
        return None
    profile = (strip @ on.astype(np.float32)) / count
    rows = np.arange(-HALF, HALF + 1) + float(offsets[on].mean()) + rim
    looks = Look(
        math.copysign(edges.median(high[on]), look.height),
        np.interp(rows, np.arange(len(profile)), profile),
        np.where(on, sides, np.nan),
    )
    return Fit(moved, count / samples, looks.agreement(look), looks, tint)


def _samples(oval: Oval) -> int:
    return int(np.clip(math.sqrt(oval.area) * 1.2, 16, 48))


def _strip(frame: Image, oval: Oval, samples: int, columns: int, rim: int, tint: Tint) -> Gray:
    """(2 rim + 1, samples) values across the ellipse, outwards."""
    points, normals, _ = oval.samples(columns)
    # Not beyond the middle: there the other side begins.
    rows = np.maximum(np.arange(-rim, rim + 1), -0.9 * min(oval.diameters) / 2)[:, None]
    u = (points[:, 0] + rows * normals[:, 0]).astype(np.float32)
    v = (points[:, 1] + rows * normals[:, 1]).astype(np.float32)
    strip = cv2.remap(frame, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    values = edges.tinted(strip, tint).astype(np.float32)  # type: ignore[arg-type]
    return cv2.resize(values, (samples, 2 * rim + 1), interpolation=cv2.INTER_AREA)  # type: ignore[return-value]


def _acquire(frame: Image, pixel: Array, size_px: float | None) -> Fit | None:
    """The clearest ellipse around the pixel."""
    for tint in edges.TINTS if frame.ndim == 3 else (None,):
        best = None
        for oval in around(frame, pixel, size_px, tint):
            fit = _first_fit(frame, oval, tint)
            if fit is None or not fit.oval.contains(pixel):
                continue
            if best is None or fit.share > best.share + 0.05:
                best = fit
        if best is not None:
            return best
    return None


def _first_fit(frame: Image, oval: Oval, tint: Tint) -> Fit | None:
    for sign in (1.0, -1.0):
        fit = refine(frame, oval, Look.unknown(sign * WEAKEST, HALF, _samples(oval)), tint, rounds=5)
        if fit is not None and fit.share >= 0.8 and abs(fit.look.height) >= WEAKEST:
            if 6 <= fit.oval.diameters[1] and 0.5 < fit.oval.area / oval.area < 2:
                return fit
    return None


NONE_HERE = "no ellipse around this pixel: click inside a ball, a hole or a dot that stands out."


def _refusal(frame: Image, pixel: Array) -> Untrackable:
    found = []
    for tint in edges.TINTS if frame.ndim == 3 else (None,):
        fits = (_first_fit(frame, oval, tint) for oval in nearest(frame, pixel, tint))
        found += [fit.oval.center for fit in fits if fit is not None]
    if not found:
        return Untrackable(NONE_HERE)
    u, v = min(found, key=lambda center: float(np.hypot(*(center - pixel)))).tolist()
    return Untrackable(f"{NONE_HERE} The nearest one is at ({u:.0f}, {v:.0f}).", suggestion=(u, v))
