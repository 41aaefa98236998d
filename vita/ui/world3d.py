"""The arm, the objects and the cameras as meshes, moved with the poses of each snapshot."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import viser
import viser.transforms as vtf

from vita.scenario.schema import CameraSpec
from vita.snapshot import Snapshot
from vita.types import Array, Visual
from vita.ui.forces3d import Forces3D
from vita.ui.ghost_arm import GhostArm
from vita.ui.mesh import Mesh
from vita.ui.words import TEAL

SCENE_CENTER = np.array([0.35, 0.0, 0.30])
"""What a view of the whole scene looks at [m]."""
REACH_M = 1.35
"""How far from the arm's base something may be to belong to the 3D view [m]."""


def prepare(visuals: Sequence[Visual]) -> list[Mesh]:
    """What the 3D view shows of a rig, encoded once for all browsers and both views."""
    return [
        Mesh(v.body, v, _textured(v) if v.uv is not None and v.texture is not None else None)
        for v in visuals
        if near_the_arm(v)
    ]


class World3D:
    """One drawing of the scene under `root`, at `scale` board units per metre.

    Every mesh is a node of its own that is created once; a new pose only moves it.
    """

    def __init__(self, scene: viser.SceneApi, root: str, scale: float, labels: bool = False) -> None:
        """`labels`: whether it is drawn so large that words fit in."""
        self._scene, self._root, self.scale = scene, root, scale
        self._frame = scene.add_frame(root, show_axes=False, visible=False)
        self._bodies: dict[str, list[viser.SceneNodeHandle]] = {}
        self._cameras: dict[str, list[viser.SceneNodeHandle]] = {}
        self._last: dict[str, Array] = {}
        self._ghost, self._forces = GhostArm(scene), Forces3D(scene, labels)
        self._at, self._rotation = np.zeros(3), np.eye(3)
        self.revision = -1

    def place(self, position: Sequence[float], rotation: np.ndarray, visible: bool) -> None:
        """Put the world's origin at a board position, turned by `rotation` (3, 3)."""
        self._frame.position = tuple(float(p) for p in position)  # type: ignore
        self._frame.wxyz = vtf.SO3.from_matrix(rotation).wxyz
        self._frame.visible = visible
        self._at, self._rotation = np.array(position, float), np.array(rotation, float)

    def metres(self, board: Sequence[float]) -> Array:
        """(3,) where a place of the board (x, y, z) is in the scene [m]; the inverse of the drawing."""
        return self._rotation.T @ (np.asarray(board, float) - self._at) / self.scale

    def nodes(self, body: str) -> list[Any]:
        """The meshes of a body."""
        return list(self._bodies.get(body, ()))

    def rescale(self, scale: float) -> None:
        """Draw at another size: meshes take a scale, positions follow with the next update."""
        if abs(scale - self.scale) < 1e-3 * self.scale:
            return
        self.scale = scale
        for nodes in [*self._bodies.values(), *self._cameras.values()]:
            for node in nodes:
                if hasattr(node, "scale"):
                    node.scale = scale * (0.09 if "/cam/" in node.name else 1.0)  # type: ignore
        self._ghost.rescale(scale)
        self._forces.rescale(scale)
        self._last.clear()

    def build(self, meshes: Sequence[Mesh], cameras: Sequence[CameraSpec], revision: int) -> None:
        """Make the meshes of a rig; called again only when the rig changes."""
        for nodes in [*self._bodies.values(), *self._cameras.values()]:
            for node in nodes:
                node.remove()
        self._bodies, self._cameras, self._last, self.revision = {}, {}, {}, revision
        # New names, because a browser would show a node of an old name at the old node's pose.
        root = f"{self._root}/rig{revision}"
        self._ghost.build(f"{root}/ghost", meshes, self.scale)
        self._forces.build(f"{root}/forces", self.scale)
        for index, mesh in enumerate(meshes):
            node = self._mesh(f"{root}/body/{index}", mesh)
            self._bodies.setdefault(mesh.body, []).append(node)
        for spec in cameras:
            width, height = spec.size
            name = f"{root}/cam/{spec.name}"
            self._cameras[f"camera:{spec.name}"] = [
                self._scene.add_camera_frustum(
                    name, fov=np.radians(spec.fov_deg), aspect=width / height, scale=0.09 * self.scale,
                    thickness=1.6, thickness_units="screen", color=TEAL, cast_shadow=False,
                    receive_shadow=False,
                )
            ]

    def update(self, poses: Mapping[str, Array]) -> None:
        """Move what has moved since the last call."""
        for body, nodes in [*self._bodies.items(), *self._cameras.items()]:
            pose = poses.get(body)
            if pose is None and body == "world":
                pose = np.eye(4)
            if pose is None:
                continue
            before = self._last.get(body)
            if before is not None and np.abs(before - pose).max() < 1e-6:
                continue
            self._last[body] = np.array(pose)
            rotation = vtf.SO3.from_matrix(np.asarray(pose[:3, :3])).wxyz
            position = np.asarray(pose[:3, 3]) * self.scale
            for node in nodes:
                node.wxyz, node.position = rotation, position

    def foresee(self, ghost: Mapping[str, Array], poses: Mapping[str, Array]) -> None:
        """Show the arm as it is expected to be after the next step; hidden when there is nothing to show."""
        self._ghost.update(ghost, poses)

    def feel(self, snapshot: Snapshot, shown: bool) -> None:
        """Show what the stereo-impedance mode knows and does; nothing in the other mode."""
        self._forces.update(snapshot, shown)

    def _mesh(self, name: str, mesh: Mesh) -> viser.SceneNodeHandle:
        visual = mesh.visual
        color = tuple(int(round(255 * float(np.clip(c, 0, 1)))) for c in visual.color)
        if mesh.glb is None:
            # Drawing both sides would cost a quarter of the display rate where there is no GPU.
            return self._scene.add_mesh_simple(
                name, np.asarray(visual.vertices, np.float32), np.asarray(visual.faces, np.uint32),
                color=color, side="front", scale=self.scale, cast_shadow=False, receive_shadow=False,  # type: ignore
            )
        return self._scene.add_glb(
            name, mesh.glb, scale=self.scale, cast_shadow=False, receive_shadow=False
        )


