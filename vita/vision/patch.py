"""The patch tracker: follows a small flat region by registration against its first picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from vita.types import Array, Feature, Image, frozen
from vita.vision import finder, fits, layers, motion, warps
from vita.vision.calm import calm
from vita.vision.images import Crop, check_frame, check_pixel, inside, is_frame
from vita.vision.layers import Layers
from vita.vision.motion_blur import through_blur
from vita.vision.target import Target
from vita.vision.template import Fit
from vita.vision.texture import choose_region

PATIENCE = 2
"""Frames on end in which a fit may be only fair: a blurred frame, a passing shadow."""
STRANGE, ALIEN = 0.2, 0.28
"""Residual over contrast around the click from which on it may not, or does not, look like itself."""
WORSE = 0.05
"""A fit that is worse than the last by this much is checked against others."""
WHOLE = 0.97
"""A region of which less agrees is partly covered, or holds two motions."""
PROOF_PX = 3.0
"""A click that moved this far along with its region belongs to it [px]."""
MIN_IN_VIEW = 0.6
"""Smallest share of the region that must be inside the frame."""


class PatchTracker:
    """Inverse compositional registration of a patch, with robust fit, flow start and search."""

    kind = "patch"

    def __init__(self, frame: Image, uv: object, *, size_px: float | None = None) -> None:
        size = check_frame(frame)
        pixel = check_pixel(uv, size)
        center, side = choose_region(frame, pixel, size_px)
        home = warps.corners(warps.square(center, side / 2))
        self._target = Target.at(frame, Crop.cut(frame, home, max(60.0, side)), pixel, center, side)

    @property
    def warp(self) -> Array:
        """(3, 3) from the region's square [-1, 1]^2 to the image, where it was seen last."""
        return self._target.warp @ self._target.outline

    def resume(self, frame: Image, warp: Array) -> bool:
        """Go on from `warp` (3, 3), someone's guess of where the region is in `frame`.

        True when the region is really there, by the strict rule for lost targets; the pose is then
        the refined one, and the next `update` starts from it. False changes nothing.
        """
        t = self._target
        if not is_frame(frame, t.size) or not np.isfinite(warp).all():
            return False
        warp = warp @ np.linalg.inv(t.outline)
        crop = Crop.cut(frame, warps.corners(warp), fits.margin(t.side))
        fit = fits.plain(t, crop, warp) or fits.robust(t, crop, warp)
        if fit is None or not fits.found(t, fit):
            return False
        self._accept(fit, crop, t.place(fit.warp), True)
        return True

    def update(self, frame: Image) -> Feature:
        """Find the patch in the next frame."""
        t = self._target
        if not is_frame(frame, t.size):
            return self._lost("the camera gave no usable frame", 0.0)
        crop = Crop.cut(frame, warps.corners(t.warp), fits.margin(t.side, t.velocity))
        again = t.missing > 0
        fit = self._follow(crop) if t.missing <= PATIENCE else None
        if again and fit is not None and not fits.found(t, fit):
            fit = None
        if fit is None or not fits.good(fit) or fits.leaps(t, fit):
            fit = None if fit is not None and fits.leaps(t, fit) else fit
            found, found_crop = finder.find(t, frame)
            if found is not None and found_crop is not None:
                fit, crop, again = found, found_crop, True
        if fit is None:
            return self._lost("covered, or changed too much", 0.0)
        if not fits.good(fit):
            t.doubtful += 1
            if t.doubtful > PATIENCE:
                return self._lost("covered, or changed too much", fit.quality)
        else:
            t.doubtful = 0
        if not t.proven:
            fit = self._prove(fit, frame)
            if fit is None:
                return self._lost("what was clicked is covered, or moved away from what is around it", 0.0)
        pose = fit.warp if again else calm(t.fine, fit, t.warp)
        uv = t.place(pose)
        if not inside(uv, t.size) or _in_view(pose, t.size) < MIN_IN_VIEW:
            return self._lost("left the view", fit.quality)
        self._accept(replace(fit, warp=pose), crop, uv, again)
        return t.feature()

    def _accept(self, fit: Fit, crop: Crop, uv: Array, again: bool) -> None:
        t = self._target
        velocity = np.zeros(2) if again else uv - t.uv
        t.surprise = math.hypot(*(velocity - t.velocity)) if not again else math.inf
        t.velocity = velocity
        t.warp, t.before, t.uv, t.share, t.missing = fit.warp, crop, frozen(uv), fit.share, 0
        if fits.good(fit):
            t.doubtful = 0
            t.usual += 0.1 * (fit.score - t.usual)
            if t.fine.learn(fit):
                t.coarse.believe(t.fine.trust)
        t.score = fit.quality

    def _lost(self, why: str, score: float) -> Feature:
        t = self._target
        t.missing += 1
        t.doubtful, t.velocity = 0, np.zeros(2)
        return t.feature(why, score)

    def _prove(self, fit: Fit, frame: Image) -> Fit | None:
        """See whether the clicked point goes with the region; if not, take the region that it goes with.

        None when the click's surroundings are not what they were and stand still: then what was
        clicked has left or is covered, and the fit is one of the background.
        """
        t = self._target
        strange = t.strange(fit)
        if strange < STRANGE:
            t.proven = not t.settled and t.travel(fit.warp) > PROOF_PX and fit.score > fits.SURE
            if fit.share >= WHOLE:
                t.intruder = 0
            elif strange < 0.5 * STRANGE and t.travel(fit.warp) < 0.3:
                t.intruder += 1
            if fit.share >= WHOLE or t.intruder > 6 or t.proven:
                t.estranged = t.looks = 0
                return fit
        # Background that is left in a settled region's border passes for a while.
        alien = strange > (1.6 * ALIEN if t.settled else ALIEN)
        t.estranged = t.estranged + 1 if alien else 0
        t.looks += 1
        if t.looks <= 6 or t.looks % 4 == 0:
            around = Crop.cut(frame, warps.corners(fit.warp), max(60.0, t.side))
            moved = fit.warp @ np.linalg.inv(t.home)
            found = layers.split(t.first, around, moved, t.click, t.side)
            better = self._change_over(found, around) if found is not None else None
            if better is not None:
                return better
        if not alien or t.intruder or (t.estranged <= PATIENCE and t.missing == 0):
            return fit
        return None

    def _change_over(self, found: Layers, around: Crop) -> Fit | None:
        """Take the region of the motion that the click goes with; None when that cannot be told."""
        t = self._target
        which = found.of_target()
        if which is None:
            return None
        home, coarse, fine, start = t.settle(found, which)
        fit = fine.align_robustly(around, start, rounds=10)
        if not fits.found(t, fit) or not fits.sane(t, fit.warp, start):
            return None
        t.adopt(home, coarse, fine)
        t.estranged, t.looks, t.intruder, t.warp = 0, 0, 0, fit.warp
        return fit

    def _follow(self, crop: Crop) -> Fit | None:
        """The best fit near the last pose, from the cheapest start that will do."""
        t = self._target
        ahead = warps.shift(t.velocity) @ t.warp
        # While something covers a part of the patch, the plain fit would fail or, once most of that
        # part is no longer trusted, be pulled by what is left of it.
        whole = t.share > 0.95 and t.fine.used > 0.95
        attempts = (fits.plain, fits.robust) if whole else (fits.robust,)
        first = attempts[0](t, crop, ahead)
        if first is None and t.surprise < fits.STILL * t.side:
            t.surprise = math.inf  # The coarse level was left out, and ought not to have been.
            first = attempts[0](t, crop, ahead)
        # A fit that is suddenly worse may be one on a look-alike beside the target.
        if first and fits.good(first) and first.quality > t.score - WORSE:
            return first
        best = first
        flow = motion.carry(t.before, crop, t.warp)
        for start in (flow, ahead, t.warp):
            if start is None:
                continue
            for attempt in attempts[start is ahead :]:  # The first from there was tried above.
                best = fits.better(best, attempt(t, crop, start))
                if best and fits.good(best) and best.quality > t.score - WORSE:
                    return best
        if best is None or fits.good(best):
            return best
        way = warps.apply(best.warp, _MIDDLE)[0] - warps.apply(t.warp, _MIDDLE)[0]
        return through_blur(t.fine, crop, best, way)


_MIDDLE = np.zeros((1, 2))
_AXIS = np.linspace(-0.9, 0.9, 7)
_SPREAD = np.array([(x, y) for y in _AXIS for x in _AXIS])


def _in_view(warp: Array, size: tuple[int, int]) -> float:
    """Share of the region that is inside the frame."""
    us, vs = warps.corners(warp).T.tolist()
    if min(*us, *vs) > -0.5 and max(us) < size[0] - 0.5 and max(vs) < size[1] - 0.5:
        return 1.0
    points = warps.apply(warp, _SPREAD)
    return float(np.all((points > -0.5) & (points < np.array(size) - 0.5), axis=1).mean())
