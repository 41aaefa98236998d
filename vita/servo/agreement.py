"""Does the image move as the Jacobian says? Predicted against observed, camera by camera.

An estimator takes every measurement for the truth and adapts to it. That is right for a Jacobian that
changes as the arm moves, and wrong for one that is upside down: a camera that was turned, columns with
the wrong sign. There the arm moves with confidence and the image does something else altogether.

Confidence is the point. Where the Jacobian does not know what a step will do (near a singular pose,
along a motion that was never seen well), nothing contradicts it, and such steps are not counted.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from vita.servo.estimators.base import Estimate
from vita.types import Array, ErrorVector

CONFIDENT = 0.4
"""A prediction counts when noise and doubt together are below this share of it."""
CONTRADICTED = 1.0
"""The observed motion contradicts the predicted one when they differ by more than the larger of them."""
JOLT, LEAP = 3.0, 2.0
"""An image motion so many times the predicted one, and the largest of the last few, is no effect of the
joints: something was touched."""
WINDOW, ENOUGH = 4, 2
"""So many of the last predictions must be contradicted."""
JOLT_PERIODS = 5
"""A jolt is remembered for so long."""
GROWN, GROWN_PX = 1.05, 10.0
"""Without a jolt only an error that has grown by so much over its best is a reason to stop: a goal that is
carried away contradicts the Jacobian too, but the arm that follows it keeps up."""


@dataclass(frozen=True)
class Disagreement:
    """What does not move as was learned."""

    cameras: tuple[str, ...]
    """The views that contradict the Jacobian."""
    jolted: bool
    """Whether just these were jolted, and others were not: then it is they that moved, not the arm."""


class Agreement:
    """Watches a run: `update` once per control period."""

    def __init__(self) -> None:
        self._last: tuple[Array, Array] | None = None
        self._past: dict[str, deque[bool]] = {}
        self._jolts: dict[str, int] = {}
        self._motions: dict[str, deque[float]] = {}
        self._best = float("inf")

    def update(self, q: Array, error: ErrorVector, known: Estimate) -> Disagreement | None:
        """Take the joints `q` (n,) [rad] and the error; `known` is the estimate before it heard of them."""
        last, self._last = self._last, (q.copy(), error.values.copy())
        if last is None or last[1].size != error.values.size:
            return None
        dq, de = q - last[0], error.values - last[1]
        predicted = known.jacobian @ dq
        doubt2 = 2.0 * known.sigma**2 + float(known.spread2(dq))
        seen = np.isfinite(de) & (error.weights > 0.0)
        views = np.array([label.camera for label in error.labels])
        for camera in dict.fromkeys(views.tolist()):
            rows = seen & (views == camera)
            if rows.any():
                self._compare(camera, predicted[rows], de[rows], np.sqrt(doubt2 * np.count_nonzero(rows)))
        self._best = min(self._best, error.norm)
        grown = error.norm > GROWN * self._best + GROWN_PX
        return self._verdict(tuple(dict.fromkeys(views[seen].tolist())), bool(grown))

    def _compare(self, camera: str, predicted: Array, observed: Array, doubt: float) -> None:
        past = self._past.setdefault(camera, deque(maxlen=WINDOW))
        expected, moved = float(np.linalg.norm(predicted)), float(np.linalg.norm(observed))
        self._jolts[camera] = max(0, self._jolts.get(camera, 0) - 1)
        recent = self._motions.setdefault(camera, deque(maxlen=WINDOW))
        leapt = moved > LEAP * max(recent, default=np.inf)
        recent.append(moved)
        if moved > JOLT * expected and moved > JOLT * doubt and leapt:
            self._jolts[camera] = JOLT_PERIODS
        elif doubt < CONFIDENT * expected and moved < JOLT * expected:
            off = float(np.linalg.norm(observed - predicted))
            past.append(off > CONTRADICTED * max(expected, moved))

    def _verdict(self, cameras: tuple[str, ...], grown: bool) -> Disagreement | None:
        bad = tuple(c for c in cameras if sum(self._past.get(c, ())) >= ENOUGH)
        if not bad:
            return None
        still = [c for c in cameras if c not in bad]
        jolted = all(self._jolts.get(c) for c in bad) and not any(self._jolts.get(c) for c in still)
        if jolted and still:
            return Disagreement(bad, True)
        return Disagreement(bad, False) if grown else None
