"""The line tracker: a line clicked by two points, which sticks to the image edge under it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput, Untrackable
from vita.types import Array, Feature, Image, frozen
from vita.vision import edges
from vita.vision.edges import WEAKEST, Look
from vita.vision.images import Gray, check_frame, check_pixel, is_frame, to_gray
from vita.vision.segment import Line, highest, slide

MIN_LENGTH = 8.0
"""Least distance of the two clicks [px]."""
SNAP = 6.0
"""The clicked line is moved onto an edge that is at most this far away [px]."""
HALF = 8
"""Rows of the edge's profile to either side [px]."""
REACH = 14.0
"""Motion across the line from frame to frame that is looked for [px]."""
TURN = 0.105
"""Turn from frame to frame that is looked for [rad]."""
GOOD, FOUND = 0.42, 0.7
"""Least score while tracking, and to be found again: stricter, since it may be any edge."""
SURE = 0.85
"""A fit near the expected place with this score, or with nearly the last one, needs no vote."""
_SAMPLING = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


@dataclass(frozen=True)
class Fit:
    line: Line
    share: float
    """Share of the samples that lie on the line."""
    agree: float
    """How well the edge's profile agrees with the learned one, 0 to 1."""
    look: Look
    slide: int
    """Samples by which the visible edge asks the segment to slide along."""

    @property
    def score(self) -> float:
        return self.share * self.agree


