"""Perception as in classic position-based servoing: calibrated beforehand, and never in doubt."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vita.impedance.config import ImpedanceConfig
from vita.impedance.perception import Perception, Seen
from vita.stereo.base import BaseFromCamera, StereoRig
from vita.stereo.moved_rig import MovedRig
from vita.stereo.online_calibration import OnlineCalibration
from vita.types import Array


class GivenPerception(Perception):
    """Perception that is told where the cameras stand and never doubts it."""

    def __init__(self, rig: StereoRig, config: ImpedanceConfig, T_base_left: Array, blind: bool) -> None:
        self._blind = blind
        super().__init__(rig, config)
        self.calibration, self.moved = _Given(T_base_left), _Unwatched(1e-3 * config.moved_mm, 1)

    def see(self, stamp: float, T_base_tool: Array, seen: Mapping[str, Seen]) -> bool:
        """Take in one pair of pictures; never says that the cameras have been moved."""
        super().see(stamp, T_base_tool, seen)
        if self._blind:
            self._bias = np.zeros(3)
        return False


class _Given(OnlineCalibration):
    """A calibration that was made beforehand."""

    def __init__(self, T_base_left: Array) -> None:
        super().__init__()
        self._known = BaseFromCamera(T_base_left, 0.0, 0, 0.0)

    @property
    def estimate(self) -> BaseFromCamera | None:
        return self._known

    def add(self, *pair: object) -> None:  # type: ignore[override]
        """Nothing is learned."""


class _Unwatched(MovedRig):
    """Nobody asks whether the cameras have been moved."""

    def update(self, *residual: object) -> bool:  # type: ignore[override]
        return False
