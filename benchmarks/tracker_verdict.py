"""The figures that vita's default tracker has to reach, beside what was measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import tracker_score as score
from tracker_cases import SIDES
from tracker_follow import Track
from tracker_report import about, loss_of, select
from tracker_rivals import OPENCV
from tracker_speed import Load

MOVES = ("move1", "move3", "move6", "move12")


@dataclass(frozen=True)
class Line:
    """One figure. A NaN was not measured in this run and counts as neither reached nor missed."""

    what: str
    wanted: str
    value: float
    shown: str
    reached: bool

    @property
    def measured(self) -> bool:
        return not np.isnan(self.value)

    @property
    def word(self) -> str:
        return ("yes" if self.reached else "NO") if self.measured else "not measured"


def _at_least(what: str, value: float, limit: float, form: Callable[[float], str]) -> Line:
    return Line(what, f"at least {form(limit)}", value, form(value), value >= limit)


def _at_most(what: str, value: float, limit: float, form: Callable[[float], str]) -> Line:
    return Line(what, f"at most {form(limit)}", value, form(value), value <= limit)


def _share(x: float) -> str:
    return f"{100 * x:.1f} %"


def verdict(tracks: Sequence[Track], loads: Sequence[Load], tracker: str) -> list[Line]:
    """Every figure for one of vita's trackers."""

    def success(what: str, cases: Sequence[str], sides: Sequence[int], limit: float) -> Line:
        """The lowest of the cases and sizes: a mean would hide the one that fails."""
        values = {
            f"{case}, {side} px": score.success(select(tracks, tracker, [case], [side]), 1.0)
            for case in cases for side in sides
        }  # fmt: skip
        values = {name: value for name, value in values.items() if not np.isnan(value)}
        name = min(values, key=lambda n: values[n], default="")
        value = values.get(name, float("nan"))
        return Line(what, f"at least {_share(limit)}", value, f"{_share(value)} ({name})", value >= limit)

    lines = [
        success("success at 1 px, 1 to 12 px a frame, worst of 60 and 100 px", MOVES, (60, 100), 0.99),
        success("success at 1 px, 1 to 12 px a frame, worst of 30 px", MOVES, (30,), 0.95),
        success("success at 1 px, a quarter covered, worst size", ["cover25"], SIDES, 0.90),
        success("success at 1 px, two fifths covered, worst size", ["cover40"], SIDES, 0.80),
        success("success at 1 px, light plus and minus 30 %, worst size", ["light"], SIDES, 0.95),
        success("success at 1 px, noise of 5 grey levels, worst size", ["noise"], SIDES, 0.95),
        *_rivals(tracks, tracker),
    ]
    for side, limit in ((60, 0.01), (30, 0.02)):
        value = score.jitter(select(tracks, tracker, about("jitter"), [side]))
        lines.append(_at_most(f"static jitter, {side} px", value, limit, lambda x: f"{x:.4f} px"))
    for speed, limit in ((3.0, 10.0), (12.0, 20.0)):
        load = [x.mean_ms for x in loads if (x.tracker, x.speed, x.count) == (tracker, speed, 16)]
        value = load[0] if load else float("nan")
        what = f"CPU a frame, 16 trackers, {speed:g} px a frame"
        lines.append(_at_most(what, value, limit, lambda x: f"{x:.1f} ms"))
    loss = loss_of(tracks, tracker)
    lines += [
        _at_least("bad frames flagged from the third on", loss.flagged, 0.995, _share),
        _at_most("false losses in 1000 good frames", loss.false_per_1000, 1.0, lambda x: f"{x:.2f}"),
        _at_least("found again within 5 frames", loss.refound, 0.90, _share),
    ]
    return lines


def _rivals(tracks: Sequence[Track], tracker: str) -> list[Line]:
    """Better than every OpenCV tracker, over the sequences that both were given."""
    lines = []
    for name in OPENCV:
        theirs = [t for t in tracks if t.tracker == name and t.case in about("success")]
        given = {(t.case, t.side, t.number) for t in theirs}
        ours = [t for t in tracks if t.tracker == tracker and (t.case, t.side, t.number) in given]
        if not (theirs and ours):
            continue
        a, b = score.success(ours, 1.0), score.success(theirs, 1.0)

        def is_behind(case: str, ours: list[Track] = ours, theirs: list[Track] = theirs) -> bool:
            mine, others = ([t for t in tracks if t.case == case] for tracks in (ours, theirs))
            return score.success(mine, 1.0) < score.success(others, 1.0)

        behind = ", ".join(case for case in about("success") if is_behind(case))
        shown = _share(a) + (f" (behind in {behind})" if behind else "")
        what = f"success at 1 px, all cases, against {name}"
        lines.append(Line(what, f"above {_share(b)}", a, shown, a > b))
    return lines
