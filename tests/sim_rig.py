"""A rig without pixels for tests of the engine: WAM-like numbers, projected trackers, no pybullet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vita.errors import BadInput, RigOffline
from vita.impedance.arm_model import ArmModel
from vita.impedance.view import Capsule
from vita.scenario.schema import (
    AttachSpec,
    CameraSpec,
    ConstraintSpec,
    NoiseSpec,
    Scenario,
    SceneSpec,
    ServoConfig,
    TrackerSpec,
)
from vita.stereo.hull import ArmHull
from vita.types import Array, Joint, JointStep, Observation, Visual, frozen

DT = 1 / 30
CAMERAS = ("left", "right")


class KinematicRig:
    """Three joints that carry out each command exactly, two cameras that see the hand as pixels."""

    def __init__(self) -> None:
        self.joints: Sequence[Joint] = tuple(Joint(f"j{i}", -2.5, 2.5, 1.5) for i in range(3))
        self.robot_joints = self.joints
        self.cameras = CAMERAS
        self.acceleration, self.gate_fault, self.stopped = None, "", False
        self.q = np.array([0.3, 0.5, -0.4])
        self.number, self.commands, self.performed = -1, [], []
        self.fail: Exception | None = None
        self.closed = False
        self._step: JointStep | None = None
        rng = np.random.default_rng(0)
        self._frames = {c: frozen(rng.integers(0, 255, (480, 640, 3)), np.uint8) for c in CAMERAS}

    def observe(self) -> Observation:
        if self.fail is not None:
            raise self.fail
        self.number += 1
        if self._step is not None:
            reach = np.array([j.max_speed for j in self.joints]) * DT
            target = self._step.q_from + self._step.dq
            lower, upper = ([getattr(j, k) for j in self.joints] for k in ("lower", "upper"))
            self.q = np.clip(self.q + np.clip(target - self.q, -reach, reach), lower, upper)
        return Observation(self.number * DT, self.number, frozen(self.q), self._frames)

    def command(self, step: JointStep | None) -> None:
        self.commands.append(step)
        self._step = None if self.stopped else step

    def set_limits(self, joints: Sequence[Joint], acceleration: float | None = None) -> None:
        self.joints = tuple(joints)
        self.acceleration = acceleration

    def gate_state(self) -> Mapping[str, object]:
        rest = {"saturated": (), "dropped": 0, "at_rest": True}
        return {"fault": self.gate_fault, "stopped": self.stopped, **rest}

    def stop_now(self) -> None:
        self.stopped = True
        self._step = None

    def release(self) -> None:
        self.stopped, self.gate_fault = False, ""

    def hand(self) -> Array:
        a = np.cumsum(self.q)
        return np.array([np.cos(a).sum(), np.sin(a).sum(), 0.8 * np.sin(a[0] - a[2])])

    def project(self, camera: str, body: str, point: Sequence[float]) -> Array:
        where = self.hand() + point if body == "tool" else np.array(point, float)
        turn = 0.3 if camera == "left" else -0.4
        x = np.cos(turn) * where[0] + np.sin(turn) * where[2]
        return np.array([320 + 110 * x, 240 + 110 * where[1]])

    def distance(self, camera: str, body: str, point: Sequence[float]) -> float:
        eye = (0.0, 0.0, -2.0 if camera == "left" else -3.0)
        return float(np.linalg.norm(self.locate(body, point) - eye))

    def locate(self, body: str, point: Sequence[float]) -> Array:
        return self.hand() + point if body == "tool" else np.array(point, float)

    def poses_at(self, q: Array) -> Mapping[str, Array]:
        return {"tip": np.eye(4)}

    def poses(self) -> Mapping[str, Array]:
        return {"world": np.eye(4)}

    def arm_model(self) -> ArmModel:
        raise NotImplementedError("this rig's hand is no chain of joints")

    def arm_hull(self) -> ArmHull:
        raise NotImplementedError("this rig's hand has no drawing")

    def obstacles(self) -> Sequence[Capsule]:
        return ()

    def visuals(self) -> Sequence[Visual]:
        return ()

    def perform(self, action: str, **arguments: object) -> None:
        if action == "break":
            self.fail = RigOffline("the simulation ended")
        elif action != "wave":
            raise BadInput(f"unknown action {action!r}")
        self.performed.append((action, arguments))

    def hard_reset(self, q: Array) -> None:
        self.q = np.array(q, float)
        self._step = None

    def close(self) -> None:
        self.closed = True


GOAL = (2.35, 1.15, -0.571)


def scenario(**changes: object) -> Scenario:
    """Point to point in both views of `KinematicRig`, on projected trackers."""
    trackers, constraints = [], []
    for camera in CAMERAS:
        trackers += [
            TrackerSpec(f"tip_{camera}", camera, "projected", attach=AttachSpec("tool"), noise=NoiseSpec()),
            TrackerSpec(f"goal_{camera}", camera, "projected", attach=AttachSpec("world", GOAL)),
        ]
        constraints.append(
            ConstraintSpec(f"meet {camera}", "point_to_point", (f"tip_{camera}", f"goal_{camera}"))
        )
    base = Scenario(
        title="test",
        scene=SceneSpec(q0_deg=tuple(np.rad2deg([0.3, 0.5, -0.4]))),
        camera=tuple(CameraSpec(c, (1, 0, 0), (0, 0, 0), size=(640, 480)) for c in CAMERAS),
        tracker=tuple(trackers),
        constraint=tuple(constraints),
        servo=ServoConfig(gain=0.3),
    )
    from dataclasses import replace

    return replace(base, **changes)  # type: ignore[arg-type]
