"""The patch tracker: follows a small flat region by registration against its first picture."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from vita.types import Array, Feature, Image, frozen
from vita.vision import layers, motion, search, warps
from vita.vision.images import Crop, check_frame, check_pixel, inside, is_frame
from vita.vision.layers import Layers
from vita.vision.target import Target
from vita.vision.template import Fit
from vita.vision.texture import choose_region

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
JUST_GONE, LONG_GONE = 10, 60
"""Frames for which a target is just gone; and after which it is sought less often."""
PATIENCE = 2
STILL = 0.03
"""Surprise in the last motion, over the side, below which the coarse level has nothing to add."""
STRANGE, ALIEN = 0.2, 0.28
"""Residual over contrast around the click from which on it may not, or does not, look like itself."""
WORSE = 0.05
"""A fit that is worse than the last by this much is checked against others."""
WHOLE = 0.97
"""A region of which less agrees is partly covered, or holds two motions."""
PROOF_PX = 3.0
"""A click that moved this far along with its region belongs to it [px]."""
BEND_PX = 0.7
"""How far perspective usually moves the region's corners between two frames [px]."""
MIN_IN_VIEW = 0.6
"""Smallest share of the region that must be inside the frame."""


class PatchTracker:
    """Inverse compositional registration of a patch, with robust fit, flow start and search."""

    def __init__(
        self, frame: Image, uv: object, *, size_px: float | None = None, kind: str = "patch"
    ) -> None:
        self.kind = kind
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
        crop = Crop.cut(frame, warps.corners(warp), _margin(t.side))
        fit = self._plain(crop, warp) or self._robust(crop, warp)
        if fit is None or not self._found(fit):
            return False
        self._accept(fit, crop, t.place(fit.warp), True)
        return True

    def update(self, frame: Image) -> Feature:
        """Find the patch in the next frame."""
        t = self._target
        if not is_frame(frame, t.size):
            return self._lost("the camera gave no usable frame", 0.0)
        crop = Crop.cut(frame, warps.corners(t.warp), _margin(t.side, t.velocity))
        again = t.missing > 0
        fit = self._follow(crop) if t.missing <= PATIENCE else None
        if again and fit is not None and not self._found(fit):
            fit = None
        if fit is None or not self._good(fit) or self._leaps(fit):
            fit = None if fit is not None and self._leaps(fit) else fit
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
        if not t.proven:
            fit = self._prove(fit, frame, crop)
            if fit is None:
                return self._lost("what was clicked is covered, or moved away from what is around it", 0.0)
        pose = fit.warp if again else t.fine.calm(fit, t.warp)
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
        if self._good(fit):
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

    def _prove(self, fit: Fit, frame: Image, crop: Crop) -> Fit | None:
        """See whether the clicked point goes with the region; if not, take the region that it goes with.

        None when the click's surroundings are not what they were and stand still: then what was
        clicked has left or is covered, and the fit is one of the background.
        """
        t = self._target
        strange = t.strange(fit)
        if strange < STRANGE:
            t.proven = not t.settled and t.travel(fit.warp) > PROOF_PX and fit.score > SURE
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
        if not self._found(fit) or not self._sane(fit.warp, start):
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
        attempts = (self._plain, self._robust) if whole else (self._robust,)
        first = attempts[0](crop, ahead)
        if first is None and t.surprise < STILL * t.side:
            t.surprise = math.inf  # The coarse level was left out, and ought not to have been.
            first = attempts[0](crop, ahead)
        # A fit that is suddenly worse may be one on a look-alike beside the target.
        if first and self._good(first) and first.quality > t.score - WORSE:
            return first
        best = first
        flow = motion.carry(t.before, crop, t.warp)
        for start in (flow, ahead, t.warp):
            if start is None:
                continue
            for attempt in attempts:
                best = _better(best, attempt(crop, start))
                if best and self._good(best) and best.quality > t.score - WORSE:
                    return best
        if best is None or self._good(best):
            return best
        way = warps.apply(best.warp, _MIDDLE)[0] - warps.apply(t.warp, _MIDDLE)[0]
        return t.fine.through_blur(crop, best, way)

    def _plain(self, crop: Crop, start: Array) -> Fit | None:
        """Least-squares fit from `start`; None unless it is beyond doubt."""
        t = self._target
        crop = crop.part(warps.corners(start), 0.2 * t.side + 4)
        if t.missing or t.surprise > STILL * t.side:
            start = t.coarse.align(crop, start, rounds=10, small=0.1).warp
        fit = t.fine.align(crop, start, rounds=8, look=True)
        return fit if fit.score >= SURE and self._sane(fit.warp, start) else None

    def _robust(self, crop: Crop, start: Array) -> Fit | None:
        """Robust fit from `start`; None unless it is at least fair."""
        t = self._target
        crop = crop.part(warps.corners(start), 0.2 * t.side + 4)
        fit = None
        if not t.missing and t.surprise < STILL * t.side:
            # A good prediction is better than what the coarse level makes of a half covered region.
            fit = t.fine.align_robustly(crop, start, rounds=8, bend_px=BEND_PX)
        if fit is None or not self._good(fit) or not self._sane(fit.warp, start):
            rough = t.coarse.align_robustly(crop, start, rounds=6, small=0.1)
            if rough.share < 0.25 or not self._sane(rough.warp, start):
                return None
            fit = t.fine.align_robustly(crop, rough.warp, rounds=8, bend_px=BEND_PX)
        fair = fit.score >= FAIR_SCORE and fit.share >= FAIR_SHARE
        return fit if fair and self._sane(fit.warp, start) else None

    def _search(self, frame: Image) -> tuple[Fit | None, Crop | None]:
        """Look for the target around its last place, further away the longer it is missing."""
        t = self._target
        # A search costs more than tracking does, so a target that stays away is sought less often.
        # Trackers that were lost together take turns.
        beat = t.missing + int(t.click.sum())
        if t.missing > 4 and beat % (2 if t.missing < LONG_GONE else 3):
            return None, None
        radius = t.side * (1.0 + 0.5 * t.missing)
        # It may have turned or come nearer meanwhile.
        looks = [t.warp, *(t.warp @ turn for turn in _TURNS if t.missing > 4)]
        likely = []
        for start in search.candidates(frame, t.fine.shape, looks, radius):
            crop = Crop.cut(frame, warps.corners(start), _margin(t.side))
            near = crop.part(warps.corners(start), 0.2 * t.side + 4)
            rough = t.coarse.align(near, start, rounds=6, small=0.2)
            likely.append((rough.score, rough.warp, crop))
        for score, start, crop in sorted(likely, key=lambda place: -place[0])[:2]:
            if score < 0.6 or self._was_there(start):
                continue
            fit = self._plain(crop, start)
            if fit is None and score > 0.7:
                fit = self._robust(crop, start)
            if fit is None or not self._found(fit):
                return None, None
            return (None, None) if self._was_there(fit.warp) else (fit, crop)
        return None, None

    def _was_there(self, warp: Array) -> bool:
        """Whether the first frame showed the same there: then it is a look-alike that stands still."""
        t = self._target
        if t.travel(warp) < 0.4 * t.side:
            return False
        before = t.fine.judge(Crop.cut(t.scene, warps.corners(warp), 0.1 * t.side + 4), warp)
        return before.score > 0.8 and before.share > 0.6

    def _leaps(self, fit: Fit) -> bool:
        """Whether the region is suddenly elsewhere and half covered, too: a wrong place."""
        t = self._target
        gap = math.hypot(*(t.place(fit.warp) - t.uv - t.velocity)) / t.side
        return (fit.share < t.share - 0.25 and gap > 0.2) or (fit.share < 0.7 and gap > 0.12)

    def _found(self, fit: Fit) -> bool:
        """Whether what was lost is really there; noise that it always had does not count against it."""
        t = self._target
        score = min(FOUND_SCORE, max(t.usual - 0.03, FAIR_SCORE))
        share = FOUND_SHARE - (FOUND_SCORE - score)
        if t.missing <= JUST_GONE and float(np.linalg.norm(t.place(fit.warp) - t.uv)) < t.side:
            share = min(share, NEAR_SHARE)  # There, what covered it may still cover a part of it.
        return fit.score >= score and fit.share >= share

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


_TURNS = [
    warps.turned(turn, scale) for turn in (-0.7, -0.35, 0.0, 0.35, 0.7) for scale in (0.8, 1.0, 1.25)
    if turn or scale != 1.0
]  # fmt: skip
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
