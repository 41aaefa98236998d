"""What a line of sight meets first, among the meshes of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vita.types import Array, Visual

NEAREST_M = 1e-4
"""Nothing nearer to the eye than this is met [m]."""


class Surface:
    """The triangles of `visuals`, body by body."""

    def __init__(self, visuals: Sequence[Visual]) -> None:
        triangles: dict[str, list[Array]] = {}
        for visual in visuals:
            triangles.setdefault(visual.body, []).append(np.asarray(visual.vertices)[visual.faces])
        self._triangles = {body: np.concatenate(parts) for body, parts in triangles.items()}

    def hit(
        self, T_world_camera: Array, intrinsics: Array, pixel: Sequence[float], bodies: Mapping[str, Array]
    ) -> tuple[str, Array] | None:
        """The body seen at `pixel` and the place (3,) in the world where it is met [m]; None for none."""
        line = np.linalg.solve(intrinsics, [pixel[0], pixel[1], 1.0])
        toward = T_world_camera[:3, :3] @ line
        eye = T_world_camera[:3, 3]
        found = self.first(eye, toward, bodies)
        return None if found is None else (found[0], eye + found[1] * toward)

    def first(self, eye: Array, toward: Array, bodies: Mapping[str, Array]) -> tuple[str, float] | None:
        """The body that the ray from `eye` (3,) along `toward` (3,) meets first, and after how many times
        `toward`. Möller and Trumbore's test on all triangles of a body at once."""
        best: tuple[str, float] | None = None
        for body, corners in self._triangles.items():
            if body not in bodies:
                continue
            T = bodies[body]
            origin, ray = (eye - T[:3, 3]) @ T[:3, :3], toward @ T[:3, :3]
            a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
            p = np.cross(ray, v)
            det = np.einsum("ij,ij->i", u, p)
            with np.errstate(divide="ignore", invalid="ignore"):
                s = origin - a
                x = np.einsum("ij,ij->i", s, p) / det
                r = np.cross(s, u)
                y = (r @ ray) / det
                t = np.einsum("ij,ij->i", v, r) / det
                # Written so that NaN, from a triangle seen edge-on, counts as missed.
                met = (x >= 0) & (y >= 0) & (x + y <= 1) & (t > NEAREST_M)
            if met.any():
                near = float(t[met].min())
                if best is None or near < best[1]:
                    best = body, near
        return best
