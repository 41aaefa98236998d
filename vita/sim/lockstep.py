"""The simulated rig without a clock: time passes only when somebody observes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from vita.errors import RigOffline
from vita.impedance.arm_model import ArmModel
from vita.impedance.view import Capsule
from vita.scenario.schema import Scenario
from vita.sim.arm_hull import scene_hull
from vita.sim.obstacles import obstacle_capsules
from vita.sim.truth import GroundTruth
from vita.sim.world import World
from vita.stereo.hull import ArmHull
from vita.types import Array, Joint, JointStep, Observation, Visual


class LockstepRig:
    """A `SimulatedRig` in this process, for scripts and tests: as fast as the machine allows.

    It belongs to the thread that made it. The first `observe` shows the scene at time 0, each
    further one lets a frame period (1/30 s) pass. Two rigs with the same scenario, seed and commands
    agree to the bit.
    """

    def __init__(self, scenario: Scenario, seed: int | None = None) -> None:
        self._world = World(scenario, seed)
        self._truth = GroundTruth(scenario.camera)
        self._objects = scenario.scene.objects
        self._scene = scenario.scene
        self._truth.update(self._world.poses())
        self._number = -1
        self._closed = False
        self.cameras: tuple[str, ...] = tuple(spec.name for spec in scenario.camera)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints with the limits in force."""
        return self._world.joints

    @property
    def robot_joints(self) -> tuple[Joint, ...]:
        """The joints with the robot's own limits, which nothing can widen."""
        return self._world.model.joints

    def observe(self) -> Observation:
        """The scene one frame period later. Raises `RigOffline` once the rig is closed."""
        if self._closed:
            raise RigOffline("the simulation is closed")
        world = self._world
        if self._number >= 0:
            world.advance()
        self._number += 1
        poses = world.poses()
        frames, depths = world.frames(poses), world.depths(poses)
        self._truth.update(poses, world.frozen_views())
        return Observation(
            world.time, self._number, world.q(), MappingProxyType(frames), MappingProxyType(depths)
        )

    def command(self, step: JointStep | None) -> None:
        """Ask for a motion during the next frame periods; None brakes."""
        self._world.command(step)

    def stop_now(self) -> None:
        """Brake, and let no step through until `release`."""
        self._world.gate.stop()

    def release(self) -> None:
        """Let steps through again. Moves nothing by itself."""
        self._world.gate.release()

    def gate_state(self) -> dict[str, object]:
        """What the gate has to say: `stopped`, `fault`, `dropped`, `saturated` (joint indices), `at_rest`."""
        return self._world.gate_state()

    def set_limits(self, joints: Sequence[Joint], acceleration: float | None = None) -> None:
        """Put limits in force from the next cycle on; never wider than the robot's own."""
        self._world.set_limits(joints, acceleration)

    def poses_at(self, q: Array) -> Mapping[str, Array]:
        """Where the robot's links would be at joints `q` (n,) [rad]."""
        return self._world.model.poses(q)

    def poses(self) -> Mapping[str, Array]:
        """Ground truth at the last observation: body name to (4, 4) T_world_body."""
        return self._truth.poses

    def arm_model(self) -> ArmModel:
        """The arm's kinematics as its drawing gives them."""
        return self._world.model.arm_model()

    def arm_hull(self) -> ArmHull:
        """What arm, tool and what they carry take up, as their drawings give it; takes a moment."""
        return scene_hull(self._world.model, self._scene)

    def obstacles(self) -> Sequence[Capsule]:
        """People and obstacles at the last observation as thick segments."""
        return obstacle_capsules(self._objects, self._truth.poses)

    def visuals(self) -> Sequence[Visual]:
        """The meshes of the scene."""
        return self._world.visuals

    def project(self, camera: str, body: str, point: Sequence[float]) -> Array:
        """(2,) pixel at which a point of `body` was seen at the last observation [px]."""
        return self._truth.project(camera, body, point)

    def distance(self, camera: str, body: str, point: Sequence[float]) -> float:
        """Distance of a point of `body` from a camera at the last observation [m]."""
        return self._truth.distance(camera, body, point)

    def locate(self, body: str, point: Sequence[float]) -> Array:
        """(3,) where a point of `body` was at the last observation [m]."""
        return self._truth.locate(body, point)

    def perform(self, action: str, **arguments: object) -> None:
        """Carry out a script action; see `vita.sim.actions`."""
        self._world.perform(action, arguments)

    def hard_reset(self, q: np.ndarray) -> None:
        """The arm at q (n,) [rad] at rest, objects and cameras as in the scenario."""
        self._world.hard_reset(q)

    def timings(self) -> dict[str, float]:
        """Milliseconds of the last `physics` and `render`."""
        return dict(self._world.milliseconds)

    def close(self) -> None:
        """Free the simulation; harmless when done twice."""
        self._closed = True
        self._world.close()

    def __enter__(self) -> LockstepRig:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
