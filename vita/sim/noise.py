"""Camera noise that costs a millisecond: drawn once, then read from random places."""

from __future__ import annotations

import zlib

import numpy as np

from vita.types import Image

SPARE = 1 << 20
"""Samples beyond one frame, so that the places to read from differ."""


class CameraNoise:
    """Gaussian noise of `sigma` grey levels for one camera.

    The generator is seeded by the scenario and the camera's name, so that adding a camera does not
    change what the others see.
    """

    def __init__(self, sigma: float, seed: int, camera: str, samples: int) -> None:
        """samples: numbers in one frame (height x width x 3)."""
        self._rng = np.random.default_rng([seed, zlib.crc32(camera.encode())])
        bank = self._rng.standard_normal(samples + SPARE, dtype=np.float32) * np.float32(sigma)
        self._bank = np.clip(np.rint(bank), -255, 255).astype(np.int16)
        self._sum = np.empty(samples, dtype=np.int16)

    def apply(self, image: Image) -> Image:
        """A noisy copy of `image`, different each time."""
        start = int(self._rng.integers(SPARE))
        np.add(self._bank[start : start + image.size], image.reshape(-1), out=self._sum)
        np.clip(self._sum, 0, 255, out=self._sum)
        return self._sum.astype(np.uint8).reshape(image.shape)
