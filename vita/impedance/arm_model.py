"""The kinematics of an arm, as this mode may know it: the controller's own model, not the simulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.errors import BadInput
from vita.types import Array, Joint, frozen


@dataclass(frozen=True, eq=False)
class ArmModel:
    """A chain of revolute joints with a tool at its end. Everything is in the robot's base frame, whose
    z = 0 is the plane on which the arm is mounted."""

    name: str
    joints: tuple[Joint, ...]
    before: Array
    """(n, 4, 4) joint i's frame in the frame of joint i - 1 (the base for the first) at q = 0 [m]."""
    axes: Array
    """(n, 3) unit axis of each joint in its own frame."""
    T_last_tool: Array
    """(4, 4) the tool in the last joint's frame [m]."""
    landmarks: tuple[int, int, int] | None = None
    """Indices of the joints whose frames mark shoulder, elbow and wrist; the wrist may be n, the tool. None
    where the arm has no elbow that can stretch."""

    def __post_init__(self) -> None:
        n = len(self.joints)
        for name, shape in (("before", (n, 4, 4)), ("axes", (n, 3)), ("T_last_tool", (4, 4))):
            values = frozen(getattr(self, name))
            if values.shape != shape or not np.isfinite(values).all():
                raise BadInput(f"expected finite numbers of shape {shape}, got {values.shape}", name)
            object.__setattr__(self, name, values)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def frames(self, q: Array) -> Array:
        """(n + 1, 4, 4) frames of the joints, turned, and of the tool at q (n,) [rad]."""
        q = np.asarray(q, dtype=float)
        if q.shape != (self.n,):
            raise BadInput(f"{self.name} has {self.n} joints, got shape {q.shape}", "q")
        frames = np.empty((self.n + 1, 4, 4))
        T = np.eye(4)
        for i in range(self.n):
            T = T @ self.before[i]
            T[:3, :3] = T[:3, :3] @ _turn(self.axes[i], q[i])
            frames[i] = T
        frames[self.n] = T @ self.T_last_tool
        return frames

    def pose(self, q: Array) -> Array:
        """(4, 4) T_base_tool at q (n,) [rad]."""
        return self.frames(q)[self.n]

    def jacobian(self, frames: Array, point: Array | None = None, joints: int | None = None) -> Array:
        """(6, n) geometric Jacobian of a base-frame `point` (3,) that moves with the last of the first
        `joints` joints (default: the tool, all): velocity [m/rad] over angular velocity. `frames` come from
        `frames(q)`."""
        count = self.n if joints is None else joints
        point = frames[self.n, :3, 3] if point is None else point
        J = np.zeros((6, self.n))
        axes = np.einsum("nij,nj->ni", frames[:count, :3, :3], self.axes[:count])
        J[:3, :count] = np.cross(axes, point - frames[:count, :3, 3]).T
        J[3:, :count] = axes.T
        return J


def _turn(axis: Array, angle: float) -> Array:
    """(3, 3) rotation by `angle` [rad] about a unit axis (Rodrigues)."""
    x, y, z = axis
    c, s = np.cos(angle), np.sin(angle)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + s * K + (1.0 - c) * (K @ K)
