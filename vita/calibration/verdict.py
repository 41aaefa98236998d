"""What is weak about a calibration, in words that say what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from vita.calibration.detect import Sighting
from vita.calibration.pair import PairFit
from vita.calibration.solve import NAMES, CameraFit
from vita.types import Array

RMS_PX = 1.0
FOCAL_SHARE = 0.005
"""Standard deviation of a focal length that is still good, as a share of it."""
CENTRE_SHARE = 0.005
"""Standard deviation of the principal point that is still good, as a share of the picture's width."""
BASELINE_SHARE = 0.005
ROTATION_DEG = 0.15
FEW_VIEWS = 8
FEW_PAIRS = 6
PARALLEL_DEG = 12.0
"""Boards that turn by less than this from view to view are all parallel."""
_PLACES = (
    ("the top left", "the top", "the top right"),
    ("the left", "the middle", "the right"),
    ("the bottom left", "the bottom", "the bottom right"),
)


@dataclass(frozen=True)
class Finding:
    """One sentence. `poor` findings make the calibration poor; a `note` is advice."""

    level: Literal["poor", "note"]
    text: str


def judge_camera(fit: CameraFit, name: str) -> list[Finding]:
    """Of one camera; `name` begins the sentences."""
    found: list[Finding] = []
    views = len(fit.errors)
    if fit.rms_px > RMS_PX:
        text = f"the corners are {fit.rms_px:.2f} px off the best camera (rms; under 0.3 is usual): is"
        found.append(
            Finding("poor", f"{name}: {text} the board flat, the squares as given, the zoom and focus fixed?")
        )
    if views < FEW_VIEWS:
        found.append(Finding("poor", f"{name}: only {views} views; take 15 or more"))
    turn = _turn_deg(fit)
    if turn < PARALLEL_DEG:
        text = f"all views are parallel (within {turn:.0f} degrees), so the focal length is not determined"
        found.append(Finding("poor", f"{name}: {text}: add views with it tilted by 30 degrees each way"))
    found += _coverage(list(fit.sights.values()), fit.size, name)
    return found + _deviations(fit, name)


def _coverage(sights: Sequence[Sighting], size: tuple[int, int], name: str) -> list[Finding]:
    empty = empty_places(sights, size)
    if not empty:
        return []
    outer = [place for place in empty if place != "the middle"]
    where = _listed(empty)
    if len(outer) == 8:
        text = "all corners are in the middle of the picture, so distortion at its rims is a guess"
        return [
            Finding("poor", f"{name}: {text}: add views with the board near each side and corner, or closer")
        ]
    if len(outer) >= 4:
        return [
            Finding("poor", f"{name}: no corners in {where} of the picture: add views with the board there")
        ]
    return [
        Finding(
            "note", f"{name}: no corners in {where} of the picture; a view with the board there would help"
        )
    ]


def empty_places(sights: Sequence[Sighting], size: tuple[int, int]) -> list[str]:
    """The ninths of the picture in which no view has a corner."""
    counts = coverage(sights, size, (3, 3))
    return [_PLACES[row][col] for row in range(3) for col in range(3) if counts[row, col] == 0]


def coverage(sights: Sequence[Sighting], size: tuple[int, int], cells: tuple[int, int]) -> NDArray[np.int64]:
    """(rows, columns) number of corners in each cell of a grid of (columns, rows) over the picture."""
    counts = np.zeros(cells[::-1], np.int64)
    for sight in sights:
        at = ((sight.uv + 0.5) / size * cells).astype(int)
        cols, rows = np.clip(at, 0, np.array(cells) - 1).T
        np.add.at(counts, (rows, cols), 1)
    return counts


def _deviations(fit: CameraFit, name: str) -> list[Finding]:
    limits = [FOCAL_SHARE * fit.values[0], FOCAL_SHARE * fit.values[1], *[CENTRE_SHARE * fit.size[0]] * 2]
    worst = [
        f"{what} to {sd:.1f} px"
        for what, sd, limit in zip(NAMES[:4], fit.sd[:4], limits, strict=True)
        # `not` lets NaN count as too large.
        if not sd <= limit
    ]
    if not worst:
        return []
    text = f"known too little: {_listed(worst)} (standard deviation)"
    return [
        Finding("poor", f"{name}: {text}: add views with the board tilted by 30 to 45 degrees, near and far")
    ]


def judge_pair(fit: PairFit) -> list[Finding]:
    """How the two cameras stand to one another."""
    found = []
    if fit.rms_px > RMS_PX:
        text = f"the two cameras disagree ({fit.rms_px:.2f} px rms): were both pictures of each pair taken"
        found.append(Finding("poor", f"stereo: {text} at once, and did the cameras keep their places?"))
    if len(fit.pairs) < FEW_PAIRS:
        found.append(
            Finding("poor", f"stereo: only {len(fit.pairs)} pairs in which both see it; take 15 or more")
        )
    length = fit.rig.baseline
    if not fit.baseline_sd <= BASELINE_SHARE * length:
        text = f"baseline {1e3 * length:.1f} mm known to {1e3 * fit.baseline_sd:.2f} mm"
        found.append(Finding("poor", f"stereo: {text} (standard deviation): add pairs, closer and tilted"))
    if not fit.rotation_sd_deg <= ROTATION_DEG:
        text = f"rotation known to {fit.rotation_sd_deg:.2f} degrees (standard deviation)"
        found.append(Finding("poor", f"stereo: {text}: add pairs that reach the sides of both pictures"))
    return found


def _turn_deg(fit: CameraFit) -> float:
    """The largest angle between the board's normals in two views [deg]."""
    normals = np.array([_normal(pose) for pose in fit.poses.values()])
    return float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1.0, 1.0))))


def _normal(pose: Array) -> Array:
    return np.asarray(cv2.Rodrigues(pose[:3])[0], np.float64)[:, 2]


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
