"""Looking for a patch that was lost: around its last place, turned, nearer and farther."""

from __future__ import annotations

from vita.types import Array, Image
from vita.vision import search, warps
from vita.vision.fits import found, margin, plain, robust
from vita.vision.images import Crop
from vita.vision.target import Target
from vita.vision.template import Fit

LONG_GONE = 60
"""Frames after which a lost target is sought less often."""
_TURNS = [
    warps.turned(turn, scale)
    for turn in (-0.7, -0.35, 0.0, 0.35, 0.7)
    for scale in (0.8, 1.0, 1.25)
    if turn or scale != 1.0
]


def find(t: Target, frame: Image) -> tuple[Fit | None, Crop | None]:
    """Look for the target around its last place, further away the longer it is missing."""
    # A search costs more than tracking does, so a target that stays away is sought less often.
    # Trackers that were lost together take turns.
    beat = t.missing + int(t.click.sum())
    if t.missing > 4 and beat % (2 if t.missing < LONG_GONE else 3):
        return None, None
    radius = t.side * (1.0 + 0.5 * t.missing)
    # It may have turned or come nearer meanwhile; half of the ways to do so are tried at a time.
    looks = [t.warp, *(t.warp @ turn for turn in _TURNS[beat // 2 % 2 :: 2] if t.missing > 4)]
    likely = []
    for start in search.candidates(frame, t.fine.shape, looks, radius):
        crop = Crop.cut(frame, warps.corners(start), margin(t.side))
        near = crop.part(warps.corners(start), 0.2 * t.side + 4)
        rough = t.coarse.align(near, start, rounds=6, small=0.2)
        likely.append((rough.score, rough.warp, crop))
    for score, start, crop in sorted(likely, key=lambda place: -place[0])[:2]:
        if score < 0.6 or was_there(t, start):
            continue
        fit = plain(t, crop, start)
        if fit is None and score > 0.7:
            fit = robust(t, crop, start)
        if fit is None or not found(t, fit):
            return None, None
        return (None, None) if was_there(t, fit.warp) else (fit, crop)
    return None, None


def was_there(t: Target, warp: Array) -> bool:
    """Whether the first frame showed the same there: then it is a look-alike that stands still."""
    if t.travel(warp) < 0.4 * t.side:
        return False
    before = t.fine.judge(Crop.cut(t.scene, warps.corners(warp), 0.1 * t.side + 4), warp)
    return before.score > 0.8 and before.share > 0.6
