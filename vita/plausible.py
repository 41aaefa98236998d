"""Does each feature move as the joints say it should? Finds jumps, swaps and trackers that stand still.

A tracker may say ok and be wrong: it leapt to a look-alike, changed places with another one, or
repeats itself. Nothing in its own picture tells. But while the arm moves, each feature's motion per
joint can be learned like a row of the image Jacobian, without camera or robot parameters, and then
the joints' motion since the last picture predicts where the feature should be in this one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vita.drift import DriftWatch
from vita.jolts import jolted
from vita.types import Array, Feature, frozen

Mask = NDArray[np.bool_]

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


@dataclass(frozen=True)
class Verdict:
    features: Mapping[str, Feature]
    """The features; those that cannot be believed are marked lost or, once, bridged."""
    swapped: tuple[str, ...] = ()
    """Two trackers that changed places, or none."""


class MotionCheck:
    """Watches the trackers of one run: `judge` once per control period while the arm moves.

    Each of the T features has a Kalman filter on its motion per joint, whose two rows share a
    covariance; all filters are updated at once.
    """

    def __init__(self, carried: frozenset[str] = frozenset()) -> None:
        """`carried` names the trackers that an earlier run has seen to move with the arm."""
        self._names: tuple[str, ...] = ()
        self._known = carried
        self._drifted: set[str] = set()

    def _begin(self, q: Array, features: Mapping[str, Feature]) -> None:
        self._names = tuple(features)
        self._q = q.copy()
        count, n = len(features), len(q)
        self._uv = np.array([feature.uv for feature in features.values()]).reshape(count, 2)
        """Where each was seen last [px]."""
        self._rows = np.zeros((count, 2, n))
        """d uv / d joints [px/rad]."""
        self._spread = np.tile(UNKNOWN_PX**2 * np.eye(n), (count, 1, 1))
        """Covariance of either row [px^2/rad^2]."""
        self._still = np.zeros(count, int)
        """Periods on end in which it should have moved and did not."""
        self._expected = np.full((count, 2), np.nan)
        """Where it should be by now, since it was lost or jumped; NaN while it is believed [px]."""
        self._way = np.zeros(count)
        """How far it should have gone since [px]."""
        self._drift, self._said = DriftWatch(self._uv, q), self._uv
        self._drifted.clear()

    @property
    def carried(self) -> frozenset[str]:
        """The trackers that were seen to move with the arm while it explored."""
        if not self._names:
            return self._known
        seen = zip(self._names, self._drift.carried, strict=True)
        return self._known.union(name for name, carried in seen if carried)

    def judge(
        self,
        q: Array,
        features: Mapping[str, Feature],
        cameras: Mapping[str, str],
        *,
        exploring: bool = True,
        alone: bool = True,
    ) -> Verdict:
        """Check the features seen at joints `q` (n,) [rad]; `cameras` names each tracker's camera.

        While `exploring`, the arm's motion owes nothing to the pictures, and what moves with it is carried by
        it. With `alone`, a feature is judged for drift even if nothing else in its view tells.
        """
        if self._names != tuple(features):
            self._begin(q, features)
            return Verdict(features)
        verdict = self._judge(q, features, cameras)
        return self._without_drift(verdict, q, features, cameras, exploring, alone)

    def _without_drift(
        self, verdict: Verdict, q: Array, features: Mapping[str, Feature], cameras: Mapping[str, str],
        exploring: bool, alone: bool,
    ) -> Verdict:  # fmt: skip
        """The verdict with the trackers that slide off their features lost, for the rest of the run."""
        # A feature that was bridged or lost for another reason tells nothing; lines slide by their nature.
        kept = [verdict.features[n] is f and f.ok and f.segment is None for n, f in features.items()]
        uv = np.array([feature.uv for feature in features.values()]).reshape(len(kept), 2)
        told = np.array(kept, bool) & np.array([n not in self._drifted for n in features], bool)
        told &= (uv != self._said).any(axis=1)  # Who repeats itself is stuck, and may come back.
        self._said = uv
        self._drift.update(q, uv, told, exploring)
        known = self.carried
        carried = np.array([n in known for n in features], bool) & told
        worst = None
        if not exploring:  # Of a few first motions, nobody can tell what the joints do and what they do not.
            worst = self._drift.drifting([cameras[n] for n in features], carried, alone)
        if worst is not None:
            self._drifted.add(self._names[worst])
        if not self._drifted:
            return verdict
        out = dict(verdict.features)
        for name in self._drifted:
            lost = replace(features[name], status="lost", score=0.0)
            out[name] = replace(lost, detail="it does not move as the arm does")
        return replace(verdict, features=out)

    def _judge(self, q: Array, features: Mapping[str, Feature], cameras: Mapping[str, str]) -> Verdict:
        """The checks from one picture to the next."""
        dq, self._q = q - self._q, q.copy()
        if not dq.any() or not features:
            return Verdict(features)
        seen = np.array([feature.uv for feature in features.values()])
        ok = np.array([feature.ok for feature in features.values()])
        should = self._rows @ dq
        blur = self._spread @ dq
        variance = blur @ dq + 2 * NOISE_PX**2
        sigma, size = np.sqrt(variance), np.hypot(*should.T)
        moved = seen - self._uv
        off = np.hypot(*(moved - should).T)
        doubted = np.isfinite(self._expected[:, 0])
        pair = self._swapped(seen, should, off, ok & ~doubted & (off > SIGMAS * sigma), cameras)
        jumped = ok & ~doubted & (off > JUMP_PX + JUMP_SHARE * size) & (off > SIGMAS * sigma)
        moving = ok & ~doubted & moved.any(axis=1)
        views = [cameras[name] for name in self._names]
        turned = np.zeros(len(views), bool) if pair else jolted(views, moving, off > SIGMAS * sigma, jumped)
        if turned.any():  # The camera moved, and its trackers are right.
            jumped &= ~turned
            self._known, self._drift = self.carried, DriftWatch(seen, q)
        jumped[list(pair)] = True
        stuck = ok & ~doubted & ~moved.any(axis=1) & (size > STILL_PX + sigma)
        self._still = np.where(stuck, self._still + 1, 0)
        self._doubt(should, jumped | doubted | ~ok)
        back, miss = self._back(seen, ok & doubted)
        believed = ok & ~jumped & ~(doubted & ~back)
        told = believed & ~doubted & ~stuck & ~turned
        self._learn(blur / variance[:, None], blur, dq, moved - should, told)
        self._uv = np.where(believed[:, None], seen, self._uv)
        out = dict(features)
        for i in map(int, np.flatnonzero(ok & (~believed | (self._still >= STILL_PERIODS)))):
            name = self._names[i]
            out[name] = self._suspect(i, features[name], off[i], miss[i], bool(jumped[i]), pair)
        return Verdict(out, tuple(self._names[i] for i in pair))

    def predict(self, dq: Array) -> dict[str, tuple[Array, Array]]:
        """Tracker name to where it was seen last, (1, 2), and where it will be after the joint motion
        `dq` (n,) [rad], as far as its motion has been learned [px]."""
        if not self._names or self._rows.shape[2] != len(dq):
            return {}
        after = self._uv + self._rows @ dq
        return {name: (self._uv[i : i + 1], after[i : i + 1]) for i, name in enumerate(self._names)}

    def _doubt(self, should: Array, which: Mask) -> None:
        """Go on by prediction alone."""
        base = np.where(np.isfinite(self._expected), self._expected, self._uv)
        self._expected = np.where(which[:, None], base + should, self._expected)
        self._way = np.where(which, self._way + np.hypot(*should.T), self._way)

    def _back(self, seen: Array, candidates: Mask) -> tuple[Mask, Array]:
        """Which of those that were lost or jumped are where the joints have carried them, and how
        far each is from there [px]."""
        miss = np.hypot(*(seen - self._expected).T)
        back = candidates & (miss <= JUMP_PX + RETURN_SHARE * self._way)
        self._expected[back], self._way[back] = np.nan, 0.0
        return back, miss

    def _learn(self, gain: Array, blur: Array, dq: Array, rest: Array, which: Mask) -> None:
        """Kalman update with the part `rest` (T, 2) of the motion that was not predicted [px]."""
        self._rows[which] += rest[which, :, None] * gain[which, None, :]
        grown = np.square(self._rows[which]).mean(axis=(1, 2)) * CHANGE**2 * float(dq @ dq)
        self._spread[which] -= gain[which, :, None] * blur[which, None, :]
        self._spread[which] += grown[:, None, None] * np.eye(len(dq))

    def _suspect(
        self, i: int, feature: Feature, off: float, miss: float, jumped: bool, pair: tuple[int, ...]
    ) -> Feature:
        """What is reported in place of a feature that cannot be believed."""
        if i in pair:
            other = self._names[pair[1 - pair.index(i)]]
            return self._lost(i, feature, f"it seems to have changed places with {other!r}")
        if jumped:
            why = f"it jumped {off:.0f} px in one picture"
            if feature.segment is not None:
                return self._lost(i, feature, why)
            # A single bad picture of a point is bridged by what the joints say.
            return replace(feature, uv=frozen(self._expected[i]), corners=None, outline=None, detail=why)
        if self._still[i] >= STILL_PERIODS:
            return self._lost(i, feature, "it is not updating although the arm moves")
        return self._lost(i, feature, f"it is {miss:.0f} px from where the arm should have carried it")

    def _lost(self, i: int, feature: Feature, why: str) -> Feature:
        return replace(feature, uv=frozen(self._uv[i]), status="lost", score=0.0, detail=why)

    def _swapped(
        self, seen: Array, should: Array, off: Array, odd: Mask, cameras: Mapping[str, str]
    ) -> tuple[int, ...]:
        """Two features, each where the other should be."""
        places = self._uv + should
        suspects = np.flatnonzero(odd & (off > APART_PX / 2))
        for a in suspects:
            for b in suspects[suspects > a]:
                crossed = np.hypot(*(seen[a] - places[b])) + np.hypot(*(seen[b] - places[a]))
                apart = np.hypot(*(places[a] - places[b])) > APART_PX
                same_view = cameras[self._names[a]] == cameras[self._names[b]]
                if same_view and apart and crossed < 0.5 * (off[a] + off[b]):
                    return int(a), int(b)
        return ()
