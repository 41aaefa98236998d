"""The robots: the arms that ship by name, and any URDF by its path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from vita.assets import asset
from vita.errors import BadInput, UnknownName
from vita.impedance.arm_model import ArmModel
from vita.sim.arm_spec import ArmSpec
from vita.sim.dh import DHChain
from vita.sim.robot_names import ROBOTS
from vita.sim.shipped import SHIPPED
from vita.sim.urdf import Urdf, UrdfJoint
from vita.sim.urdf_file import read_urdf
from vita.sim.urdf_visuals import urdf_visuals
from vita.types import Array, Joint, Visual, frozen

__all__ = ["ROBOTS", "RobotModel", "load_robot"]

RESERVED = ("world", "flange", "tool")
"""Body names with a meaning of their own; a foreign link of that name becomes `NAME_link`."""
DEFAULT_SPEED = 1.0
"""Speed limit of a joint whose URDF gives none [rad/s]."""


@dataclass(frozen=True, eq=False)
class RobotModel:
    """An arm: its joints, where its links are, and what they look like."""

    name: str
    joints: tuple[Joint, ...]
    """The joints from the base to the tool. A sliding joint of a foreign URDF has metres for radians."""
    q_ready: Array
    """(n,) a good start pose: elbow bent, hand in front over the table [rad]."""
    urdf: Path
    link_names: tuple[str, ...]
    """Body names, parents first; the last one carries the flange. Ours: base, link1, ..., linkN."""
    T_last_tool: Array
    """(4, 4) tool frame in the last link's frame; z points out of the flange."""
    chain: DHChain | None
    """Denavit-Hartenberg parameters in the base frame; None for foreign URDFs."""
    T_world_base: Array
    """(4, 4) where the base stands. The base frame of a WAM or a Puma is its shoulder, above z = 0."""
    tree: Urdf = field(repr=False)
    """The parsed URDF."""
    bodies: dict[str, str] = field(repr=False)
    """URDF link name to body name."""
    landmarks: tuple[int, int, int] | None = None
    """Shoulder, elbow and wrist; see `ArmModel.landmarks`."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @cached_property
    def urdf_joints(self) -> tuple[UrdfJoint, ...]:
        """What the URDF says about each of `joints`, in the same order."""
        by_name = {joint.name: joint for joint in self.tree.joints}
        return tuple(by_name[joint.name] for joint in self.joints)

    def poses(self, q: Sequence[float] | Array) -> dict[str, Array]:
        """Body name to (4, 4) T_world_body at joint positions q (n,), with `flange` and `tool`."""
        q = np.asarray(q, dtype=float)
        if q.shape != (self.n,):
            raise BadInput(f"{self.name} has {self.n} joints, got shape {q.shape}", "q")
        positions = {joint.name: float(value) for joint, value in zip(self.joints, q, strict=True)}
        frames = self.tree.frames(positions)
        poses = {self.bodies[link]: self.T_world_base @ frame for link, frame in frames.items()}
        poses["flange"] = poses[self.link_names[-1]] @ self.T_last_tool
        poses["tool"] = poses["flange"].copy()
        return poses

    def arm_model(self) -> ArmModel:
        """The kinematics of the joints that turn the arm, for a controller. Raises `BadInput` for an arm
        with sliding joints."""
        before, T = [], self.T_world_base
        for joint in self.tree.path_to(self._last_link):
            T = T @ joint.origin
            if joint.movable:
                if joint.kind == "prismatic":
                    raise BadInput(f"joint {joint.name!r} slides; only turning joints do", self.name)
                before.append(T)
                T = np.eye(4)
        axes = np.array([joint.axis for joint in self.urdf_joints])
        return ArmModel(self.name, self.joints, np.array(before), axes, T @ self.T_last_tool, self.landmarks)

    @property
    def _last_link(self) -> str:
        return next(link for link, body in self.bodies.items() if body == self.link_names[-1])

    def visuals(self) -> tuple[Visual, ...]:
        """The meshes of the links; their bodies are `link_names`."""
        return _visuals(self.urdf, self.urdf.stat().st_mtime_ns)


@lru_cache(maxsize=8)
def _visuals(path: Path, _changed: int) -> tuple[Visual, ...]:
    """Meshes are read once for each version of a URDF file; they are immutable."""
    tree = read_urdf(path)
    return urdf_visuals(tree, _body_names(tree))


def load_robot(name_or_path: str) -> RobotModel:
    """The robot of a name in `ROBOTS` or of the path of a URDF file.

    Raises `UnknownName` for a name that is neither, `BadInput` for a file that cannot be used.
    """
    name = str(name_or_path)
    if name in SHIPPED:
        return _ours(SHIPPED[name])
    looks_like_path = any(sign in name for sign in ("/", "\\")) or name.lower().endswith((".urdf", ".xml"))
    if not looks_like_path and not Path(name).is_file():
        raise UnknownName("robot", name, (*ROBOTS, "the path of a URDF file"))
    return _foreign(Path(name).expanduser())


def _ours(spec: ArmSpec) -> RobotModel:
    path = asset("robots", spec.folder, f"{spec.name}.urdf")
    tree = read_urdf(path)
    bodies = _body_names(tree)
    T_last_tool = spec.chain.fixed(spec.chain.n - 1)
    T_last_tool[:3, 3] += T_last_tool[:3, 2] * spec.tool_reach
    T_world_base = np.eye(4)
    T_world_base[2, 3] = spec.base_height
    return RobotModel(
        name=spec.name,
        joints=tuple(_joint(joint) for joint in tree.joints if joint.movable),
        q_ready=frozen(spec.ready),
        urdf=path,
        link_names=tuple(bodies.values()),
        T_last_tool=frozen(T_last_tool),
        chain=spec.chain,
        T_world_base=frozen(T_world_base),
        tree=tree,
        bodies=bodies,
        landmarks=spec.landmarks,
    )


def _foreign(path: Path) -> RobotModel:
    tree = read_urdf(path)
    tip = tree.tip()
    arm = [joint for joint in tree.path_to(tip) if joint.movable]
    if not arm:
        raise BadInput("the robot has no joint that moves", str(path))
    bodies = _body_names(tree)
    others = [body for link, body in bodies.items() if link != tip]
    return RobotModel(
        name=tree.name,
        joints=tuple(_joint(joint) for joint in arm),
        q_ready=frozen([_ready(joint) for joint in arm]),
        urdf=path,
        link_names=(*others, bodies[tip]),
        T_last_tool=frozen(np.eye(4)),
        chain=None,
        T_world_base=frozen(np.eye(4)),
        tree=tree,
        bodies=bodies,
    )


def _joint(joint: UrdfJoint) -> Joint:
    return Joint(joint.name, joint.lower, joint.upper, joint.speed or DEFAULT_SPEED)


def _ready(joint: UrdfJoint) -> float:
    """A start position for a joint of which nothing is known: zero, or the middle of its range."""
    margin = 0.1 * (joint.upper - joint.lower)
    inside = joint.lower + margin <= 0.0 <= joint.upper - margin
    return 0.0 if inside else (joint.lower + joint.upper) / 2


def _body_names(tree: Urdf) -> dict[str, str]:
    """URDF link name to body name, parents first, clear of the reserved names."""
    links = [tree.root, *(joint.child for joint in tree.joints)]
    return {link: f"{link}_link" if link in RESERVED else link for link in links}
