"""One camera of the simulated scene: its lens, its place, and the mishaps of its feed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from vita.poses import pose_matrix
from vita.scenario.schema import CameraSpec, Vector3
from vita.sim.camera import PinholeCamera, camera_pose
from vita.sim.depth_sensor import Depth, DepthSensor, Patch
from vita.sim.noise import CameraNoise
from vita.sim.render import STILL_AFTER, Renderer
from vita.types import Array, Image


@dataclass(frozen=True)
class Cover:
    """Something grey held before the lens."""

    at: tuple[float, float]
    """Its centre (column, row) [px]."""
    size_px: float
    until: float
    """Simulated time at which it goes away [s]."""


def grey_texture(seed: int = 20) -> Image:
    """(256, 256) a plain grey card with some grain, so that trackers see a real surface."""
    coarse = np.random.default_rng(seed).normal(0.0, 9.0, (64, 64))
    return np.clip(np.kron(coarse, np.ones((4, 4))) + 128.0, 0, 255).astype(np.uint8)


class CameraView:
    """Renders one camera and spoils the picture as the script asks."""

    _grey = grey_texture()

    def __init__(self, spec: CameraSpec, image_noise: float, seed: int, depth_noise_mm: float = 0.0) -> None:
        self.lens = PinholeCamera(spec.name, spec.size, spec.fov_deg)
        self._first_spec = spec
        width, height = spec.size
        self._noise = None
        if image_noise > 0:
            self._noise = CameraNoise(image_noise, seed, spec.name, width * height * 3)
        self._depth_sensor = DepthSensor(self.lens, depth_noise_mm, seed) if spec.depth else None
        self._drawn: tuple[bytes, Image, int] | None = None
        self._last: Image | None = None
        self._last_depth: Depth | None = None
        self.restore()

    def restore(self) -> None:
        """Back to the scenario's place, with a healthy feed."""
        self.spec = self._first_spec
        self._turn = np.eye(4)
        self.frozen_until = -np.inf
        self.black_until = -np.inf
        self.covers: list[Cover] = []

    def move(self, look_from: Vector3 | None, look_at: Vector3 | None, turn_deg: float) -> None:
        """Move an eye-to-hand camera, and roll any camera about its optical axis [deg]."""
        self.spec = replace(
            self.spec, look_from=look_from or self.spec.look_from, look_at=look_at or self.spec.look_at
        )
        self._turn = self._turn @ pose_matrix((0.0, 0.0, 0.0), (0.0, 0.0, turn_deg))

    def pose(self, poses: Mapping[str, Array]) -> Array:
        """(4, 4) T_world_camera, given where the bodies are."""
        return camera_pose(self.spec, poses) @ self._turn

    def frame(self, renderer: Renderer, poses: Mapping[str, Array], now: float) -> Image:
        """(height, width, 3) RGB picture at `now` [s], read-only."""
        if now < self.frozen_until and self._last is not None:
            return self._last
        self.covers = [cover for cover in self.covers if now < cover.until]
        if now < self.black_until:
            image = np.zeros((self.lens.size[1], self.lens.size[0], 3), dtype=np.uint8)
        else:
            image = self._draw(renderer, poses)
            if self.covers:
                image = image.copy()
                for cover in self.covers:
                    self._paint(image, cover)
            if self._noise is not None:
                image = self._noise.apply(image)
        image.setflags(write=False)
        self._last = image
        return image

    def depth(self, renderer: Renderer, poses: Mapping[str, Array], now: float) -> Depth | None:
        """(height / 4, width / 4) distances at `now` [m], read-only; None for a camera without depth."""
        if self._depth_sensor is None:
            return None
        if now < self.frozen_until and self._last_depth is not None:
            return self._last_depth
        if now < self.black_until:
            depth = self._depth_sensor.blind()
        else:
            covered = [self._patch(cover) for cover in self.covers if now < cover.until]
            depth = self._depth_sensor.measure(renderer, self.pose(poses), poses, covered)
        self._last_depth = depth
        return depth

    def _draw(self, renderer: Renderer, poses: Mapping[str, Array]) -> Image:
        """The clean picture. A scene in which nothing moved is drawn until it looks its best, not longer."""
        T_world_camera = self.pose(poses)
        key = T_world_camera.tobytes() + b"".join(T.tobytes() for T in poses.values())
        times = self._drawn[2] if self._drawn is not None and self._drawn[0] == key else 0
        if self._drawn is None or times <= STILL_AFTER:
            self._drawn = key, renderer.render(self.lens, T_world_camera, poses), times + 1
        return self._drawn[1]

    def _patch(self, cover: Cover) -> Patch:
        """The pixels that a cover hides."""
        (width, height), (u, v), half = self.lens.size, cover.at, cover.size_px / 2
        left, right = (int(np.clip(round(x), 0, width)) for x in (u - half + 0.5, u + half + 0.5))
        top, bottom = (int(np.clip(round(y), 0, height)) for y in (v - half + 0.5, v + half + 0.5))
        return left, right, top, bottom

    def _paint(self, image: Image, cover: Cover) -> None:
        left, right, top, bottom = self._patch(cover)
        rows, columns = np.arange(top, bottom) % 256, np.arange(left, right) % 256
        image[top:bottom, left:right] = self._grey[np.ix_(rows, columns)][..., None]
