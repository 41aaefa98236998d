"""What a user would take from OpenCV, behind the same protocol as vita's trackers.

Each gets the region that vita's tracker gets, and is written as its documentation suggests, with
the care that a reasonable user would take: coarse start for ECC, crops instead of whole frames.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from vita.types import Feature, Image, frozen
from vita.vision import TRACKER_KINDS, Tracker, make_tracker

Maker = Callable[[Image, np.ndarray, float], Tracker]
"""First frame, clicked pixel (2,) and side of the region [px] to a tracker."""
_STOP = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-4)


class KltPoints:
    """calcOpticalFlowPyrLK of clicked points from frame to frame: one call for all of a view."""

    def __init__(self, frame: Image, uvs: np.ndarray) -> None:
        """`uvs` (n, 2) [px]."""
        self._gray = _gray(frame)
        self._uvs = np.asarray(uvs, np.float32).reshape(-1, 1, 2)

    def update(self, frame: Image) -> list[Feature]:
        gray = _gray(frame)
        points, seen, residuals = cv2.calcOpticalFlowPyrLK(
            self._gray, gray, self._uvs, None, winSize=(31, 31), maxLevel=3  # type: ignore[call-overload]
        )  # fmt: skip
        self._gray, found = gray, seen.ravel().astype(bool)
        self._uvs = np.where(found[:, None, None], points, self._uvs)
        # OpenCV leaves the residual of a lost point as it was in memory.
        scores = 1 / (1 + np.where(found, residuals.ravel(), np.inf))
        return [
            Feature(frozen(uv), "ok" if ok else "lost", float(score))
            for uv, ok, score in zip(self._uvs[:, 0], found, scores, strict=True)
        ]


class KltPoint:
    """The same for a single point."""

    kind = "cv-klt"

    def __init__(self, frame: Image, uv: np.ndarray, side: float) -> None:
        self._points = KltPoints(frame, uv)

    def update(self, frame: Image) -> Feature:
        return self._points.update(frame)[0]


class Ecc:
    """findTransformECC with a homography against the first patch, from the last pose."""

    kind = "cv-ecc"
    flow = False

    def __init__(self, frame: Image, uv: np.ndarray, side: float) -> None:
        self._side = n = round(side)
        corner = np.rint(uv - (n - 1) / 2).astype(int)
        corner = np.clip(corner, 0, np.array(frame.shape[1::-1]) - n)
        self._gray = _gray(frame)
        self._patch = self._gray[corner[1] : corner[1] + n, corner[0] : corner[0] + n].copy()
        self._point = np.append(uv - corner, 1.0)
        self._pose = np.array([[1, 0, corner[0]], [0, 1, corner[1]], [0, 0, 1.0]])
        ends = np.array([[-0.5, n - 0.5, n - 0.5, -0.5], [-0.5, -0.5, n - 0.5, n - 0.5]])
        self._corners = np.vstack([ends, np.ones(4)])
        axis = np.linspace(0.1, 0.9, 5) * n
        self._dots = np.array([(x, y) for y in axis for x in axis])

    def update(self, frame: Image) -> Feature:
        gray = _gray(frame)
        start = self._flow(gray) if self.flow else self._pose
        self._gray = gray
        pose, score = self._fit(gray, start)
        if pose is None and self.flow:
            pose = start  # The flow is still something where ECC does not converge.
        if pose is not None:
            self._pose = pose
        uv, corners = _project(self._pose, self._point[:, None])[0], _project(self._pose, self._corners)
        return Feature(frozen(uv), "ok" if score >= 0.8 else "lost", score, frozen(corners))

    def _fit(self, gray: np.ndarray, start: np.ndarray) -> tuple[np.ndarray | None, float]:
        """Pose and correlation; only the surroundings are given to OpenCV, or its gradients cost most."""
        corners = _project(start, self._corners)
        if not np.isfinite(corners).all():
            return None, 0.0
        low, high = self._around(corners, 0.5 * self._side, gray)
        crop = np.ascontiguousarray(gray[low[1] : high[1], low[0] : high[0]])
        shift = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1.0]])
        warp = (shift @ start).astype(np.float32)
        try:
            score, warp = cv2.findTransformECC(
                self._patch, crop, warp, cv2.MOTION_HOMOGRAPHY, _STOP, None, 3  # type: ignore[call-overload]
            )  # fmt: skip
        except cv2.error:
            return None, 0.0
        pose = np.linalg.inv(shift) @ warp.astype(float)
        if not np.isfinite(_project(pose, self._corners)).all():
            return None, 0.0
        return pose / pose[2, 2], float(np.clip(score, 0, 1))

    def _flow(self, gray: np.ndarray) -> np.ndarray:
        """The last pose carried on by the flow of 25 points, forward and backward, with RANSAC."""
        before = _project(self._pose, np.vstack([self._dots.T, np.ones(len(self._dots))]))
        low, high = self._around(before, 0.5 * self._side + 16, gray)
        part = slice(low[1], high[1]), slice(low[0], high[0])
        new_crop, old_crop = np.ascontiguousarray(gray[part]), np.ascontiguousarray(self._gray[part])
        old = (before - low).astype(np.float32).reshape(-1, 1, 2)
        options = {"winSize": (21, 21), "maxLevel": 3}
        new, seen, _ = cv2.calcOpticalFlowPyrLK(old_crop, new_crop, old, None, **options)  # type: ignore[call-overload]
        back, again, _ = cv2.calcOpticalFlowPyrLK(new_crop, old_crop, new, None, **options)  # type: ignore[call-overload]
        good = (seen & again).ravel().astype(bool) & (np.abs(back - old).reshape(-1, 2).max(axis=1) < 1.0)
        if good.sum() < 4:
            return self._pose
        cv2.setRNGSeed(0)
        carried, _ = cv2.estimateAffinePartial2D(old[good] + low, new[good] + low, ransacReprojThreshold=2.0)
        return self._pose if carried is None else np.vstack([carried, [0, 0, 1]]) @ self._pose

    @staticmethod
    def _around(points: np.ndarray, margin: float, gray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and end pixel of the part of the picture that holds `points` (k, 2) and a margin [px]."""
        limit = np.array(gray.shape[::-1])
        low = np.clip(np.floor(points.min(axis=0) - margin), 0, limit - 32).astype(int)
        return low, np.clip(np.ceil(points.max(axis=0) + margin), low + 32, limit).astype(int)


