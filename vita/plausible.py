"""Does each feature move as the joints say it should? Finds jumps, swaps and trackers that stand still.

A tracker may say ok and be wrong: it leapt to a look-alike, changed places with another one, or
repeats itself. Nothing in its own picture tells. But while the arm moves, each feature's motion per
joint can be learned like a row of the image Jacobian, without camera or robot parameters, and then
the joints' motion since the last picture predicts where the feature should be in this one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vita.types import Array, Feature, frozen

JUMP_PX, JUMP_SHARE = 15.0, 0.8
"""A feature that is off its predicted place by more, plus a share of the predicted motion, jumped."""
RETURN_SHARE = 0.25
"""Share of the way that a feature should have gone by which it may miss its place and yet be back."""
SIGMAS = 4.0
"""Nor is anything a jump that the model does not exclude by so many standard deviations."""
UNKNOWN_PX = 1000.0
"""What a radian may do before anything is learned [px/rad]."""
NOISE_PX = 0.5
"""Tracker noise and what a linear model leaves out in one period."""
CHANGE = 0.5
"""How fast a feature's motion per joint changes, relative to itself [1/rad]."""
STILL_PX, STILL_PERIODS = 1.0, 3
"""So many periods on end without any motion, with more than this predicted in each: not updating."""
APART_PX = 6.0
"""Features that should be at least so far apart can be told from one another."""


@dataclass
class _Motion:
    """How one feature moves with the joints: a Kalman filter whose two rows share a covariance."""

    uv: Array
    """(2,) where it was seen last [px]."""
    rows: Array
    """(2, n) d uv / d joints [px/rad]."""
    spread: Array
    """(n, n) covariance of either row [px^2/rad^2]."""
    still: int = 0
    """Periods on end in which it should have moved and did not."""
    expected: Array | None = None
    """(2,) where it should be by now, since it was lost or jumped; None while it is believed [px]."""
    way: float = 0.0
    """How far it should have gone since [px]."""

    def predict(self, dq: Array) -> tuple[Array, float]:
        """(2,) motion [px] that `dq` (n,) [rad] should cause, and its standard deviation [px]."""
        return self.rows @ dq, float(np.sqrt(dq @ self.spread @ dq + 2 * NOISE_PX**2))

    def learn(self, dq: Array, moved: Array) -> None:
        gain = self.spread @ dq / (dq @ self.spread @ dq + 2 * NOISE_PX**2)
        self.rows = self.rows + np.outer(moved - self.rows @ dq, gain)
        size = float(np.square(self.rows).mean()) * CHANGE**2 * float(dq @ dq)
        self.spread = self.spread - np.outer(gain, dq @ self.spread) + size * np.eye(len(dq))

    def doubt(self, should: Array) -> None:
        """Go on by prediction alone."""
        self.expected = (self.uv if self.expected is None else self.expected) + should
        self.way += float(np.hypot(*should))

    def believe(self, uv: Array) -> None:
        self.uv, self.expected, self.way, self.still = uv, None, 0.0, 0


@dataclass(frozen=True)
class Verdict:
    features: Mapping[str, Feature]
    """The features; those that cannot be believed are marked lost or, once, bridged."""
    swapped: tuple[str, ...] = ()
    """Two trackers that changed places, or none."""


@dataclass
class MotionCheck:
    """Watches the trackers of one run: `judge` once per control period while the arm moves."""

    _known: dict[str, _Motion] = field(default_factory=dict)
    _q: Array | None = None

    def judge(self, q: Array, features: Mapping[str, Feature], cameras: Mapping[str, str]) -> Verdict:
        """Check the features seen at joints `q` (n,) [rad]; `cameras` names each tracker's camera."""
        last, self._q = self._q, q.copy()
        if last is None:
            for name, feature in features.items():
                self._meet(name, feature, len(q))
            return Verdict(features)
        dq = q - last
        if not dq.any():
            return Verdict(features)
        pair = self._swapped(dq, features, cameras)
        judged = {name: self._one(name, feature, dq, pair) for name, feature in features.items()}
        return Verdict(judged, pair)

    def _meet(self, name: str, feature: Feature, n: int) -> _Motion:
        if name not in self._known:
            self._known[name] = _Motion(feature.uv, np.zeros((2, n)), UNKNOWN_PX**2 * np.eye(n))
        return self._known[name]

    def _one(self, name: str, feature: Feature, dq: Array, swapped: tuple[str, ...]) -> Feature:
        motion = self._meet(name, feature, len(dq))
        should, sigma = motion.predict(dq)
        if name in swapped:
            motion.doubt(should)
            other = swapped[1 - swapped.index(name)]
            return _lost(feature, motion, f"it seems to have changed places with {other!r}")
        if not feature.ok:
            motion.doubt(should)
            return feature
        if motion.expected is not None:
            return self._back(motion, feature, should)
        moved = feature.uv - motion.uv
        off, size = float(np.hypot(*(moved - should))), float(np.hypot(*should))
        if off > JUMP_PX + JUMP_SHARE * size and off > SIGMAS * sigma:
            motion.doubt(should)
            assert motion.expected is not None
            why = f"it jumped {off:.0f} px in one picture"
            # A single bad picture of a point is bridged by what the joints say.
            return replace(feature, uv=frozen(motion.expected), corners=None, outline=None, detail=why) if (
                feature.segment is None
            ) else _lost(feature, motion, why)  # fmt: skip
        motion.still = motion.still + 1 if not moved.any() and size > STILL_PX + sigma else 0
        if motion.still >= STILL_PERIODS:
            return _lost(feature, motion, "it is not updating although the arm moves")
        if not motion.still:
            motion.learn(dq, moved)
        motion.uv = feature.uv
        return feature

    @staticmethod
    def _back(motion: _Motion, feature: Feature, should: Array) -> Feature:
        """Of a feature that was lost or jumped: whether it is where the joints have carried it."""
        motion.doubt(should)
        assert motion.expected is not None
        off = float(np.hypot(*(feature.uv - motion.expected)))
        if off <= JUMP_PX + RETURN_SHARE * motion.way:
            motion.believe(feature.uv)
            return feature
        return _lost(feature, motion, f"it is {off:.0f} px from where the arm should have carried it")

    def _swapped(
        self, dq: Array, features: Mapping[str, Feature], cameras: Mapping[str, str]
    ) -> tuple[str, ...]:
        """Two features, each where the other should be."""
        odd: list[tuple[str, Array, Array, float]] = []
        for name, feature in features.items():
            motion = self._known.get(name)
            if motion is None or motion.expected is not None or not feature.ok:
                continue
            should, sigma = motion.predict(dq)
            place = motion.uv + should
            off = float(np.hypot(*(feature.uv - place)))
            if off > max(APART_PX / 2, SIGMAS * sigma):
                odd.append((name, feature.uv, place, off))
        for i, (a, uv_a, place_a, off_a) in enumerate(odd):
            for b, uv_b, place_b, off_b in odd[i + 1 :]:
                crossed = np.hypot(*(uv_a - place_b)) + np.hypot(*(uv_b - place_a))
                apart = np.hypot(*(place_a - place_b)) > APART_PX
                if cameras[a] == cameras[b] and apart and crossed < 0.5 * (off_a + off_b):
                    return a, b
        return ()


def _lost(feature: Feature, motion: _Motion, why: str) -> Feature:
    return replace(feature, uv=frozen(motion.uv), status="lost", score=0.0, detail=why)
