"""Letting trackers follow a sequence, and writing down how far off they were in each frame."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from tracker_cases import Shot
from tracker_rivals import Maker

from vita.errors import BadInput
from vita.types import Feature


@dataclass(frozen=True)
class Track:
    """What one tracker did in one sequence; arrays have one entry per frame after the first."""

    tracker: str
    case: str
    side: int
    number: int
    photo: str
    error: np.ndarray
    """Mean corner distance of what was reported, lost or not [px]; inf when there is no report."""
    ok: np.ndarray
    score: np.ndarray
    visible: np.ndarray
    """Share of the region that is seen."""
    uv: np.ndarray
    """(n, 2) reported pixel."""
    cpu: np.ndarray
    """CPU time of each update [s]."""
    limit: float = float("nan")
    """Smallest jitter that this region allows, see `shift_limit`; only where nothing moves [px]."""
    refused: str = ""
    """Why the tracker would not take the click at all."""


def follow_all(named: dict[str, Maker], shot: Shot, frames: Iterable[np.ndarray]) -> list[Track]:
    """Start every tracker once in the first frame and never help again.

    All see the same frames, so that they need to be made only once.
    """
    runs = [_Run(name, make, shot) for name, make in named.items()]
    visible = []
    for k, frame in enumerate(frames):
        if k:
            visible.append(shot.sequence.visible(shot.click, shot.side, k))
        for run in runs:
            run.see(k, frame)
    return [run.track(np.array(visible)) for run in runs]


class _Run:
    """One tracker on its way through one sequence."""

    def __init__(self, name: str, make: Maker, shot: Shot) -> None:
        self._name, self._make, self._shot = name, make, shot
        self._tracker = None
        self._anchor: np.ndarray | None = None
        self._refused = ""
        self._rows: list[tuple[float, bool, float, np.ndarray, float]] = []

    def see(self, k: int, frame: np.ndarray) -> None:
        if k == 0:
            self._begin(frame)
            return
        if self._tracker is None:
            self._rows.append((np.inf, False, 0.0, self._shot.click, 0.0))
            return
        started = time.thread_time()
        feature = self._tracker.update(frame)
        spent = time.thread_time() - started
        error = self._error(feature, k)
        self._rows.append((error, feature.ok, float(feature.score), np.array(feature.uv), spent))

    def _begin(self, frame: np.ndarray) -> None:
        try:
            self._tracker = self._make(frame, self._shot.click, float(self._shot.side))
        except BadInput as refusal:
            self._refused = str(refusal)
            return
        # The region is the tracker's own choice; what it shows in the first frame is what it must keep.
        self._anchor = self._tracker.update(frame).corners

    def _error(self, feature: Feature, k: int) -> float:
        if feature.corners is not None and self._anchor is not None:
            have, anchor = np.asarray(feature.corners), self._anchor
        else:
            have, anchor = np.asarray(feature.uv)[None], self._shot.click[None]
        apart = have - self._shot.sequence.truth(anchor, k)
        error = float(np.hypot(apart[:, 0], apart[:, 1]).mean())
        return error if np.isfinite(error) else np.inf

    def track(self, visible: np.ndarray) -> Track:
        columns = list(zip(*self._rows, strict=True)) if self._rows else [[]] * 5
        error, ok, score, uv, cpu = (np.array(c) for c in columns)
        s = self._shot
        return Track(
            self._name, s.case, s.side, s.number, s.photo, error, ok.astype(bool), score, visible,
            uv.reshape(-1, 2), cpu, shift_limit(s) if s.case == "still" else float("nan"), self._refused,
        )  # fmt: skip


def shift_limit(shot: Shot) -> float:
    """Cramer-Rao bound on the jitter of a region whose shift alone is estimated in each frame [px].

    Registration with more degrees of freedom jitters more; a tracker that jitters less does not
    measure every frame anew.
    """
    clean = next(iter(replace(shot.sequence, noise=0.0)))
    gray = cv2.cvtColor(clean, cv2.COLOR_RGB2GRAY).astype(np.float32)
    (u0, v0), n = np.rint(shot.click - shot.side / 2).astype(int), shot.side
    gx, gy = (cv2.Sobel(gray, cv2.CV_32F, dx, 1 - dx, scale=1 / 8)[v0 : v0 + n, u0 : u0 + n] for dx in (1, 0))
    information = np.array([[np.sum(gx * gx), np.sum(gx * gy)], [np.sum(gx * gy), np.sum(gy * gy)]], float)
    return float(shot.sequence.noise * np.sqrt(np.trace(np.linalg.inv(information)) / 2))
