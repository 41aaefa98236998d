"""The depth half of an RGB-D camera: how far what each pixel shows is along the optical axis.

It errs and fails as such sensors do. Its noise grows with the square of the distance, as that of everything
that triangulates. What it could not measure (the lens is dark or covered) is NaN, which must not be taken
for free space; where nothing is within range the distance is infinite.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from vita.sim.camera import PinholeCamera
from vita.sim.render import Renderer
from vita.types import DEPTH_STEP_PX, Array

Depth = NDArray[np.float32]
Patch = tuple[int, int, int, int]
"""Left, right, top and bottom edge in the colour picture, the right and bottom ones exclusive [px]."""


class DepthSensor:
    """Measures in every fourth row and column of one camera's picture."""

    def __init__(self, lens: PinholeCamera, noise_mm: float, seed: int) -> None:
        """noise_mm: standard deviation at a distance of 1 m [mm]."""
        self._lens, self._noise_m = lens, 1e-3 * noise_mm
        # Its own generator, so that measuring depth does not change the noise of any picture.
        self._rng = np.random.default_rng([seed, zlib.crc32(lens.name.encode()), 1])
        self._drawn: tuple[bytes, Depth] | None = None

    def measure(
        self, renderer: Renderer, T_world_camera: Array, poses: Mapping[str, Array], covered: Iterable[Patch]
    ) -> Depth:
        """(height / 4, width / 4) distances [m], read-only; NaN within the `covered` patches, as a card held
        before the lens is too near to be measured."""
        depth = self._draw(renderer, T_world_camera, poses)
        if self._noise_m > 0:
            noise = self._rng.standard_normal(depth.shape, dtype=np.float32)
            with np.errstate(invalid="ignore"):  # Infinity stays what it is.
                depth = np.where(np.isinf(depth), depth, depth + np.float32(self._noise_m) * noise * depth**2)
        depth = depth.copy()
        step = DEPTH_STEP_PX
        for left, right, top, bottom in covered:
            depth[-(-top // step) : -(-bottom // step), -(-left // step) : -(-right // step)] = np.nan
        depth.setflags(write=False)
        return depth

    def blind(self) -> Depth:
        """What it gives while it sees nothing at all: NaN everywhere."""
        width, height = self._lens.size
        depth = np.full((-(-height // DEPTH_STEP_PX), -(-width // DEPTH_STEP_PX)), np.nan, np.float32)
        depth.setflags(write=False)
        return depth

    def _draw(self, renderer: Renderer, T_world_camera: Array, poses: Mapping[str, Array]) -> Depth:
        """The true distances; a scene in which nothing moved is measured once."""
        key = T_world_camera.tobytes() + b"".join(T.tobytes() for T in poses.values())
        if self._drawn is None or self._drawn[0] != key:
            self._drawn = key, renderer.depth(self._lens, T_world_camera, poses, DEPTH_STEP_PX)
        return self._drawn[1]
