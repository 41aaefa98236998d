"""Fits of a patch's region to a frame: from the cheap one to the robust one, and how good they are."""

from __future__ import annotations

import math

import numpy as np

from vita.types import Array
from vita.vision import warps
from vita.vision.images import Crop
from vita.vision.target import Target
from vita.vision.template import Fit

SURE = 0.97
"""A plain fit that correlates this well needs no second look."""
GOOD_SCORE, GOOD_SHARE = 0.92, 0.55
"""A robust fit is taken from this weighted correlation and share of agreeing pixels on."""
FAIR_SCORE, FAIR_SHARE = 0.8, 0.4
"""A fit this good is taken for at most `PATIENCE` frames on end: a blurred frame, a passing shadow."""
FOUND_SCORE, FOUND_SHARE = 0.95, 0.92
"""What a lost target must reach to count as found again: stricter, since it may be anywhere."""
NEAR_SHARE = 0.6
"""The same for the share, near the place where it was lost just now."""
JUST_GONE = 10
"""Frames for which a lost target is just gone."""
STILL = 0.03
"""Surprise in the last motion, over the side, below which the coarse level has nothing to add."""
BEND_PX = 0.7
"""How far perspective usually moves the region's corners between two frames [px]."""


def plain(t: Target, crop: Crop, start: Array) -> Fit | None:
    """Least-squares fit from `start`; None unless it is beyond doubt."""
    crop = crop.part(warps.corners(start), 0.2 * t.side + 4)
    if t.missing or t.surprise > STILL * t.side:
        start = t.coarse.align(crop, start, rounds=10, small=0.1).warp
    fit = t.fine.align(crop, start, rounds=8, look=True)
    return fit if fit.score >= SURE and sane(t, fit.warp, start) else None


def robust(t: Target, crop: Crop, start: Array) -> Fit | None:
    """Robust fit from `start`; None unless it is at least fair."""
    crop = crop.part(warps.corners(start), 0.2 * t.side + 4)
    fit = None
    if not t.missing and t.surprise < STILL * t.side:
        # A good prediction is better than what the coarse level makes of a half covered region.
        fit = t.fine.align_robustly(crop, start, rounds=8, bend_px=BEND_PX)
    if fit is None or not good(fit) or not sane(t, fit.warp, start):
        rough = t.coarse.align_robustly(crop, start, rounds=6, small=0.1)
        if rough.share < 0.25 or not sane(t, rough.warp, start):
            return None
        fit = t.fine.align_robustly(crop, rough.warp, rounds=8, bend_px=BEND_PX)
    fair = fit.score >= FAIR_SCORE and fit.share >= FAIR_SHARE
    return fit if fair and sane(t, fit.warp, start) else None


def good(fit: Fit) -> bool:
    return fit.score >= GOOD_SCORE and fit.share >= GOOD_SHARE


def found(t: Target, fit: Fit) -> bool:
    """Whether what was lost is really there; noise that it always had does not count against it."""
    score = min(FOUND_SCORE, max(t.usual - 0.03, FAIR_SCORE))
    share = FOUND_SHARE - (FOUND_SCORE - score)
    if t.missing <= JUST_GONE and float(np.linalg.norm(t.place(fit.warp) - t.uv)) < t.side:
        share = min(share, NEAR_SHARE)  # There, what covered it may still cover a part of it.
    return fit.score >= score and fit.share >= share


def leaps(t: Target, fit: Fit) -> bool:
    """Whether the region is suddenly elsewhere and half covered, too: a wrong place."""
    gap = math.hypot(*(t.place(fit.warp) - t.uv - t.velocity)) / t.side
    return (fit.share < t.share - 0.25 and gap > 0.2) or (fit.share < 0.7 and gap > 0.12)


def sane(t: Target, warp: Array, start: Array) -> bool:
    """Whether a pose is possible at all, and near to where registration started."""
    if not np.isfinite(warp).all():
        return False
    now, was = warps.corners(warp), warps.corners(start)
    ratio = warps.area(now) / t.side**2
    reach = np.abs(now.mean(axis=0) - was.mean(axis=0)).max()
    return bool(warps.is_convex(now) and 0.15 < ratio < 6 and reach < 0.6 * t.side)


def better(a: Fit | None, b: Fit | None) -> Fit | None:
    if a is None or b is None:
        return a or b
    return a if a.quality >= b.quality else b


def margin(side: float, velocity: Array | None = None) -> float:
    """How much of the frame around a region is cut out for it [px]."""
    return max(24.0, 0.5 * side) + (1.5 * math.hypot(*velocity) if velocity is not None else 0.0)
