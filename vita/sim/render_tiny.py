"""The fallback renderer: pybullet's TinyRenderer, which needs no OpenGL at all.

It takes the nearest texel and has no antialiasing, so each picture is drawn at its full size and then
softened a little; trackers hold, but some ten times worse than on the OpenGL pictures.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vita.errors import BadInput
from vita.sim.bullet import pybullet
from vita.sim.camera import PinholeCamera
from vita.sim.render import FAR_M, NEAR_M, body_poses
from vita.types import Array, Image, Visual

BACKDROP = (208, 212, 216)
LARGEST_TEXTURE_PX = 512
"""Finer pictures only flicker, as nothing averages the texels in between."""


class TinyRenderer:
    """Draws on the processor, in a pybullet connection of its own."""

    name = "tiny"

    def __init__(self, visuals: Sequence[Visual]) -> None:
        self._thread = threading.get_ident()
        self._client = pybullet.connect(pybullet.DIRECT)
        self._parts: list[tuple[str, int]] = []
        self._last: dict[str, Array] = {}
        self._shots: dict[str, tuple[bytes, NDArray[np.float32]]] = {}
        """Distances of each camera's last picture: it has them for nothing, and they are often asked next."""
        with tempfile.TemporaryDirectory() as folder:
            for number, visual in enumerate(visuals):
                self._parts.append((visual.body, self._load(visual, Path(folder) / f"{number}.png")))
        self._bodies = tuple(dict.fromkeys(body for body, _ in self._parts))

    def render(self, camera: PinholeCamera, T_world_camera: Array, poses: Mapping[str, Array]) -> Image:
        """(height, width, 3) RGB picture, read-only."""
        rgba, depth = self._shoot(camera, T_world_camera, poses)
        picture = np.ascontiguousarray(rgba[:, :, :3])
        picture[~np.isfinite(depth)] = BACKDROP
        picture = np.asarray(cv2.GaussianBlur(picture, (3, 3), 0.6), np.uint8)
        picture.setflags(write=False)
        return picture

    def depth(
        self, camera: PinholeCamera, T_world_camera: Array, poses: Mapping[str, Array], step: int = 1
    ) -> NDArray[np.float32]:
        """(height, width) distance along the optical axis [m]; inf where nothing is drawn. With a `step`,
        only every step-th row and column."""
        key, depth = self._shots.get(camera.name, (b"", np.empty(0, np.float32)))
        if key != self._key(camera, T_world_camera, poses):
            depth = self._shoot(camera, T_world_camera, poses)[1]
        return depth[::step, ::step].copy()

    def _key(self, camera: PinholeCamera, T: Array, poses: Mapping[str, Array]) -> bytes:
        """Everything that a picture depends on."""
        placed = body_poses(self._bodies, poses)
        parts = (np.array([*camera.size, camera.fov_deg]), np.asarray(T, dtype=float), *placed.values())
        return b"".join(part.tobytes() for part in parts)

    def close(self) -> None:
        """End the connection."""
        if self._client >= 0:
            pybullet.disconnect(self._client)
            self._client = -1

    def _shoot(
        self, camera: PinholeCamera, T: Array, poses: Mapping[str, Array]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        if threading.get_ident() != self._thread:
            raise BadInput("a renderer draws only in the thread that made it")
        self._place(body_poses(self._bodies, poses))
        (width, height), f = camera.size, camera.focal_px
        view = np.eye(4)
        # OpenGL cameras look along -z with y up.
        view[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ np.asarray(T)[:3, :3].T
        view[:3, 3] = -view[:3, :3] @ np.asarray(T)[:3, 3]
        span = FAR_M - NEAR_M
        projection = np.zeros((4, 4))
        projection[0, 0], projection[1, 1] = 2 * f / width, 2 * f / height
        projection[2, 2], projection[2, 3] = -(FAR_M + NEAR_M) / span, -2 * FAR_M * NEAR_M / span
        projection[3, 2] = -1.0
        _, _, rgba, buffer, _ = pybullet.getCameraImage(
            width,
            height,
            viewMatrix=view.T.reshape(-1).tolist(),
            projectionMatrix=projection.T.reshape(-1).tolist(),
            lightDirection=[0.55, -0.35, 1.0],
            lightAmbientCoeff=0.55,
            lightDiffuseCoeff=0.5,
            lightSpecularCoeff=0.03,
            shadow=0,
            renderer=pybullet.ER_TINY_RENDERER,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=self._client,
        )
        buffer = np.reshape(np.asarray(buffer, dtype=np.float64), (height, width))
        rgba = np.reshape(np.asarray(rgba, dtype=np.uint8), (height, width, 4))
        depth = np.full((height, width), np.inf, np.float32)
        seen = buffer < 1.0
        depth[seen] = FAR_M * NEAR_M / (FAR_M - span * buffer[seen])
        self._shots[camera.name] = self._key(camera, T, poses), depth
        return rgba, depth

    def _place(self, poses: Mapping[str, Array]) -> None:
        """Move the parts of those bodies that moved."""
        moved = {b for b, T in poses.items() if b not in self._last or not np.array_equal(self._last[b], T)}
        for body, part in self._parts:
            if body in moved:
                T = poses[body]
                pybullet.resetBasePositionAndOrientation(
                    part, T[:3, 3].tolist(), _quaternion(T[:3, :3]), physicsClientId=self._client
                )
        self._last.update({body: poses[body].copy() for body in moved})

    def _load(self, visual: Visual, path: Path) -> int:
        client = self._client
        uv = visual.uv if visual.uv is not None else np.zeros((len(visual.vertices), 2))
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            vertices=visual.vertices.tolist(),
            indices=np.asarray(visual.faces).reshape(-1).tolist(),
            normals=visual.normals.tolist(),
            uvs=(uv * [1, -1] + [0, 1]).tolist(),
            rgbaColor=[*visual.color, 1.0],
            physicsClientId=client,
        )
        part = pybullet.createMultiBody(0, -1, shape, physicsClientId=client)
        if visual.texture is not None:
            picture = visual.texture
            shrink = LARGEST_TEXTURE_PX / max(picture.shape[:2])
            if shrink < 1:
                picture = cv2.resize(picture, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
            cv2.imwrite(str(path), picture[:, :, ::-1])
            texture = pybullet.loadTexture(str(path), physicsClientId=client)
            pybullet.changeVisualShape(part, -1, textureUniqueId=texture, physicsClientId=client)
        return part


def _quaternion(R: Array) -> list[float]:
    """xyzw of a rotation, as pybullet wants it."""
    return Rotation.from_matrix(R).as_quat().tolist()
