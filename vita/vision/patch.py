"""The patch tracker: follows a small flat region by registration against its first picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from vita.types import Array, Feature, Image, frozen
from vita.vision import motion, search, warps
from vita.vision.images import Crop, check_frame, check_pixel, inside, is_frame
from vita.vision.template import Fit, Template
from vita.vision.texture import choose_region

SURE = 0.97
"""A plain fit that correlates this well needs no second look."""
GOOD_SCORE, GOOD_SHARE = 0.92, 0.5
"""A robust fit is taken from this weighted correlation and share of agreeing pixels on."""
FAIR_SCORE, FAIR_SHARE = 0.8, 0.4
"""A fit this good is taken for at most `PATIENCE` frames on end: a blurred frame, a passing shadow."""
FOUND_SCORE, FOUND_SHARE = 0.93, 0.6
"""What a lost target must reach to count as found again: stricter, since it may be anywhere."""
PATIENCE = 2
STILL = 0.02
"""Motion per frame below which the coarse level has nothing to add."""
MIN_IN_VIEW = 0.6
"""Smallest share of the region that must be inside the frame."""


@dataclass
class _Target:
    """What is tracked: the region's templates, where the click is in it and where it is now."""

    size: tuple[int, int]
    side: float
    coarse: Template
    fine: Template
    point: Array
    """(1, 2) the clicked point in the region's square."""
    warp: Array
    before: Crop
    uv: Array
    score: float = 1.0
    share: float = 1.0
    """Share of the region that agreed in the last fit."""
    velocity: Array = field(default_factory=lambda: np.zeros(2))
    """Motion in the last frame [px]."""
    doubtful: int = 0
    """Frames on end that were only fair."""
    missing: int = 0
    """Frames on end without a fit."""


