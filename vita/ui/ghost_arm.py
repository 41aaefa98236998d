"""A translucent second arm: where the links are expected to be after the next step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import viser
import viser.transforms as vtf

from vita.types import Array
from vita.ui.ghost import GHOST
from vita.ui.mesh import Mesh

APPEAR_M, VANISH_M = 3e-3, 1.5e-3
"""A link is shown once it is expected to move so far, and until less than this: at the same place as the
link itself the two surfaces would flicker."""
OPACITY = 0.35


class GhostArm:
    """Its meshes are made when they are first shown; while it is off it costs nothing."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._scene = scene
        self._root, self._scale = "", 1.0
        self._meshes: dict[str, list[Mesh]] = {}
        self._corners: dict[str, Array] = {}
        """(k, 3) of each body's parts, in the body's frame [m]."""
        self._nodes: dict[str, list[viser.MeshHandle]] = {}
        self._shown: set[str] = set()

    def build(self, root: str, meshes: Sequence[Mesh], scale: float) -> None:
        """Take the meshes of a new rig."""
        for nodes in self._nodes.values():
            for node in nodes:
                node.remove()
        self._root, self._scale, self._nodes, self._shown = root, scale, {}, set()
        self._meshes, self._corners = {}, {}
        for mesh in meshes:
            self._meshes.setdefault(mesh.body, []).append(mesh)
        for body, parts in self._meshes.items():
            ends = np.array([[p.visual.vertices.min(axis=0), p.visual.vertices.max(axis=0)] for p in parts])
            self._corners[body] = ends.reshape(-1, 3)

    def rescale(self, scale: float) -> None:
        self._scale = scale
        for nodes in self._nodes.values():
            for node in nodes:
                node.scale = scale

    def update(self, ghost: Mapping[str, Array], poses: Mapping[str, Array]) -> None:
        """Show each body of `ghost` that differs from its present pose, and hide all others."""
        shown = {
            body for body in ghost
            if body in self._meshes and body in poses and self._apart(body, ghost[body], poses[body])
        }
        for body in self._shown - shown:
            for node in self._nodes[body]:
                node.visible = False
        for body in shown:
            pose = np.asarray(ghost[body])
            position, wxyz = pose[:3, 3] * self._scale, vtf.SO3.from_matrix(pose[:3, :3]).wxyz
            for node in self._nodes.get(body) or self._make(body):
                node.position, node.wxyz = position, wxyz
                if body not in self._shown:
                    node.visible = True
        self._shown = shown

    def _apart(self, body: str, there: Array, here: Array) -> bool:
        """Whether any part of the body is expected to move far enough [m]."""
        least = VANISH_M if body in self._shown else APPEAR_M
        change = np.asarray(there)[:3] - np.asarray(here)[:3]
        moved = self._corners[body] @ change[:, :3].T + change[:, 3]
        return float(np.linalg.norm(moved, axis=1).max()) >= least

    def _make(self, body: str) -> list[viser.MeshHandle]:
        number = len(self._nodes)  # Not the body's name, which may hold anything.
        self._nodes[body] = [
            self._scene.add_mesh_simple(
                f"{self._root}/{number}/{index}", np.asarray(mesh.visual.vertices, np.float32),
                np.asarray(mesh.visual.faces, np.uint32), color=GHOST, opacity=OPACITY, side="front",
                scale=self._scale, cast_shadow=False, receive_shadow=False, visible=False,
            )
            for index, mesh in enumerate(self._meshes[body])
        ]
        return self._nodes[body]
