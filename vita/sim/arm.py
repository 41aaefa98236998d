"""An arm in pybullet, driven by position set-points."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from vita.errors import BadInput, RigOffline
from vita.sim.bullet import pybullet as p
from vita.sim.robots import RobotModel
from vita.sim.urdf_file import with_absolute_meshes
from vita.types import Array

STEP_S = 1 / 240
"""pybullet's usual physics step, for which set-points are made [s]."""
DEFAULT_EFFORT = 500.0
"""Torque limit of a joint whose URDF gives none [Nm]."""
SPEED_MARGIN = 1.05
"""The motors may run a little faster than the limit, or they could never catch up at full speed."""


def apply_dead_band(q_from: Array, q_target: Array, dead_band_rad: float) -> Array:
    """The target that a robot with a dead band goes to (thesis 5.1.3: motions below TOL are not
    carried out): joints that would move by less than `dead_band_rad` stay where they are."""
    q_from, q_target = np.asarray(q_from, dtype=float), np.asarray(q_target, dtype=float)
    return np.where(np.abs(q_target - q_from) < dead_band_rad, q_from, q_target)


class Arm:
    """One robot in one pybullet client. It limits nothing (the gate does) but takes finite values only."""

    def __init__(self, client_id: int, model: RobotModel, dead_band_rad: float = 0.0) -> None:
        if not (np.isfinite(dead_band_rad) and dead_band_rad >= 0):
            raise BadInput(f"must be zero or more, got {dead_band_rad}", "dead_band_rad")
        self.client, self.model, self.dead_band_rad = client_id, model, float(dead_band_rad)
        self.body = _load(client_id, model)
        index = {}
        for i in range(p.getNumJoints(self.body, physicsClientId=client_id)):
            index[p.getJointInfo(self.body, i, physicsClientId=client_id)[1].decode()] = i
        self._index = [index[joint.name] for joint in model.joints]
        self._effort = [joint.effort or DEFAULT_EFFORT for joint in model.urdf_joints]
        self._speed = [joint.max_speed * SPEED_MARGIN for joint in model.joints]
        self._locked: dict[int, float] = {}
        self._hold_others(index)
        self._settle_dynamics()
        self.reset(model.q_ready)

    def q(self) -> Array:
        """(n,) measured joint positions [rad]."""
        return np.array([state[0] for state in self._states()])

    def velocity(self) -> Array:
        """(n,) measured joint speeds [rad/s]."""
        return np.array([state[1] for state in self._states()])

    def drive(self, q_set: Sequence[float] | Array, v_set: Sequence[float] | Array) -> None:
        """Aim at `q_set` [rad] by the end of the next physics step, arriving at `v_set` [rad/s].

        Raises `BadInput` before anything reaches pybullet unless both are (n,) and finite: one NaN
        would make every joint NaN for good.
        """
        q_set, v_set = self._checked(q_set, "q_set"), self._checked(v_set, "v_set")
        for i, q, v, speed, effort in zip(self._index, q_set, v_set, self._speed, self._effort, strict=True):
            # With both gains at one the motor asks for the speed (target - q) / step + v. Taking off
            # what v brings along makes it arrive at q_set exactly, without lag.
            if i in self._locked:
                q, v = self._locked[i], 0.0
            p.setJointMotorControl2(
                self.body, i, p.POSITION_CONTROL, targetPosition=q - v * STEP_S, targetVelocity=v,
                positionGain=1.0, velocityGain=1.0, maxVelocity=speed, force=effort,
                physicsClientId=self.client,
            )  # fmt: skip

    def reset(self, q: Sequence[float] | Array) -> None:
        """Put the arm at q [rad] at rest at once, and hold it there."""
        q = self._checked(q, "q")
        self.unlock()
        for i, value in zip(self._index, q, strict=True):
            p.resetJointState(self.body, i, float(value), 0.0, physicsClientId=self.client)
        self.drive(q, np.zeros(self.model.n))

    def lock(self, joint: int) -> None:
        """Hold one joint, counted from 0, where it is, whatever is commanded. For trying that fault only."""
        self._locked[self._index[joint]] = float(self.q()[joint])

    def unlock(self) -> None:
        """Let every joint follow again."""
        self._locked.clear()

    def poison(self) -> None:
        """Give pybullet the one NaN that makes every joint NaN for good. For trying that fault only."""
        p.setJointMotorControl2(
            self.body, self._index[0], p.POSITION_CONTROL, targetPosition=float("nan"), force=1.0,
            physicsClientId=self.client,
        )  # fmt: skip

    def poses(self) -> dict[str, Array]:
        """Body name to (4, 4) T_world_body from the measured joints, with `flange` and `tool`."""
        return self.model.poses(self.q())

    def apply_dead_band(self, q_from: Array, q_target: Array) -> Array:
        """`apply_dead_band` with this arm's dead band."""
        return apply_dead_band(q_from, q_target, self.dead_band_rad)

    def _states(self) -> Sequence[tuple]:
        return p.getJointStates(self.body, self._index, physicsClientId=self.client)

    def _checked(self, values: Sequence[float] | Array, name: str) -> Array:
        array = np.asarray(values, dtype=float)
        if array.shape != (self.model.n,):
            raise BadInput(f"{self.model.name} needs shape ({self.model.n},), got {array.shape}", name)
        if not np.isfinite(array).all():
            bad = [self.model.joints[i].name for i in np.flatnonzero(~np.isfinite(array))]
            raise BadInput(f"not finite for {', '.join(bad)}", name)
        return array

    def _hold_others(self, index: dict[str, int]) -> None:
        """Joints that are not part of the arm (fingers, a second arm) are kept at zero."""
        for joint in self.model.tree.joints:
            i = index[joint.name]
            if joint.movable and i not in self._index:
                p.resetJointState(self.body, i, 0.0, 0.0, physicsClientId=self.client)
                p.setJointMotorControl2(
                    self.body, i, p.POSITION_CONTROL, targetPosition=0.0,
                    force=joint.effort or DEFAULT_EFFORT, physicsClientId=self.client,
                )  # fmt: skip

    def _settle_dynamics(self) -> None:
        """No artificial damping, and no massless links: both would spoil the tracking."""
        for i in range(-1, p.getNumJoints(self.body, physicsClientId=self.client)):
            mass, _, inertia = p.getDynamicsInfo(self.body, i, physicsClientId=self.client)[:3]
            options = dict(linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=self.client)
            if i >= 0 and (mass < 1e-4 or min(inertia) < 1e-6):
                floor = np.maximum(inertia, 1e-6).tolist()
                options |= dict(mass=max(mass, 1e-3), localInertiaDiagonal=floor)
            p.changeDynamics(self.body, i, **options)


def _load(client: int, model: RobotModel) -> int:
    """Load the URDF with a fixed base; mesh paths are made absolute first where they name a package."""
    xyz = model.T_world_base[:3, 3].tolist()
    quaternion = _quaternion_xyzw(model.T_world_base[:3, :3])
    flags = p.URDF_USE_INERTIA_FROM_FILE
    path, temporary = str(model.urdf), ""
    text = model.urdf.read_text(encoding="utf-8", errors="replace")
    if "://" in text and (located := with_absolute_meshes(text, model.urdf)) != text:
        handle, temporary = tempfile.mkstemp(suffix=".urdf")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(located)
        path = temporary
    try:
        return p.loadURDF(path, xyz, quaternion, useFixedBase=True, flags=flags, physicsClientId=client)
    except p.error as reason:
        if not p.isConnected(physicsClientId=client):
            raise RigOffline(f"pybullet client {client} is not connected") from reason
        raise BadInput(f"pybullet cannot load this URDF ({reason})", str(model.urdf)) from reason
    finally:
        if temporary:
            os.unlink(temporary)


def _quaternion_xyzw(R: Array) -> list[float]:
    """pybullet wants its quaternions with the real part last."""
    return Rotation.from_matrix(R).as_quat().tolist()