def near_the_arm(visual: Visual) -> bool:
    """False for walls, floors and far things: a view from outside the room must not be blocked by them."""
    if visual.body != "world" or not len(visual.vertices):
        return bool(len(visual.vertices))
    low, high = np.min(visual.vertices, axis=0), np.max(visual.vertices, axis=0)
    far = np.abs((low + high) / 2)[:2].max() > REACH_M
    return not far and bool((high - low)[:2].max() < 2 * REACH_M) and low[2] < REACH_M


def looking(eye: np.ndarray) -> np.ndarray:
    """(3, 3) rotation from world axes to a lens at `eye` that looks at the scene: x right, y down, z away."""
    forward = SCENE_CENTER - eye
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def _textured(visual: Visual) -> bytes:
    """A GLB of a textured mesh. Metallic 0 and roughness 0.8, else it is black without an environment map."""
    import trimesh
    from PIL import Image as Picture
    from trimesh.visual.material import PBRMaterial
    from trimesh.visual.texture import TextureVisuals

    assert visual.uv is not None and visual.texture is not None
    uv = np.array(visual.uv, float)
    uv[:, 1] = 1.0 - uv[:, 1]  # trimesh counts from the bottom
    picture = Picture.fromarray(np.ascontiguousarray(visual.texture))
    picture.thumbnail((512, 512))
    picture.format = "JPEG"  # trimesh would otherwise write a PNG: larger, and much slower to make
    material = PBRMaterial(
        baseColorTexture=picture, metallicFactor=0.0, roughnessFactor=0.8,
        baseColorFactor=[*(float(c) for c in visual.color), 1.0],
    )
    mesh = trimesh.Trimesh(
        np.asarray(visual.vertices), np.asarray(visual.faces), vertex_normals=np.asarray(visual.normals),
        visual=TextureVisuals(uv=uv, material=material), process=False,
    )
    buffer = io.BytesIO()
    mesh.export(buffer, file_type="glb")
    return buffer.getvalue()
