"""An arm without mass and cameras without pictures: what a fault does to the real engine, hundreds of times.

The engine, its monitors and the gate are those of the product. Only physics and rendering are left out: the
arm is where the gate says, and a picture is a number that tells whether it is new.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vita.errors import BadInput
from vita.experiments.starts import IMAGE
from vita.experiments.trial import World
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
from vita.servo.gate import Gate
from vita.stereo.hull import ArmHull
from vita.types import Array, Image, Joint, JointStep, Observation, Visual, frozen

PERIOD_S, CYCLES = 1 / 30, 8
SPEED_RAD_S = 0.6
VIEWS = ("left", "right")
MIDDLE = (np.array(IMAGE) - 1) / 2


class ArmRig:
    """One run of a `World` as a rig: the points of its tool, two views, and the product's gate."""

    def __init__(self, world: World, run: int) -> None:
        self._arm, self._local = world.arm, world.local
        self._focal = world.cameras.focal_px
        self._rigs = world.cameras.T_camera_world[run]
        self.joints: Sequence[Joint] = tuple(
            Joint(f"j{i + 1}", float(low), float(high), SPEED_RAD_S)
            for i, (low, high) in enumerate(world.arm.limits)
        )
        self.robot_joints, self.cameras = self.joints, VIEWS
        self._gate = Gate(self.joints, dt=PERIOD_S / CYCLES)
        self._number = -1
        self._pictures = [frozen(np.full((IMAGE[1], IMAGE[0], 3), g), np.uint8) for g in (100, 101)]
        self._shown: dict[str, Image] = {}
        self._frozen: dict[str, Array] = {}
        self.q = world.q0[run].copy()
        self._gate.reset(self.q)

    @property
    def time(self) -> float:
        """Rig time [s]."""
        return max(self._number, 0) * PERIOD_S

    @property
    def tool_m(self) -> Array:
        """(3,) where the tool is [m]; for judging only."""
        return self._arm.pose(self.q)[:3, 3]

    def observe(self) -> Observation:
        if self._number >= 0:
            for cycle in range(CYCLES):
                self.q, _ = self._gate.cycle(self.time + cycle * PERIOD_S / CYCLES, self.q)
        self._number += 1
        new = self._pictures[self._number % 2]
        self._shown = {n: self._shown[n] if n in self._frozen else new for n in VIEWS}
        return Observation(self.time, self._number, frozen(self.q), dict(self._shown))

    def command(self, step: JointStep | None) -> None:
        self._gate.command(step, self.time)

    def set_limits(self, joints: Sequence[Joint], acceleration: float | None = None) -> None:
        self._gate.set_limits(joints, acceleration)
        self.joints = tuple(joints)

    def gate_state(self) -> Mapping[str, object]:
        gate = self._gate
        return {
            "stopped": gate.stopped, "fault": gate.fault, "kind": gate.kind, "dropped": gate.dropped,
            "saturated": np.flatnonzero(gate.saturated).tolist(), "at_rest": gate.at_rest,
        }  # fmt: skip

    def stop_now(self) -> None:
        self._gate.stop()

    def release(self) -> None:
        self._gate.release()

    def close(self) -> None:
        pass

    def project(self, camera: str, body: str, point: Sequence[float]) -> Array:
        """(2,) [px]."""
        place = self._at(body, point, self._frozen.get(camera, self.q))
        x, y, z = (self._rigs[VIEWS.index(camera)] @ np.append(place, 1.0))[:3]
        return self._focal * np.array([x, y]) / z + MIDDLE

    def distance(self, camera: str, body: str, point: Sequence[float]) -> float:
        rig = self._rigs[VIEWS.index(camera)]
        return float(np.linalg.norm((rig @ np.append(self.locate(body, point), 1.0))[:3]))

    def locate(self, body: str, point: Sequence[float]) -> Array:
        return self._at(body, point, self.q)

    def _at(self, body: str, point: Sequence[float], q: Array) -> Array:
        if body == "world":
            return np.asarray(point, float)
        return self._arm.points(q, np.asarray(point, float)[None])[0]

    def perform(self, action: str, **arguments: object) -> None:
        camera = str(arguments.get("camera"))
        if action == "freeze_camera" and camera in VIEWS:
            self._frozen[camera] = self.q.copy()
        elif action == "unfreeze_camera":
            self._frozen.pop(camera, None)
        else:
            raise BadInput(f"this rig cannot {action!r}")

    def hard_reset(self, q: Array) -> None:
        self.q = np.array(q, float)
        self._gate.reset(self.q, self.time)

    def poses(self) -> Mapping[str, Array]:
        return {"world": np.eye(4)}

    def poses_at(self, q: Array) -> Mapping[str, Array]:
        return {}

    def visuals(self) -> Sequence[Visual]:
        return ()

    def obstacles(self) -> Sequence[Capsule]:
        return ()

    def arm_model(self) -> ArmModel:
        raise NotImplementedError("this rig is for servoing only")

    def arm_hull(self) -> ArmHull:
        raise NotImplementedError("this rig is for servoing only")


def scenario_of(world: World, run: int, noise_px: float, seed: int) -> Scenario:
    """The points of the tool are to meet their places at the goal, in both views, read with noise."""
    goals = world.arm.points(world.goal[run], world.local)
    noise = NoiseSpec("gaussian", sigma_px=noise_px)
    trackers, constraints = [], []
    for camera in VIEWS:
        for i, (point, goal) in enumerate(zip(world.local, goals, strict=True)):
            names = (f"tip{i}_{camera}", f"goal{i}_{camera}")
            places = (AttachSpec("tool", tuple(point.tolist())), AttachSpec("world", tuple(goal.tolist())))
            trackers += [
                TrackerSpec(name, camera, "projected", attach=place, noise=noise)
                for name, place in zip(names, places, strict=True)
            ]
            constraints.append(ConstraintSpec(f"meet {i} {camera}", "point_to_point", names))
    return Scenario(
        title="random", seed=seed,
        scene=SceneSpec(robot="wam7", q0_deg=tuple(np.rad2deg(world.q0[run]).tolist())),
        camera=tuple(CameraSpec(name, (1, 0, 0), (0, 0, 0), size=IMAGE) for name in VIEWS),
        tracker=tuple(trackers), constraint=tuple(constraints), servo=ServoConfig(),
    )  # fmt: skip
