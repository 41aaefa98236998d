"""Ideal pinhole cameras, many rigs of them at once, and what trackers report of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.types import Array, frozen

UP = frozen([0.0, 0.0, 1.0])
"""World z, which is up in the images."""


@dataclass(frozen=True, eq=False)
class Cameras:
    """The c cameras of a rig; with leading axes `...`, one rig for each run."""

    T_camera_world: Array
    """(..., c, 4, 4) world to camera; a camera looks along +z, x right, y down."""
    focal_px: float
    """Focal length [px]; pixels are square and the principal point is the origin."""

    @property
    def count(self) -> int:
        return self.T_camera_world.shape[-3]

    def depth(self, points: Array) -> Array:
        """(..., c, k) depth of `points` (..., k, 3) along each optical axis [m]."""
        return self._seen(points)[..., 2]

    def project(self, points: Array) -> Array:
        """(..., c, k, 2) pixels of `points` (..., k, 3) [m]."""
        seen = self._seen(points)
        return self.focal_px * seen[..., :2] / seen[..., 2:]

    def _seen(self, points: Array) -> Array:
        turn, shift = self.T_camera_world[..., :3, :3], self.T_camera_world[..., None, :3, 3]
        return points[..., None, :, :] @ turn.swapaxes(-1, -2) + shift


def look_at(eye: Array, target: Array, up: Array = UP) -> Array:
    """(..., 4, 4) T_camera_world of cameras at `eye` (..., 3) that look at `target` (..., 3) [m]."""
    return facing(eye, target - eye, up)


def facing(eye: Array, forward: Array, up: Array = UP) -> Array:
    """(..., 4, 4) T_camera_world of cameras at `eye` (..., 3) that look along `forward` (..., 3)."""
    eye, forward = np.broadcast_arrays(np.asarray(eye, float), np.asarray(forward, float))
    z = forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    x = np.cross(z, up)
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    turn = np.stack([x, np.cross(z, x), z], axis=-2)
    pose = np.zeros((*eye.shape[:-1], 4, 4))
    pose[..., :3, :3] = turn
    pose[..., :3, 3] = -(turn @ eye[..., None])[..., 0]
    pose[..., 3, 3] = 1.0
    return pose


@dataclass(frozen=True)
class Reading:
    """What a tracker makes of a true pixel (thesis 5.1.2 and 5.2.4)."""

    kind: str = "perfect"
    """`perfect`, `integer`, `gaussian`, or `impulsive` (Gaussian with rare wild values)."""
    sigma_px: float = 0.2
    """Standard deviation of `gaussian` and `impulsive` [px]."""
    wild_share: float = 0.03
    """Share of the readings of `impulsive` that are wild."""
    wild_px: float = 10.0
    """Standard deviation of those [px]."""

    def of(self, pixels: Array, random: np.random.Generator) -> Array:
        """Readings of `pixels`, any shape [px]."""
        if self.kind == "perfect":
            return pixels
        if self.kind == "integer":
            return np.rint(pixels)
        read = pixels + self.sigma_px * random.standard_normal(pixels.shape)
        if self.kind == "impulsive":
            wild = random.random(pixels.shape) < self.wild_share
            read = read + np.where(wild, self.wild_px * random.standard_normal(pixels.shape), 0.0)
        return read


READINGS = {
    "integer": Reading("integer"),
    "perfect": Reading("perfect"),
    "gaussian": Reading("gaussian", 0.2),
}
"""The thesis' three trackers."""
