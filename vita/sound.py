"""What a tracker says is taken for a pixel only if it is one.

Trackers are other people's code, or run on pictures nobody thought of: one may raise, or report NaN, None
or a place outside the picture. All of that is a loss, with the last good place kept, and nothing of it
reaches the error. One that raises is logged, but not thirty times a second.
"""

from __future__ import annotations

import logging
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from vita.types import Array, Feature, Image, frozen
from vita.vision.base import Tracker

log = logging.getLogger("vita.trackers")

QUIET_S = 60.0
"""A tracker that keeps raising is logged once in so long."""
BESIDE = 1.0
"""The ends of a line may lie outside the picture, by no more than this share of its size."""


class Trackers:
    """Reads trackers; remembers what each of them saw last."""

    def __init__(self) -> None:
        self._last: dict[str, Feature] = {}
        self._logged_s: dict[str, float] = {}

    def read(self, name: str, tracker: Tracker, frame: Image, now: float) -> Feature:
        """What the tracker reports of `frame` at rig time `now` [s], unchecked; a loss if it raises."""
        try:
            return tracker.update(frame)
        except Exception as failure:
            if not 0.0 <= now - self._logged_s.get(name, -np.inf) < QUIET_S:
                self._logged_s[name] = now
                log.exception("tracker %r failed", name)
            why = f"its code failed ({type(failure).__name__}: {failure})"
            return self.lost(name, frame.shape, why[:160])

    def checked(self, name: str, report: object, shape: tuple[int, ...]) -> Feature:
        """`report` if it is a sound feature of a picture of `shape` (h, w, ...), otherwise a loss."""
        why = _unsound(report, self._last.get(name), shape)
        if why:
            return self.lost(name, shape, why)
        assert isinstance(report, Feature)
        if report.ok:
            self._last[name] = report
        return report

    def lost(self, name: str, shape: tuple[int, ...], why: str) -> Feature:
        """Where it was seen last, as a loss."""
        last = self._last.get(name)
        if last is None:
            last = Feature(frozen([(shape[1] - 1) / 2, (shape[0] - 1) / 2]))
        return replace(last, status="lost", score=0.0, detail=why)

    def keep(self, names: Collection[str]) -> None:
        """Forget what is not about the trackers in `names`."""
        self._last = {name: last for name, last in self._last.items() if name in names}


def _unsound(report: object, last: Feature | None, shape: tuple[int, ...]) -> str:
    """Why this is no feature; empty when it is one."""
    if not isinstance(report, Feature):
        return f"it reported {type(report).__name__} instead of a pixel"
    uv, segment = _numbers(report.uv, (2,)), _numbers(report.segment, (2, 2))
    if uv is None:
        return f"it reported no pixel: {report.uv!r}"[:80]
    if report.segment is not None and segment is None:
        return "it reported no line"
    if last is not None and (last.segment is None) != (report.segment is None):
        return "it reported a point for a line, or a line for a point"
    size = np.array([shape[1], shape[0]], float)
    if report.ok and not ((uv >= -0.5) & (uv <= size - 0.5)).all():
        return f"it reported ({uv[0]:.0f}, {uv[1]:.0f}), which is outside the picture"
    if segment is not None and not ((segment >= -BESIDE * size) & (segment <= (1 + BESIDE) * size)).all():
        return "it reported a line far outside the picture"
    return ""


def _numbers(values: object, shape: tuple[int, ...]) -> Array | None:
    """`values` as finite numbers of `shape`; None when they are not."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        return None
    return array if array.shape == shape and np.isfinite(array).all() else None
