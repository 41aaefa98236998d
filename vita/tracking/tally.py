"""What is said at the end: frames ok and lost per tracker, and what was odd about the frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from vita.types import Feature, Image


@dataclass
class _Run:
    """Frames on end of which something is true, and the longest stretch of them."""

    count: int = 0
    longest: int = 0
    longest_from: int = 0
    _now: int = 0

    def add(self, frame: int, true: bool) -> bool:
        """Whether this makes the longest stretch, or lengthens it."""
        self._now = self._now + 1 if true else 0
        self.count += true
        if self._now <= self.longest:
            return False
        self.longest, self.longest_from = self._now, frame - self._now + 1
        return True


@dataclass
class _Account:
    lost: _Run = field(default_factory=_Run)
    ok: int = 0
    score: float = 0.0
    """Sum over the frames that were ok."""
    what: str = ""
    """The tracker's words about what it follows, when it was ok first."""
    why: str = ""
    """The tracker's words about its longest loss."""


class Tally:
    """Counts as the frames go by."""

    def __init__(self, names: Iterable[str]) -> None:
        self.frames = 0
        self._accounts = {name: _Account() for name in names}
        self._same = _Run()
        self._last: Image | None = None
        self._troubles: list[tuple[int, str]] = []

    def add(self, frame: int, image: Image | None, trouble: str, features: Mapping[str, Feature]) -> None:
        """One frame: its picture, what is wrong with it if anything, and what the trackers say."""
        self.frames += 1
        if trouble:
            self._troubles.append((frame, trouble))
        self._same.add(frame, _same(image, self._last))
        self._last = image
        for name, feature in features.items():
            account = self._accounts[name]
            if account.lost.add(frame, not feature.ok):
                account.why = feature.detail
            if feature.ok:
                account.what = account.what or feature.detail
                account.ok += 1
                account.score += feature.score

    def table(self) -> list[str]:
        """One line per tracker under a header, in columns."""
        rows = [("tracker", "follows", "ok", "lost", "mean score", "longest loss")]
        for name, account in self._accounts.items():
            score = f"{account.score / account.ok:.3f}" if account.ok else "-"
            counts = (str(account.ok), str(account.lost.count), score)
            rows.append((name, account.what or "-", *counts, _loss(account)))
        widths = [max(len(row[i]) for row in rows) for i in range(5)]
        lines = []
        for row in rows:
            left, right = zip(row[:2], widths, strict=False), zip(row[2:5], widths[2:], strict=True)
            cells = [*(cell.ljust(w) for cell, w in left), *(cell.rjust(w) for cell, w in right)]
            lines.append("  ".join([*cells, row[5]]))
        return lines

    def notes(self) -> list[str]:
        """A sentence for each thing that was odd about the frames."""
        notes = []
        if self._troubles:
            frame, trouble = self._troubles[0]
            n = len(self._troubles)
            what = f"frame {frame} was" if n == 1 else f"{n} frames were, the first is {frame},"
            notes.append(f"{what} of no use, all trackers are lost there: {trouble}")
        if self._same.count:
            run, n = self._same, self._same.count
            what = "1 frame is" if n == 1 else f"{n} frames are"
            longest = f"; {run.longest} on end from frame {run.longest_from}" if n > 1 else ""
            notes.append(f"{what} the same picture as the one before{longest}: a frozen camera?")
        return notes


def _same(a: Image | None, b: Image | None) -> bool:
    """Whether two frames agree to the bit; a sixteenth of the rows settles it at once for most."""
    if a is None or b is None:
        return False
    return np.array_equal(a[::16], b[::16]) and np.array_equal(a, b)


def _loss(account: _Account) -> str:
    run = account.lost
    if not run.count:
        return "none"
    why = f" ({account.why})" if account.why else ""
    return f"{run.longest} {'frame' if run.longest == 1 else 'frames'} from {run.longest_from}{why}"
