"""Ground truth of the last observation, for judging and for ideal trackers. The servo never sees it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vita.errors import BadInput, UnknownName
from vita.scenario.schema import CameraSpec
from vita.sim.camera import PinholeCamera
from vita.types import Array, frozen


class GroundTruth:
    """Where everything was when the last frames were taken."""

    def __init__(self, cameras: Sequence[CameraSpec]) -> None:
        self._lenses = {spec.name: PinholeCamera(spec.name, spec.size, spec.fov_deg) for spec in cameras}
        self._seen: dict[str, Mapping[str, Array]] = {}
        self.poses: Mapping[str, Array] = {}
        """Body name to (4, 4) T_world_body; cameras as `camera:NAME`."""

    def update(self, poses: Mapping[str, Array], frozen_cameras: Sequence[str] = ()) -> None:
        """Take note of an observation. A frozen camera goes on seeing the past."""
        self.poses = {name: frozen(T) for name, T in poses.items()}
        for camera in self._lenses:
            if camera not in frozen_cameras or camera not in self._seen:
                self._seen[camera] = self.poses

    def project(self, camera: str, body: str, point: Sequence[float]) -> Array:
        """(2,) pixel of a point fixed to `body`; NaN behind the camera."""
        if camera not in self._lenses:
            raise UnknownName("camera", camera, self._lenses)
        poses = self._seen.get(camera, self.poses)
        T = poses[f"camera:{camera}"]
        return self._lenses[camera].project(T, self._place(poses, body, point)[None])[0]

    def distance(self, camera: str, body: str, point: Sequence[float]) -> float:
        """Distance of a point fixed to `body` from the camera's centre [m]."""
        if camera not in self._lenses:
            raise UnknownName("camera", camera, self._lenses)
        poses = self._seen.get(camera, self.poses)
        away = self._place(poses, body, point) - poses[f"camera:{camera}"][:3, 3]
        return float(np.linalg.norm(away))

    def locate(self, body: str, point: Sequence[float]) -> Array:
        """(3,) world position of a point fixed to `body` [m]."""
        return self._place(self.poses, body, point)

    def _place(self, poses: Mapping[str, Array], body: str, point: Sequence[float]) -> Array:
        if body not in poses:
            raise UnknownName("body", body, poses)
        xyz = np.asarray(point, dtype=float)
        if xyz.shape != (3,):
            raise BadInput(f"a point has three coordinates, got {point!r}")
        return poses[body][:3, :3] @ xyz + poses[body][:3, 3]
