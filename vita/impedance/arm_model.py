"""The kinematics of an arm, as this mode may know it: the controller's own model, not the simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

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
        first, second = self._terms
        steps = self.before + np.sin(q)[:, None, None] * first + (1.0 - np.cos(q))[:, None, None] * second
        T = frames[0] = steps[0]
        for i in range(1, self.n):
            T = np.matmul(T, steps[i], out=frames[i])
        np.matmul(T, self.T_last_tool, out=frames[self.n])
        return frames

    @cached_property
    def _terms(self) -> tuple[Array, Array]:
        """(n, 4, 4) twice: `before` times the K and the K K of Rodrigues' formula, made once because the
        frames are asked for hundreds of times a second."""
        K = np.zeros((self.n, 4, 4))
        x, y, z = self.axes.T
        K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -z, y, -x
        K[:, 1, 0], K[:, 2, 0], K[:, 2, 1] = z, -y, x
        return self.before @ K, self.before @ K @ K

    def outer(self, frames: Array, tip_xyz: Sequence[float] | Array) -> Array:
        """(k, 3) corners of the arm's outer part as a chain of segments: from the elbow, where it has one, to
        the tool's far end `tip_xyz` (3,) in the tool's frame [m]. `frames` come from `frames(q)`."""
        first = 0 if self.landmarks is None else self.landmarks[1]
        tip = frames[-1, :3, :3] @ np.asarray(tip_xyz, dtype=float) + frames[-1, :3, 3]
        return np.concatenate([frames[first:, :3, 3], tip[None]])

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
        axes = (frames[:count, :3, :3] @ self.axes[:count, :, None])[..., 0].T
        # The cross product by hand: numpy's own takes longer than all the rest.
        (x, y, z), (a, b, c) = axes, (point - frames[:count, :3, 3]).T
        J[:3, :count] = y * c - z * b, z * a - x * c, x * b - y * a
        J[3:, :count] = axes
        return J
