"""A marker's pose at any instant from pictures that come each 30 ms (TUM IV-A: the extended Kalman filter).

The corner pixels themselves are the measurement, so a picture of one camera helps as well, pixel noise is
white as the filter believes, and a marker seen straight on needs no special care.
"""

from __future__ import annotations

import numpy as np

from vita.stereo.base import MarkerCorners, PoseEstimate, PoseSight, StereoRig
from vita.stereo.corner_update import Evidence, corrected
from vita.stereo.filter_model import (
    CornerModel,
    FilterSettings,
    MotionState,
    V,
    W,
    noise,
    predict,
    seen_corners,
)
from vita.stereo.rotations import rigid
from vita.types import Array

LONG_STEP = 0.01
"""Corrections beyond 10 mm or 10 mrad are linearised again where they lead."""
NOISIEST = 16.0
"""The variance of the pixels is taken to be at most this many times what it is said to be."""
CLEARLY = 1.3
"""Chance alone takes the learned level to no more than this."""
LEARN = 0.05
"""Share that one picture has in the learned level of the pixel noise."""


class PoseFilter:
    """Fed with every pair of pictures by `update`, asked for any instant by `at`."""

    def __init__(self, rig: StereoRig, size_m: float, settings: FilterSettings | None = None) -> None:
        self.settings = FilterSettings() if settings is None else settings
        self._model = CornerModel(rig, size_m)
        self._vigours = np.array(self.settings.vigour)
        self.restart()

    def restart(self) -> None:
        """Forget everything."""
        self._state: MotionState | None = None
        self._stamp = -np.inf
        self._refused = 0
        self._calm()
        self._level = 1.0

    def _calm(self) -> None:
        self._scores = np.zeros(len(self._vigours))
        self.vigour = float(self._vigours[0])
        """By how much the motion is livelier than a calm one."""
        self.nis: tuple[float, int] | None = None
        """Squared Mahalanobis distance of the last picture's innovation and its degrees of freedom."""

    @property
    def noise_level(self) -> float:
        """Variance of the pixels over what it is said to be: 1, unless the pictures clearly show more."""
        return self._level if self._level > CLEARLY else 1.0

    def wants_start(self, stamp: float) -> bool:
        """Whether `update` at `stamp` would make use of a pose from these pictures alone."""
        if self._state is None or stamp - self._stamp > self.settings.forget_s:
            return True
        return self._refused + 1 >= self.settings.patience

    def update(self, stamp: float, corners: MarkerCorners, start: PoseSight | None) -> bool:
        """Take in the corners seen at `stamp`; False if they were not believed or there was nothing to see.

        start: the pose that these corners show by themselves, from which the filter begins, or begins anew
        after too many refusals or too long an absence.
        """
        seen = seen_corners(corners)
        if not seen or stamp < self._stamp:
            return False
        if self._state is None or stamp - self._stamp > self.settings.forget_s:
            return self._begin(stamp, start)
        dt = stamp - self._stamp
        state, Q = predict(self._state, dt, self.settings), noise(dt, self.settings)
        sigma = corners.sigma_px * np.sqrt(self.noise_level)
        believed = self._believed(state, Q, seen, sigma)
        if believed is None:
            self._refused += 1
            return self._refused >= self.settings.patience and self._begin(stamp, start)
        cameras, evidence = believed
        covariance = state.covariance + self._livelier(state, Q, evidence) * Q
        self.nis = (evidence.distance2(covariance[:6, :6]), evidence.count)
        error, after = corrected(covariance, evidence, np.zeros(6))
        if np.abs(error[:6]).max() > LONG_STEP:
            again = self._evidence(state.shifted(error, after), seen, sigma)
            if all(camera in again for camera in cameras):
                evidence = sum((again[camera] for camera in cameras[1:]), start=again[cameras[0]])
                error, after = corrected(covariance, evidence, error[:6])
        self._state, self._stamp, self._refused = state.shifted(error, after), stamp, 0
        return True

    def at(self, stamp: float) -> PoseEstimate | None:
        """Where the marker is at `stamp`, as far as the pictures taken so far tell; None before the first."""
        if self._state is None:
            return None
        age = stamp - self._stamp
        s = predict(self._state, age, self.settings)
        covariance = s.covariance + self.vigour * noise(age, self.settings)
        return PoseEstimate(stamp, rigid(s.R, s.p), s.v, s.w, covariance, max(0.0, age))

    # ---- the steps of `update` -------------------------------------------------------------------

    def _begin(self, stamp: float, start: PoseSight | None) -> bool:
        if start is None or not np.isfinite(start.T_left_marker).all():
            return False
        covariance = np.zeros((12, 12))
        covariance[:6, :6] = start.covariance
        covariance[V, V] = self.settings.start_speed**2 * np.eye(3)
        covariance[W, W] = self.settings.start_turn_rate**2 * np.eye(3)
        T = np.array(start.T_left_marker, dtype=float)
        self._state = MotionState(T[:3, 3], T[:3, :3], np.zeros(3), np.zeros(3), covariance)
        self._stamp, self._refused = stamp, 0
        self._calm()
        return True

    def _evidence(
        self, state: MotionState, seen: list[tuple[int, Array]], sigma: float
    ) -> dict[int, Evidence]:
        """What each camera says, linearised at `state`."""
        h, H = self._model.expected(state)
        return {
            camera: Evidence.of(pixels - h[camera], H[camera], sigma)
            for camera, pixels in seen
            if np.isfinite(h[camera, 0])
        }

    def _believed(
        self, state: MotionState, Q: Array, seen: list[tuple[int, Array]], sigma: float
    ) -> tuple[list[int], Evidence] | None:
        """The cameras whose corners are where even a lively marker may be, and what they say together."""
        P = (state.covariance + self._vigours[-1] * Q)[:6, :6]
        found = self._evidence(state, seen, sigma)
        distances = {camera: one.distance2(P) for camera, one in found.items()}
        believed = [camera for camera, distance in distances.items() if distance <= self.settings.gate]
        if len(believed) == 2:
            both = found[0] + found[1]
            self._learn_noise(both)
            if both.distance2(P) <= 1.5 * self.settings.gate:
                return believed, both
        if not believed:
            return None
        camera = min(believed, key=lambda one: distances[one])
        return [camera], found[camera]

    def _learn_noise(self, both: Evidence) -> None:
        """Follow the true variance of the pixels: what no pose explains, seen by two cameras, is noise."""
        rest, freedom = both.unexplained()
        # Wild pictures must not teach that all are noisy: what one can say is bounded.
        level = self.noise_level * min(rest / freedom, 3.0)
        self._level = float(np.clip((1 - LEARN) * self._level + LEARN * level, 0.25, NOISIEST))

    def _livelier(self, state: MotionState, Q: Array, evidence: Evidence) -> float:
        """By how much the motion is livelier than a calm one, as the last pictures and this one tell."""
        distances, dets = evidence.surprise(
            state.covariance[:6, :6] + self._vigours[:, None, None] * Q[:6, :6]
        )
        self._scores = self.settings.memory * self._scores - 0.5 * (distances + dets)
        self._scores -= self._scores.max()
        shares = np.exp(self._scores)
        self.vigour = float(np.exp(shares @ np.log(self._vigours) / shares.sum()))
        return self.vigour
