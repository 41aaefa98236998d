"""A robot description as plain frozen data, and where its links are at given joint positions.

Only what vita needs is kept: the tree of joints with their limits, and the geometry. pybullet
reads the same file again for the masses; keeping our own tree means that forward kinematics and
drawing need no physics engine.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from vita.types import Array

TURNING = ("revolute", "continuous")
KINDS = (*TURNING, "prismatic", "fixed")
"""The joint types that vita can use."""


GREY = (0.72, 0.73, 0.75)
"""What has no colour of its own."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """One box, cylinder, sphere, capsule or mesh of a link."""

    kind: str
    size: tuple[float, ...]
    """Box: x, y, z; cylinder and capsule: radius, length; sphere: radius; mesh: the three scales [m]."""
    origin: Array
    """(4, 4) in the link's frame."""
    color: tuple[float, float, float] | None
    """None when the URDF names none: then the mesh file may have its own."""
    mesh: Path | None = None


@dataclass(frozen=True)
class UrdfLink:
    name: str
    visual: tuple[Geometry, ...]
    collision: tuple[Geometry, ...]


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    name: str
    kind: str
    """revolute, continuous, prismatic or fixed."""
    parent: str
    child: str
    origin: Array
    """(4, 4) joint frame in the parent link's frame."""
    axis: Array
    """(3,) unit axis in the joint frame."""
    lower: float
    upper: float
    """Limits [rad, or m when prismatic]."""
    speed: float
    """Speed limit [rad/s or m/s]; 0 when the file gives none."""
    effort: float
    """Torque or force limit [Nm or N]; 0 when the file gives none."""

    @property
    def movable(self) -> bool:
        return self.kind != "fixed"

    def motion(self, q: float) -> Array:
        """(4, 4) child frame in the parent link's frame at joint position q."""
        if self.kind == "fixed":
            return self.origin
        first, second = self._terms
        if self.kind == "prismatic":
            return self.origin + q * first
        return self.origin + math.sin(q) * first + (1 - math.cos(q)) * second

    @cached_property
    def _terms(self) -> tuple[Array, Array]:
        """The origin times what the motion multiplies: the direction of a slide, or K and K K of
        Rodrigues' formula. Made once, because the poses of all links are asked for at every frame."""
        first = np.zeros((4, 4))
        if self.kind == "prismatic":
            first[:3, 3] = self.axis
        else:
            first[:3, :3] = cross_matrix(self.axis)
        return self.origin @ first, self.origin @ first @ first


@dataclass(frozen=True)
class Urdf:
    """A robot description: links by name, joints ordered so that parents come first."""

    path: Path
    name: str
    root: str
    links: Mapping[str, UrdfLink]
    joints: tuple[UrdfJoint, ...]

    def frames(self, positions: Mapping[str, float]) -> dict[str, Array]:
        """Link name to (4, 4) frame in the root link's frame; joints not named stand at zero."""
        frames = {self.root: np.eye(4)}
        for joint in self.joints:
            frames[joint.child] = frames[joint.parent] @ joint.motion(positions.get(joint.name, 0.0))
        return frames

    def path_to(self, link: str) -> tuple[UrdfJoint, ...]:
        """The joints from the root to `link`."""
        into = {joint.child: joint for joint in self.joints}
        path: list[UrdfJoint] = []
        while link in into:
            path.append(into[link])
            link = into[link].parent
        return tuple(reversed(path))

    def tip(self) -> str:
        """The end of the arm: the link behind the most turning joints, fingers left out.

        Sliding joints lose a tie, then the deepest link wins, then the first in the file.
        """
        forks = self._fingered()

        def finger(link: str) -> bool:
            passed = False
            for joint in self.path_to(link):
                passed = passed or joint.parent in forks
                if passed and joint.movable:
                    return True
            return False

        def merit(link: str) -> tuple[int, int, int]:
            path = self.path_to(link)
            turning = sum(joint.kind in TURNING for joint in path)
            sliding = sum(joint.kind == "prismatic" for joint in path)
            return turning, -sliding if turning else sliding, len(path)

        links = [self.root, *(joint.child for joint in self.joints)]
        return max((link for link in links if not finger(link)), key=merit)

    def _fingered(self) -> set[str]:
        """Links that at least three turning joints carry and that part into several moving branches:
        what moves beyond them is a gripper, not the arm. (With fewer, it is a torso or a body.)"""
        moving: dict[str, bool] = {}
        for joint in reversed(self.joints):  # children come before their parents
            moving[joint.parent] = (
                moving.get(joint.parent, False) or joint.movable or moving.get(joint.child, False)
            )
        forks = set()
        for link in self.links:
            branches = [
                j for j in self.joints if j.parent == link and (j.movable or moving.get(j.child, False))
            ]
            carried = sum(joint.kind in TURNING for joint in self.path_to(link))
            if len(branches) > 1 and carried >= 3:
                forks.add(link)
        return forks


def rotation_about(axis: Array, angle: float) -> Array:
    """(3, 3) rotation by `angle` [rad] about a unit axis (Rodrigues)."""
    K = cross_matrix(axis)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)


def cross_matrix(axis: Array) -> Array:
    """(3, 3) K with K v = axis x v."""
    x, y, z = axis
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=float)
