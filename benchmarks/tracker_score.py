"""Scoring what trackers reported.

Success as in the tracking benchmark of the thesis: one start, never set up again, and a frame is a
success when the mean distance of the four corners (or of the point, for trackers without corners)
is at most so many pixels and the tracker does not call itself lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tracker_follow import Track

GONE, THERE = 0.05, 0.99
"""Visible share of the region below which it is gone, and from which on it is wholly there."""
GRACE = 3
"""Frames within which a loss must be flagged."""
REFIND = 5
"""Frames within which a target that is back must be found."""
WRONG = 5.0
"""Error from which on a report of a visible target is a bad one, for the ROC [px]."""
RIGHT = 2.0
"""Error up to which it is a good one."""


def success(tracks: Sequence[Track], within_px: float) -> float:
    """Share of all frames with the target in view that are right and not flagged lost; NaN without any."""
    hits = [(t.error <= within_px) & t.ok for t in tracks]
    counted = [t.visible >= 0.5 for t in tracks]
    total = sum(int(c.sum()) for c in counted)
    good = sum(int((h & c).sum()) for h, c in zip(hits, counted, strict=True))
    return good / total if total else float("nan")


def median_error(tracks: Sequence[Track]) -> float:
    """Median error over the frames that the tracker calls good [px]; NaN without any."""
    errors = np.concatenate([t.error[t.ok & (t.visible >= 0.5)] for t in tracks]) if tracks else np.empty(0)
    return float(np.median(errors)) if errors.size else float("nan")


def jitter(tracks: Sequence[Track]) -> float:
    """Standard deviation of the reported pixel (root mean square of both axes) while all is still [px].

    inf when a tracker loses the still target in any frame; the mean over the sequences otherwise.
    """
    if not tracks:
        return float("nan")
    if not all(t.ok.all() and len(t.ok) > 1 for t in tracks):
        return float("inf")
    return float(np.mean([np.sqrt(t.uv.var(axis=0).mean()) for t in tracks]))


@dataclass(frozen=True)
class LossFigures:
    """How honest the loss flag is."""

    bad: int
    """Frames in which the target was gone for `GRACE` frames or longer."""
    flagged: float
    """Share of them that were flagged."""
    latencies: tuple[int, ...]
    """Of each disappearance: frames from the first without the target until the flag; -1 for never."""
    good: int
    """Frames in which the target was wholly there and the tracker had no reason to give it up."""
    false_per_1000: float
    returns: int
    refound: float
    """Share of the returns after which the target was found, and rightly so, within `REFIND` frames."""


def loss_figures(losses: Sequence[Track], others: Sequence[Track]) -> LossFigures:
    """From the sequences in which the target goes away, and those in which it does not."""
    bad = flagged = good = false = returns = refound = 0
    latencies: list[int] = []
    for t in losses:
        gone = t.visible < GONE
        for first, last in _spans(gone):
            lost = ~t.ok[first:last]
            latencies.append(int(np.argmax(lost)) if lost.any() else -1)
            bad += int(lost[GRACE - 1 :].size)
            flagged += int(lost[GRACE - 1 :].sum())
            back = np.flatnonzero(t.visible[last:] >= THERE)
            if back.size and last + back[0] + REFIND < len(t.ok):
                window = slice(last + back[0], last + back[0] + REFIND + 1)
                returns += 1
                refound += int((t.ok[window] & (t.error[window] <= RIGHT)).any())
        # After a return a tracker may still be searching: that is what `refound` is about.
        start = int(np.argmax(gone)) if gone.any() else len(gone)
        before = t.visible[:start] >= THERE
        good, false = good + int(before.sum()), false + int((~t.ok[:start] & before).sum())
    for t in others:
        there = t.visible >= THERE
        good, false = good + int(there.sum()), false + int((~t.ok & there).sum())
    return LossFigures(
        bad=bad,
        flagged=_ratio(flagged, bad),
        latencies=tuple(latencies),
        good=good,
        false_per_1000=1000 * _ratio(false, good),
        returns=returns,
        refound=_ratio(refound, returns),
    )


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")


def _spans(mask: np.ndarray) -> list[tuple[int, int]]:
    """(first, end) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def judged(tracks: Sequence[Track]) -> tuple[np.ndarray, np.ndarray]:
    """Scores and whether each is a good frame, of the frames that are clearly good or clearly bad.

    Bad: the target is gone, or what is reported is more than `WRONG` px off. Good: the target is
    wholly there and what is reported is right. What is between says nothing about a flag.
    """
    scores, labels = [np.empty(0)], [np.empty(0, bool)]
    for t in tracks:
        bad = (t.visible < GONE) | (t.error > WRONG)
        good = (t.visible >= THERE) & (t.error <= RIGHT)
        clear = bad | good
        scores.append(t.score[clear])
        labels.append(good[clear])
    return np.concatenate(scores), np.concatenate(labels)


def judged_flags(tracks: Sequence[Track]) -> tuple[np.ndarray, np.ndarray]:
    """The same for the trackers' own flags: ok or not, and whether the frame is a good one."""
    return judged([replace(t, score=t.ok) for t in tracks])


def roc(scores: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(false alarms, detections, area): share of good and of bad frames below each threshold."""
    if not good.any() or good.all():
        return np.array([0.0, 1.0]), np.array([0.0, 1.0]), float("nan")
    thresholds = np.unique(scores)
    alarms = np.searchsorted(np.sort(scores[good]), thresholds, side="right") / good.sum()
    hits = np.searchsorted(np.sort(scores[~good]), thresholds, side="right") / (~good).sum()
    alarms, hits = np.concatenate([[0.0], alarms, [1.0]]), np.concatenate([[0.0], hits, [1.0]])
    return alarms, hits, float(np.trapezoid(hits, alarms))
