"""A rig that costs next to nothing: a stick arm behind the real gate, and cameras that see one point of it.

There is no physics and nothing is drawn; what is real is what is tried with it: the engine, the servo and the
gate, thousands of times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vita.errors import BadInput
from vita.impedance.arm_model import ArmModel
from vita.impedance.view import Capsule
from vita.scenario.schema import (
    AttachSpec,
    CameraSpec,
    ConstraintSpec,
    Scenario,
    SceneSpec,
    ServoConfig,
    TrackerSpec,
)
from vita.servo.gate import Gate
from vita.stereo.hull import ArmHull
from vita.types import Array, Joint, JointStep, Observation, Visual, frozen

CYCLES = 8
"""Gate cycles in a frame period of 1/30 s."""
CAMERAS = {"left": 0.7, "right": -0.8}
"""Name to direction of view [rad]."""
SIZE = (160, 120)
START = (0.3, 0.5, -0.4, 0.0, 0.0, 0.0, 0.0)
"""As many joints as the robot has that the scenario names, so that its files are good; three of them move."""
GOAL = (2.35, 1.15, -0.571)


class StickRig:
    """Joints that reach each set point of the gate exactly."""

    def __init__(self) -> None:
        self.robot_joints: Sequence[Joint] = tuple(Joint(f"j{i}", -2.5, 2.5, 1.5) for i in range(len(START)))
        self.cameras = tuple(CAMERAS)
        self.gate = Gate(self.robot_joints)
        self.q = np.array(START)
        self.gate.reset(self.q)
        self.fail: Exception | None = None
        """Raised in place of the next observations; None while all is well."""
        self._number, self._cycles, self._asked = -1, 0, False
        self._stop = False
        """Asked for by any thread; the gate belongs to the one that observes."""
        picture = np.random.default_rng(0).integers(0, 255, (SIZE[1], SIZE[0], 3))
        self._frames = {name: frozen(picture, np.uint8) for name in CAMERAS}

    @property
    def joints(self) -> Sequence[Joint]:
        return self.gate.joints

    def observe(self) -> Observation:
        self._number += 1
        if self._number:
            idle = self.gate.at_rest and not self._asked  # Then seven of eight cycles would change nothing.
            for i in range(CYCLES):
                if self._stop:
                    self.gate.stop()
                if i == 0 or not idle:
                    self.q, _ = self.gate.cycle(self._now, self.q)
                self._cycles += 1
        if self.fail is not None:
            raise self.fail  # Nobody hears of the robot; it goes on all the same.
        return Observation(self._now, self._number, frozen(self.q), self._frames)

    @property
    def _now(self) -> float:
        return self._cycles / (30 * CYCLES)

    def command(self, step: JointStep | None) -> None:
        self._asked = step is not None and not self._stop
        self.gate.command(None if self._stop else step, self._now)

    def set_limits(self, joints: Sequence[Joint], acceleration: float | None = None) -> None:
        self.gate.set_limits(joints, acceleration)

    def gate_state(self) -> Mapping[str, object]:
        gate = self.gate
        return {
            "fault": gate.fault, "stopped": gate.stopped or self._stop, "dropped": gate.dropped,
            "at_rest": gate.at_rest, "saturated": np.flatnonzero(gate.saturated).tolist(),
        }  # fmt: skip

    def stop_now(self) -> None:
        self._stop = True

    def release(self) -> None:
        self._stop = False
        self.gate.release()

    def close(self) -> None:
        pass

    # ---- ground truth ------------------------------------------------------------------------------

    def locate(self, body: str, point: Sequence[float]) -> Array:
        if body != "tool":
            return np.array(point, float)
        a = np.cumsum(self.q[:3])
        hand = np.array([np.cos(a).sum(), np.sin(a).sum(), 0.8 * np.sin(a[0] - a[2])])
        return hand + point

    def project(self, camera: str, body: str, point: Sequence[float]) -> Array:
        where, turn = self.locate(body, point), CAMERAS[camera]
        x = np.cos(turn) * where[0] + np.sin(turn) * where[2]
        return np.array([SIZE[0] / 2 + 25 * x, SIZE[1] / 2 + 25 * where[1]])

    def distance(self, camera: str, body: str, point: Sequence[float]) -> float:
        return float(np.linalg.norm(self.locate(body, point) - (0.0, 0.0, -3.0)))

    def poses(self) -> Mapping[str, Array]:
        return {"world": np.eye(4)}

    def poses_at(self, q: Array) -> Mapping[str, Array]:
        return {}

    def arm_model(self) -> ArmModel:
        raise BadInput("a stick is no chain of joints that could be drawn")

    def arm_hull(self) -> ArmHull:
        raise BadInput("a stick has no drawing")

    def obstacles(self) -> Sequence[Capsule]:
        return ()

    def visuals(self) -> Sequence[Visual]:
        return ()

    def perform(self, action: str, **arguments: object) -> None:
        if action != "push_robot":
            raise BadInput(f"unknown action {action!r}")

    def hard_reset(self, q: np.ndarray) -> None:
        self.q = np.array(q, float)
        self.gate.reset(self.q, self._now)


def stick_task() -> Scenario:
    """The stick's point onto a goal, in both views."""
    trackers, constraints = [], []
    for name in CAMERAS:
        trackers += [
            TrackerSpec(f"tip_{name}", name, "projected", attach=AttachSpec("tool")),
            TrackerSpec(f"goal_{name}", name, "projected", attach=AttachSpec("world", GOAL)),
        ]
        pair = (f"tip_{name}", f"goal_{name}")
        constraints.append(ConstraintSpec(f"meet {name}", "point_to_point", pair))
    return Scenario(
        title="stick",
        scene=SceneSpec(q0_deg=tuple(np.rad2deg(START).tolist())),
        camera=tuple(CameraSpec(name, (1, 0, 0), (0, 0, 0), size=SIZE) for name in CAMERAS),
        tracker=tuple(trackers),
        constraint=tuple(constraints),
        servo=ServoConfig(gain=0.3, joints=(0, 1, 2)),
    )