class LineTracker:
    """Moving edges with a vote over offset and turn, then a robust sub-pixel line fit.

    The middle of the line moves across it only, and its length stays: what happens along a
    straight edge cannot be seen (the aperture problem). Only where the edge is seen to end inside
    the segment and to go on beyond its other end does the segment slide along, to stay on it.
    """

    kind = "line"

    def __init__(self, frame: Image, uv: object, to: object, *, size_px: float | None = None) -> None:
        self._size = check_frame(frame)
        clicked = Line.between(check_pixel(uv, self._size), check_pixel(to, self._size))
        length = 2 * clicked.half
        if length < MIN_LENGTH:
            raise BadInput(f"the two ends are {length:.1f} px apart; at least {MIN_LENGTH:g} are needed")
        self._reach = REACH if size_px is None else size_px / 2
        self._samples = n = int(np.clip(length / 4, 8, 32))
        # A sample is the mean of up to eight columns, which is what keeps the noise away.
        self._columns = n * int(np.clip(length / n, 1, 8))
        self._t: Array = (np.arange(n, dtype=np.float64) - (n - 1) / 2) * (length / n)
        # Samples beyond either end show whether the edge goes on there.
        self._beyond = n // 3
        wide = n + 2 * self._beyond
        self._t_wide: Array = (np.arange(wide, dtype=np.float64) - (wide - 1) / 2) * (length / n)
        self._design: Array = np.stack([np.ones(n), self._t])
        found = self._acquire(frame, clicked)
        if found is None:
            raise _refusal(frame, clicked)
        self._line, self._look = found.line.beside(clicked), found.look
        self._speed = (0.0, 0.0)
        self._missing = 0
        self._score = 1.0

    def update(self, frame: Image) -> Feature:
        """Find the line in the next frame."""
        if not is_frame(frame, self._size):
            return self._lost("the camera gave no usable frame", 0.0)
        fit = self._follow(frame)
        if fit is None or fit.score < (FOUND if self._missing else GOOD):
            gone = self._visible(self._line, self._t).mean() < 0.5
            why = "left the view" if gone else "covered, or no edge like it is here"
            return self._lost(why, fit.score if fit else 0.0)
        old, new = self._line, fit.line
        step = (new.middle[1] - old.middle[1]) * new.cos - (new.middle[0] - old.middle[0]) * new.sin
        self._speed = (0.0, 0.0) if self._missing else (step, _wrap(new.angle - old.angle))
        self._missing, self._score = 0, fit.score
        spacing = float(self._t[1] - self._t[0])
        self._line = Line(new.at(fit.slide * spacing, 0.0), new.angle, new.half)
        self._look = self._look.towards(fit.look).slid(fit.slide)
        return self._feature("ok", fit.score, f"edge of {2 * new.half:.0f} px")

    def _feature(self, status: Literal["ok", "lost"], score: float, detail: str) -> Feature:
        line = self._line
        ends = frozen([line.at(-line.half, 0.0), line.at(line.half, 0.0)])
        return Feature(frozen(line.middle), status, min(max(score, 0.0), 1.0), segment=ends, detail=detail)

    def _lost(self, why: str, score: float) -> Feature:
        self._missing += 1
        self._speed = (0.0, 0.0)
        return self._feature("lost", score, why)

    def _strip(self, frame: Image, line: Line, reach: int, beyond: int = 0) -> Gray:
        """(2 reach + 1, samples + 2 beyond) grey values across `line`, which is the middle row."""
        samples, rows = self._samples + 2 * beyond, 2 * reach + 1
        columns = self._columns // self._samples * samples
        step = 2 * line.half / self._columns
        u, v = line.at((1 - columns) / 2 * step, -reach)
        warp = np.array([[step * line.cos, -line.sin, u], [step * line.sin, line.cos, v]])
        strip = cv2.warpAffine(frame, warp, (columns, rows), flags=_SAMPLING, borderMode=cv2.BORDER_REPLICATE)
        gray = to_gray(np.asarray(strip, np.uint8)).astype(np.float32)
        return cv2.resize(gray, (samples, rows), interpolation=cv2.INTER_AREA)  # type: ignore[return-value]

    def _visible(self, line: Line, t: Array) -> Array:
        """(k,) 1 for the samples at `t` (k,) along the line that are inside the frame, 0 for the others."""
        u, v = line.middle[0] + t * line.cos, line.middle[1] + t * line.sin
        width, height = self._size
        return ((u > 1) & (u < width - 2) & (v > 1) & (v < height - 2)).astype(np.float64)

    def _follow(self, frame: Image) -> Fit | None:
        offset, turn = self._speed
        best = None
        if not self._missing:
            best = self._refine(frame, self._line.moved(offset, turn), self._look)
            if best is not None and best.score > min(SURE, 0.93 * self._score):
                return best
        for start in self._vote(frame):
            fit = self._refine(frame, start, self._look)
            if fit is not None and (best is None or fit.score > best.score):
                best = fit
            if best is not None and best.score > SURE:
                break
        return best

    def _vote(self, frame: Image) -> list[Line]:
        """Lines nearby that most samples vote for (a Hough transform over offset and turn)."""
        offset, turn = self._speed
        # Half way to where it is expected, so that it is seen even if it stopped or came back.
        middle = self._line.moved(0.5 * offset, 0.5 * turn)
        if self._missing:
            reach = min(self._reach + 4 * self._missing, 60.0)
            lean = min(TURN * (1 + 0.25 * self._missing), 0.4)
        else:
            reach, lean = self._reach + 0.5 * abs(offset), TURN + 0.5 * abs(turn)
        ends = lean * middle.half + 1
        rim = math.ceil(reach + ends) + 5
        steps = edges.steps_across(self._strip(frame, middle, rim)) * np.float32(1 / self._look.height)
        # Half the height is a full vote; what is far too high is another edge.
        votes = np.clip(np.minimum(steps * 2, 2.2 - steps * 0.6), 0, 1) * self._visible(middle, self._t)
        slopes, offsets, rows = self._fan(ends, reach)
        total = votes.ravel()[rows + rim * self._samples].mean(axis=2)
        # Of two alike the one nearer to where it is expected.
        total -= 0.15 * np.square((offsets - 0.5 * offset) / reach)
        total -= 0.05 * np.square((slopes - 0.5 * turn) * middle.half / ends)[:, None]
        return [
            middle.moved(float(offsets[o]), math.atan(slopes[a]))
            for a, o in highest(total, 0.15, 3 if self._missing else 2)
        ]

    def _fan(self, ends: float, reach: float) -> tuple[Array, Array, NDArray[np.intp]]:
        """Slopes (a,), offsets (o,) and (a, o, samples) indices of a bundle of lines in a strip.

        `ends` is how far the ends of the steepest one rise [px]. The indices are of the flat strip,
        counted from its middle row.
        """
        n = 2 * min(math.ceil(ends / 1.2), 16) + 1
        slopes = np.linspace(-ends, ends, n) / (0.5 * self._samples * (self._t[1] - self._t[0]))
        offsets = np.arange(-math.floor(reach), math.floor(reach) + 1).astype(np.float64)
        rise = np.rint(slopes[:, None] * self._t).astype(np.intp)
        rows = rise[:, None, :] + offsets.astype(np.intp)[None, :, None]
        return slopes, offsets, rows * self._samples + np.arange(self._samples)

    def _refine(self, frame: Image, line: Line, look: Look) -> Fit | None:
        """Sub-pixel fit of the line to the highest steps near it."""
        reach = HALF + 3
        strip = self._strip(frame, line, reach, self._beyond)
        steps = edges.steps_across(strip) * np.float32(math.copysign(1.0, look.height))
        row, height = edges.peaks(steps, reach, 3)
        sides = edges.beside(strip, row, HALF)
        visible = self._visible(line, self._t_wide)
        clear = height * visible > max(0.3 * abs(look.height), 0.5 * WEAKEST)
        row -= reach
        own = slice(self._beyond, self._beyond + self._samples)
        seen = clear[own] & look.familiar(sides[:, own])
        if np.count_nonzero(seen) < 4:
            return None
        offset, slope = edges.fit_robustly(self._design[:, seen], row[own][seen], 4, 0.12).tolist()
        near = np.abs(row - offset - slope * self._t_wide) < 0.8
        on = seen & near[own]
        count = np.count_nonzero(on)
        if count < 4 or abs(offset) > 4:
            return None
        profile = (strip[:, own] @ on.astype(np.float32)) / count
        # Row by row along the fitted line, so that the same edge gives the same profile.
        rows = np.arange(-HALF, HALF + 1) + offset + reach
        looks = Look(
            math.copysign(edges.median(height[own][on]), look.height),
            np.interp(rows, np.arange(len(profile)), profile),
            np.where(on, sides[:, own], np.nan),
        )
        fitted = line.moved(offset, math.atan(slope))
        by = slide(on, (clear & near)[: self._beyond][::-1], (clear & near)[-self._beyond :])
        return Fit(fitted, count / self._samples, looks.agreement(look), looks, by)

    def _acquire(self, frame: Image, clicked: Line) -> Fit | None:
        """The edge nearest to the clicked line."""
        rim = 2 * math.ceil(SNAP) + 5
        steps = edges.steps_across(self._strip(frame, clicked, rim))
        slopes, offsets, rows = self._fan(SNAP, SNAP)
        at = steps.ravel()[rows + rim * self._samples]
        best, best_value = None, 0.0
        for sign in (1.0, -1.0):
            clear = np.clip(sign * at / (3 * WEAKEST), 0, 1)
            far = np.abs(offsets) + np.abs(slopes * clicked.half)[:, None]
            value = clear.mean(axis=2) * (1 - 0.07 * far)
            for a, o in highest(value.copy(), 0.15, 2):
                start = clicked.moved(float(offsets[o]), math.atan(slopes[a]))
                height = max(float(np.median(sign * at[a, o])), WEAKEST)
                fit = self._refine(frame, start, Look.unknown(sign * height, HALF, self._samples))
                clear_edge = fit is not None and fit.share > 0.7 and abs(fit.look.height) >= WEAKEST
                if clear_edge and value[a, o] > best_value:
                    best, best_value = fit, float(value[a, o])
        return best


def _wrap(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


def _refusal(frame: Image, line: Line) -> Untrackable:
    """There is no edge here; where is one?"""
    gray = cv2.GaussianBlur(to_gray(frame).astype(np.float32), (0, 0), 1.2)
    gx = cv2.Sobel(gray, cv2.CV_32F, 1, 0, ksize=1, scale=0.5)
    gy = cv2.Sobel(gray, cv2.CV_32F, 0, 1, ksize=1, scale=0.5)
    # A step of height h blurred by sigma has a slope of 0.4 h / sigma.
    strong = np.hypot(gx, gy) > 0.4 * 2 * WEAKEST / 1.2
    rows, columns = np.nonzero(strong)
    said = "no edge along this line: both ends must lie on the same straight edge."
    if not len(rows):
        return Untrackable(f"{said} There is no clear edge in this picture.")
    k = int(np.hypot(columns - line.middle[0], rows - line.middle[1]).argmin())
    place = (float(columns[k]), float(rows[k]))
    return Untrackable(f"{said} The nearest edge is at pixel ({place[0]:g}, {place[1]:g}).", suggestion=place)
