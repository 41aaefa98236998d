"""The stereo-impedance mode in 3D: virtual mass, goal, forces, what is kept clear of, and what the cameras
say of the target, the tool and their own place.

What is seen is orange, as in the plots: the learned cameras stand beside the true ones until they are learned
well. Nodes are made when they are first needed and hidden while there is nothing to show.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import viser
import viser.transforms as vtf

from vita.impedance.config import ImpedanceConfig
from vita.impedance.view import Capsule, ImpedanceView
from vita.snapshot import Snapshot
from vita.types import Array
from vita.ui import shells
from vita.ui.impedance_words import BROWN, BY_CAMERAS, BY_JOINTS, FORCE, FORCES, PURPLE, strength
from vita.ui.labels import LabelPool
from vita.ui.mode import following
from vita.ui.words import GREEN, GREY, TEAL

METRES_PER_NEWTON, LONGEST_M = 0.02, 0.30
"""How long the arrow of one newton is, and the longest arrow [m]."""
MASS_M, DOT_M = 0.028, 0.011
"""Radii of the virtual mass and of the dots that mark the tool [m]."""
FRUSTUM_M = 0.1
"""Depth of a learned camera's pyramid; the true one's is a little smaller [m]."""
APART_M = 0.03
"""From this distance on a learned thing is told from the true one by a label [m]."""
SHELL_OPACITY = 0.16


def arrows(view: ImpedanceView) -> tuple[Array, np.ndarray]:
    """(k, 2, 3) start and end of an arrow per acting force [m] and (k, 3) colours.

    Lengths are proportional to the forces up to `LONGEST_M`. They begin at the surface of the mass's ball.
    """
    acting = [force for force in FORCES if strength(view, force.key)]
    if view.T_base_mass is None or not acting:
        return np.zeros((0, 2, 3)), np.zeros((0, 3), np.uint8)
    start = np.asarray(view.T_base_mass)[:3, 3]
    points = np.empty((len(acting), 2, 3))
    for index, force in enumerate(acting):
        pull = np.asarray(view.forces[force.key], float)
        size = float(np.linalg.norm(pull))
        direction, length = pull / size, min(size * METRES_PER_NEWTON, LONGEST_M)
        points[index] = start + MASS_M * direction, start + (MASS_M + length) * direction
    return points, np.array([force.color for force in acting], np.uint8)


def nearest(view: ImpedanceView) -> int:
    """Index of the obstacle that is nearest to the virtual mass; -1 without any."""
    if view.T_base_mass is None or not view.obstacles:
        return -1
    mass = np.asarray(view.T_base_mass)[:3, 3]
    return int(np.argmin([_distance(part, mass) for part in view.obstacles]))


def _distance(part: Capsule, place: Array) -> float:
    """From a place (3,) to a capsule's surface [m]."""
    along = np.asarray(part.end, float) - part.start
    share = np.clip((place - part.start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(place - part.start - share * along)) - part.radius


def learned_cameras(
    view: ImpedanceView, config: ImpedanceConfig, poses: Mapping[str, Array]
) -> dict[str, Array]:
    """Camera to (4, 4) pose as learned. The right one stands beside the left one as it does on the tripod."""
    if view.T_base_left is None:
        return {}
    found = {config.left: np.asarray(view.T_base_left)}
    left, right = poses.get(f"camera:{config.left}"), poses.get(f"camera:{config.right}")
    if left is not None and right is not None:
        found[config.right] = view.T_base_left @ np.linalg.inv(left) @ right
    return found


class Forces3D:
    """Drawn into one 3D view, at `scale` board units per metre."""

    def __init__(self, scene: viser.SceneApi, labels: bool) -> None:
        """`labels`: whether the view is large enough for words."""
        self._scene, self._labelled = scene, labels
        self._root, self._scale = "", 1.0
        self._nodes: dict[str, Any] = {}
        self._labels: LabelPool | None = None
        self._sizes: dict[str, tuple[float, float]] = {}
        self._used: set[str] = set()

    def build(self, root: str, scale: float) -> None:
        """Begin anew below `root`; what was drawn for another rig is removed."""
        for node in self._nodes.values():
            node.remove()
        self._labels = LabelPool(self._scene, f"{root}/words", 0.9) if self._labelled else None
        self._root, self._scale, self._nodes, self._sizes = root, scale, {}, {}

    def rescale(self, scale: float) -> None:
        self._scale = scale
        for name, node in self._nodes.items():
            node.scale = scale * (FRUSTUM_M if name.startswith("camera") else 1.0)

    def update(self, snapshot: Snapshot, shown: bool = True) -> None:
        """Show what `snapshot` holds; nothing in the other mode or while it is switched off."""
        if not self._root:
            return
        view, config = snapshot.impedance, snapshot.scenario.impedance
        self._used = set()
        words: list[tuple[str, Array]] = []
        if shown and following(snapshot):
            self._mass(view, words)
            self._seen(view, config)
            self._cameras(snapshot, words)
            self._shells(view, config)
            self._obstacles(view, config, snapshot.poses)
        for name, node in self._nodes.items():
            if node.visible != (name in self._used):
                node.visible = name in self._used
        if self._labels is not None:
            self._labels.show([
                # The goal's is below, so that it does not cover that of the mass.
                (text, _three(self._scale * at), "top-left" if text == "goal" else "bottom-left")
                for text, at in words
            ])

    # What there is to see.

    def _mass(self, view: ImpedanceView, words: list[tuple[str, Array]]) -> None:
        if view.T_base_goal is not None:
            self._put("goal", view.T_base_goal, lambda name: self._scene.add_frame(
                name, axes_length=0.09, axes_radius=0.002, origin_radius=0.006, origin_color=GREEN,
                scale=self._scale,
            ))
        if view.T_base_mass is None:
            return
        self._put("mass", view.T_base_mass, lambda name: self._ball(name, MASS_M, TEAL, 0.4))
        self._put("mass axes", view.T_base_mass, lambda name: self._scene.add_frame(
            name, axes_length=0.06, axes_radius=0.004, scale=self._scale
        ))
        at = np.asarray(view.T_base_mass)[:3, 3]
        words.append(("virtual mass", at + [0.0, 0.0, 1.3 * MASS_M]))
        if view.T_base_goal is not None and np.linalg.norm(view.T_base_goal[:3, 3] - at) > 2 * APART_M:
            words.append(("goal", np.asarray(view.T_base_goal)[:3, 3]))
        points, colors = arrows(view)
        if len(points):
            node = self._put("forces", np.eye(4), lambda name: self._scene.add_arrows(
                name, points.astype(np.float32), colors, shaft_radius=0.006, head_radius=0.016,
                head_length=0.035, scale=self._scale,
            ))
            node.points, node.colors = points.astype(np.float32), colors

    def _seen(self, view: ImpedanceView, config: ImpedanceConfig) -> None:
        """The target's outline, and the tool by the joints and by the cameras."""
        if view.T_base_target is not None:
            half = config.target_marker_m / 2
            corners = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
            lines = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
            lines = np.concatenate([lines, [[[0, 0, 0], [0, 0, 2 * half]]]])
            self._put("target", view.T_base_target, lambda name: self._scene.add_line_segments(
                name, lines.astype(np.float32), BY_CAMERAS, thickness=3.0, thickness_units="screen",
                scale=self._scale,
            ))
        for name, place, color in (
            ("tool by joints", view.tool_fk, BY_JOINTS), ("tool by cameras", view.tool_seen, BY_CAMERAS),
        ):
            if place is not None and np.isfinite(place).all():
                self._put(name, _at(place), lambda path, color=color: self._ball(path, DOT_M, color, None))

    def _cameras(self, snapshot: Snapshot, words: list[tuple[str, Array]]) -> None:
        specs = {spec.name: spec for spec in snapshot.scenario.camera}
        found = learned_cameras(snapshot.impedance, snapshot.scenario.impedance, snapshot.poses)
        for camera, pose in found.items():
            if camera not in specs:
                continue
            width, height = specs[camera].size
            fov = float(np.radians(specs[camera].fov_deg))
            self._put(f"camera {camera}", pose, lambda name, fov=fov, w=width, h=height: (
                self._scene.add_camera_frustum(
                    name, fov=fov, aspect=w / h, scale=FRUSTUM_M * self._scale, thickness=2.2,
                    thickness_units="screen", color=BY_CAMERAS, cast_shadow=False, receive_shadow=False,
                )
            ))
            true = snapshot.poses.get(f"camera:{camera}")
            if true is not None and np.linalg.norm(pose[:3, 3] - true[:3, 3]) > APART_M:
                words.append((f"{camera}, as learned", pose[:3, 3]))

    def _shells(self, view: ImpedanceView, config: ImpedanceConfig) -> None:
        """From where on table and base push; only while they do."""
        if view.T_base_mass is None:
            return
        x, y, _ = np.asarray(view.T_base_mass)[:3, 3]
        if strength(view, "table"):
            place = _at(np.array([x, y, config.table_z + config.table_m]))
            self._shell("table", place, 0.0, 0.25, BROWN, lambda _, r: shells.sheet(r))
        if strength(view, "base"):
            self._shell("base", np.eye(4), 1.2, config.base_m, PURPLE, shells.tube)

    def _obstacles(
        self, view: ImpedanceView, config: ImpedanceConfig, poses: Mapping[str, Array]
    ) -> None:
        """People and obstacles: as far as they push, while they do; and those that have no picture."""
        pushed = bool(strength(view, "people"))
        near = nearest(view)
        for index, part in enumerate(view.obstacles):
            if part.body not in poses:
                self._capsule(f"body {index}", part, 0.0)
            if pushed and index == near:  # All parts of a person at once would hide everything.
                self._capsule(f"near {index}", part, config.people_m)
        if view.surface is not None and len(view.surface.points):
            points = np.asarray(view.surface.points, np.float32)
            node = self._put("surface", np.eye(4), lambda name: self._scene.add_point_cloud(
                name, points, GREY, point_size=0.006, scale=self._scale
            ))
            node.points = points

    # How it is drawn.

    def _put(self, key: str, pose: Array, make: Callable[[str], Any]) -> Any:
        """The node `key`, made when it is new, at `pose` (4, 4)."""
        if key not in self._nodes:
            self._nodes[key] = make(f"{self._root}/{key.replace('/', ' ')}")
        node = self._nodes[key]
        self._used.add(key)
        pose = np.asarray(pose, float)
        node.position = pose[:3, 3] * self._scale
        node.wxyz = vtf.SO3.from_matrix(pose[:3, :3]).wxyz
        return node

    def _capsule(self, key: str, part: Capsule, more: float) -> None:
        length = float(np.linalg.norm(np.asarray(part.end) - part.start))
        place = shells.along(np.asarray(part.start), np.asarray(part.end))
        self._shell(key, place, length, part.radius + more, FORCE["people"].color, shells.capsule)

    def _shell(
        self, key: str, pose: Array, length: float, radius: float, color: tuple[int, int, int],
        make: Callable[[float, float], shells.Body],
    ) -> None:
        """A translucent body of these sizes [m]; it is made anew when they change."""
        key, size = f"shell {key}", (length, radius)
        known = self._sizes.get(key)
        if known is not None and np.abs(np.subtract(known, size)).max() > 2e-3:
            self._nodes.pop(key).remove()
            known = None
        if known is None:
            self._sizes[key] = size

        def mesh(name: str) -> Any:
            vertices, faces = make(length, radius)
            return self._scene.add_mesh_simple(
                name, vertices, faces, color=color, opacity=SHELL_OPACITY, side="double", scale=self._scale,
                cast_shadow=False, receive_shadow=False,
            )

        self._put(key, pose, mesh)

    def _ball(self, name: str, radius: float, color: tuple[int, int, int], opacity: float | None) -> Any:
        return self._scene.add_icosphere(
            name, radius, color, subdivisions=2, opacity=opacity, scale=self._scale, cast_shadow=False,
            receive_shadow=False,
        )


def _at(place: Array) -> Array:
    T = np.eye(4)
    T[:3, 3] = place
    return T


def _three(place: Array) -> tuple[float, float, float]:
    x, y, z = (float(part) for part in place)
    return x, y, z