class PatchTracker:
    """Inverse compositional registration of a patch, with robust fit, flow start and search."""

    def __init__(
        self, frame: Image, uv: object, *, size_px: float | None = None, kind: str = "patch"
    ) -> None:
        self.kind = kind
        self._size_px = size_px
        self._target = self._take(frame, uv)

    @property
    def warp(self) -> Array:
        """(3, 3) from the region's square [-1, 1]^2 to the image, where it was seen last."""
        return self._target.warp.copy()

    def resume(self, frame: Image, warp: Array) -> bool:
        """Go on from `warp` (3, 3), someone's guess of where the region is in `frame`.

        True when the region is really there, by the strict rule for lost targets; the pose is then
        the refined one, and the next `update` starts from it. False changes nothing.
        """
        t = self._target
        if not is_frame(frame, t.size) or not np.isfinite(warp).all():
            return False
        crop = Crop.cut(frame, warps.corners(warp), _margin(t.side))
        fit = self._plain(crop, warp) or self._robust(crop, warp)
        if fit is None or fit.score < FOUND_SCORE or fit.share < FOUND_SHARE:
            return False
        t.warp, t.before, t.share, t.missing, t.doubtful = fit.warp, crop, fit.share, 0, 0
        t.uv, t.velocity = frozen(warps.apply(fit.warp, t.point)[0]), np.zeros(2)
        return True

    def _take(self, frame: Image, uv: object) -> _Target:
        size = check_frame(frame)
        pixel = check_pixel(uv, size)
        center, side = choose_region(frame, pixel, self._size_px)
        warp = warps.square(center, side / 2)
        crop = Crop.cut(frame, warps.corners(warp), _margin(side))
        # Small patches cannot tell perspective from noise: they would only jitter more.
        dof = 8 if side >= 48 else 6
        n = int(np.clip(round(side), 16, 50))
        return _Target(
            size=size,
            side=side,
            coarse=Template(crop, warp, min(25, n), 4),
            fine=Template(crop, warp, n, dof),
            point=((pixel - center) / (side / 2))[None],
            warp=warp,
            before=crop,
            uv=pixel,
        )

    def update(self, frame: Image) -> Feature:
        """Find the patch in the next frame."""
        t = self._target
        if not is_frame(frame, t.size):
            return self._lost("the camera gave no usable frame", 0.0)
        crop = Crop.cut(frame, warps.corners(t.warp), _margin(t.side, t.velocity))
        again = False
        fit = self._follow(crop) if t.missing == 0 else None
        if fit is None or not self._good(fit):
            found, found_crop = self._search(frame)
            if found is not None and found_crop is not None:
                fit, crop, again = found, found_crop, True
        if fit is None:
            return self._lost("covered, or changed too much", 0.0)
        if not self._good(fit):
            t.doubtful += 1
            if t.doubtful > PATIENCE:
                return self._lost("covered, or changed too much", fit.quality)
        else:
            t.doubtful = 0
        uv = warps.apply(fit.warp, t.point)[0]
        if not inside(uv, t.size) or _in_view(fit.warp, t.size) < MIN_IN_VIEW:
            return self._lost("left the view", fit.quality)
        t.velocity = uv - t.uv if t.missing == 0 and not again else np.zeros(2)
        t.warp, t.before, t.uv, t.share, t.missing = fit.warp, crop, frozen(uv), fit.share, 0
        if self._good(fit):
            t.fine.learn(fit.agree)
            t.coarse.learn(fit.agree)
        t.score = float(np.clip(fit.quality, 0, 1))
        return Feature(t.uv, "ok", t.score, frozen(warps.corners(t.warp)), f"patch {t.side:.0f} px")

    def _lost(self, why: str, score: float) -> Feature:
        t = self._target
        t.missing += 1
        t.doubtful, t.velocity = 0, np.zeros(2)
        return Feature(t.uv, "lost", float(np.clip(score, 0, 1)), frozen(warps.corners(t.warp)), why)

    def _follow(self, crop: Crop) -> Fit | None:
        """The best fit near the last pose, from the cheapest start that will do."""
        t = self._target
        ahead = warps.shift(t.velocity) @ t.warp
        # While something covers a part of the patch the plain fit would only fail again.
        first = self._plain(crop, ahead) if t.share > 0.95 else self._robust(crop, ahead)
        if first and self._good(first):
            return first
        best = first
        flow = motion.carry(t.before, crop, t.warp)
        for start in (flow, ahead, t.warp):
            if start is None:
                continue
            for attempt in (self._plain, self._robust):
                best = _better(best, attempt(crop, start))
                if best and self._good(best):
                    return best
        return best

    def _plain(self, crop: Crop, start: Array) -> Fit | None:
        """Least-squares fit from `start`; None unless it is beyond doubt."""
        t = self._target
        crop = crop.part(warps.corners(start), 0.2 * t.side + 4)
        if t.missing or math.hypot(*t.velocity) > STILL * t.side:
            start = t.coarse.align(crop, start, rounds=10, small=0.1).warp
        fit = t.fine.align(crop, start, rounds=8)
        return fit if fit.score >= SURE and self._sane(fit.warp, start) else None

    def _robust(self, crop: Crop, start: Array) -> Fit | None:
        """Robust fit from `start`; None unless it is at least fair."""
        t = self._target
        crop = crop.part(warps.corners(start), 0.2 * t.side + 4)
        rough = t.coarse.align_robustly(crop, start, rounds=6, small=0.1)
        if rough.share < 0.25 or not self._sane(rough.warp, start):
            return None
        fit = t.fine.align_robustly(crop, rough.warp, rounds=8)
        fair = fit.score >= FAIR_SCORE and fit.share >= FAIR_SHARE
        return fit if fair and self._sane(fit.warp, start) else None

    def _search(self, frame: Image) -> tuple[Fit | None, Crop | None]:
        """Look for the target around its last place, further away the longer it is missing."""
        t = self._target
        # A search costs more than tracking does, so a target that stays away is sought less often.
        if t.missing > 4 and t.missing % (2 if t.missing < 30 else 3):
            return None, None
        radius = t.side * (1.0 + 0.5 * t.missing)
        likely = []
        for start in search.candidates(frame, t.fine.shape, t.warp, radius):
            crop = Crop.cut(frame, warps.corners(start), _margin(t.side))
            near = crop.part(warps.corners(start), 0.2 * t.side + 4)
            rough = t.coarse.align(near, start, rounds=8, small=0.2)
            likely.append((rough.score, rough.warp, crop))
        if not likely:
            return None, None
        score, start, crop = max(likely, key=lambda found: found[0])
        fit = self._plain(crop, start)
        if fit is None and score > 0.5:
            fit = self._robust(crop, start)
        found = fit and fit.score >= FOUND_SCORE and fit.share >= FOUND_SHARE
        return (fit, crop) if found else (None, None)

    @staticmethod
    def _good(fit: Fit) -> bool:
        return fit.score >= GOOD_SCORE and fit.share >= GOOD_SHARE

    def _sane(self, warp: Array, start: Array) -> bool:
        """Whether a pose is possible at all, and near to where registration started."""
        if not np.isfinite(warp).all():
            return False
        now, was = warps.corners(warp), warps.corners(start)
        ratio = warps.area(now) / self._target.side**2
        reach = np.abs(now.mean(axis=0) - was.mean(axis=0)).max()
        return bool(warps.is_convex(now) and 0.15 < ratio < 6 and reach < 0.6 * self._target.side)


def _margin(side: float, velocity: Array | None = None) -> float:
    return max(24.0, 0.5 * side) + (1.5 * math.hypot(*velocity) if velocity is not None else 0.0)


def _better(a: Fit | None, b: Fit | None) -> Fit | None:
    if a is None or b is None:
        return a or b
    return a if a.quality >= b.quality else b


_AXIS = np.linspace(-0.9, 0.9, 7)
_SPREAD = np.array([(x, y) for y in _AXIS for x in _AXIS])


def _in_view(warp: Array, size: tuple[int, int]) -> float:
    """Share of the region that is inside the frame."""
    us, vs = warps.corners(warp).T.tolist()
    if min(*us, *vs) > -0.5 and max(us) < size[0] - 0.5 and max(vs) < size[1] - 0.5:
        return 1.0
    points = warps.apply(warp, _SPREAD)
    return float(np.all((points > -0.5) & (points < np.array(size) - 0.5), axis=1).mean())