class KltEcc(Ecc):
    """ECC after a coarse start by the flow of points: the best that OpenCV has."""

    kind = "cv-klt-ecc"
    flow = True


class Camshift:
    """CamShift on the histogram of hue and saturation of the region."""

    kind = "cv-camshift"

    def __init__(self, frame: Image, uv: np.ndarray, side: float) -> None:
        n = round(side)
        x, y = np.clip(np.rint(uv - side / 2).astype(int), 0, np.array(frame.shape[1::-1]) - n).tolist()
        self._window = x, y, n, n
        part = cv2.cvtColor(frame, cv2.COLOR_RGB2HSV)[y : y + n, x : x + n]
        self._histogram = cv2.calcHist([part], [0, 1], None, [30, 32], [0, 180, 0, 256])
        cv2.normalize(self._histogram, self._histogram, 0, 255, cv2.NORM_MINMAX)
        self._offset = np.zeros(2)
        self._offset = uv - self.update(frame).uv

    def update(self, frame: Image) -> Feature:
        hsv = cv2.cvtColor(frame, cv2.COLOR_RGB2HSV)
        likely = cv2.calcBackProject([hsv], [0, 1], self._histogram, [0, 180, 0, 256], 1)
        box, window = cv2.CamShift(likely, self._window, _STOP)
        if min(window[2:]) < 1:
            return Feature(frozen(np.array(self._window[:2]) + self._offset), "lost", 0.0)
        self._window = window
        x, y, w, h = window
        score = float(likely[y : y + h, x : x + w].mean() / 255)
        return Feature(frozen(np.array(box[0]) + self._offset), "ok", score)


class Mil:
    """TrackerMIL: a box that is moved, without turn or scale."""

    kind = "cv-mil"

    def __init__(self, frame: Image, uv: np.ndarray, side: float) -> None:
        cv2.setRNGSeed(0)
        n = round(side)
        x, y = np.rint(uv - side / 2).astype(int).tolist()
        self._uv, self._offset = np.asarray(uv, float), uv - (x, y)
        self._tracker = cv2.TrackerMIL_create()  # type: ignore[attr-defined]
        self._tracker.init(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR), (x, y, n, n))

    def update(self, frame: Image) -> Feature:
        found, box = self._tracker.update(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
        if found:
            self._uv = np.array(box[:2], float) + self._offset
        return Feature(frozen(self._uv), "ok" if found else "lost", 1.0 if found else 0.0)


def _vita(kind: str) -> Maker:
    return lambda frame, uv, side: make_tracker(kind, frame, uv, size_px=side)


OPENCV: dict[str, Maker] = {t.kind: t for t in (KltPoint, KltEcc, Ecc, Camshift, Mil)}
TEAMS: dict[str, Callable[[Image, np.ndarray], KltPoints]] = {KltPoint.kind: KltPoints}
"""Those that follow all the points of a view, (n, 2), in one call."""
SLOW = ("cv-mil",)
"""Trackers that get fewer sequences, so that a run ends in time."""


def makers() -> dict[str, Maker]:
    """Every tracker that can be named, vita's kinds first."""
    return {kind: _vita(kind) for kind in TRACKER_KINDS} | OPENCV


def _gray(frame: Image) -> np.ndarray:
    return np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY))


def _project(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(k, 2) images of homogeneous `points` (3, k)."""
    h = pose @ points
    return (h[:2] / h[2]).T
