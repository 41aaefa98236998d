"""The ideal tracker of experiments: ground truth with a noise of one's choice."""

from __future__ import annotations

import zlib
from collections.abc import Callable

import numpy as np

from vita.errors import BadInput, UnknownName
from vita.scenario.schema import NoiseSpec
from vita.types import Array, Feature, Image, frozen
from vita.vision.images import inside

NOISE_KINDS = ("perfect", "integer", "gaussian")


def tracker_seed(seed: int, name: str) -> int:
    """A seed of a tracker's own, so that adding one does not change the others' noise."""
    return zlib.crc32(f"{seed}/{name}".encode())


class ProjectedTracker:
    """Reports the pixel that `project()` gives, (2,) [px], with noise; lost where that is not seen."""

    kind = "projected"

    def __init__(
        self,
        project: Callable[[], Array],
        noise: NoiseSpec | None = None,
        seed: int = 0,
        size: tuple[int, int] | None = None,
    ) -> None:
        """`size` is the image's (width, height); None takes it from each frame."""
        noise = noise or NoiseSpec()
        if noise.kind not in NOISE_KINDS:
            raise UnknownName("noise", noise.kind, NOISE_KINDS, "noise.kind")
        if not 0 <= noise.sigma_px < np.inf:
            raise BadInput(f"{noise.sigma_px} is not a standard deviation in pixels", "noise.sigma_px")
        self._project, self._noise, self._size = project, noise, size
        self._random = np.random.default_rng(seed)
        self._uv = frozen([0.0, 0.0])

    def update(self, frame: Image) -> Feature:
        # Drawn in lost frames too: the noise of a frame then does not depend on what came before.
        noise = self._random.standard_normal(2)
        truth = np.asarray(self._project(), dtype=np.float64)
        size = self._size or (frame.shape[1], frame.shape[0])
        if truth.shape != (2,) or not inside(truth, size):
            return Feature(self._uv, "lost", 0.0, None, "outside the image")
        if self._noise.kind == "integer":
            truth = np.rint(truth)
        elif self._noise.kind == "gaussian":
            truth = truth + self._noise.sigma_px * noise
        self._uv = frozen(truth)
        return Feature(self._uv, "ok", 1.0, None, f"ground truth, {self._noise.kind}")
