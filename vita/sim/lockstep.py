"""The simulated rig without a clock: time passes only when somebody observes."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from vita.errors import RigOffline
from vita.scenario.schema import Scenario
from vita.sim.rig_base import SceneRig
from vita.sim.world import World
from vita.types import Joint, JointStep, Observation


class LockstepRig(SceneRig):
    """A `SimulatedRig` in this process, for scripts and tests: as fast as the machine allows.

    It belongs to the thread that made it. The first `observe` shows the scene at time 0, each
    further one lets a frame period (1/30 s) pass. Two rigs with the same scenario, seed and commands
    agree to the bit.
    """

    def __init__(self, scenario: Scenario, seed: int | None = None) -> None:
        super().__init__(scenario)
        self._world = World(scenario, seed)
        self._model, self._visuals = self._world.model, self._world.visuals
        self._truth.update(self._world.poses())
        self._number = -1
        self._closed = False

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
        self._world.release()

    def gate_state(self) -> dict[str, object]:
        """What the gate has to say: `stopped`, `fault`, `dropped`, `saturated` (joint indices), `at_rest`."""
        return self._world.gate_state()

    def set_limits(self, joints: Sequence[Joint], acceleration: float | None = None) -> None:
        """Put limits in force from the next cycle on; never wider than the robot's own."""
        self._world.set_limits(joints, acceleration)

    def perform(self, action: str, **arguments: object) -> None:
        """Carry out a script action; see `vita.sim.actions`."""
        self._world.perform(action, arguments)

    def hard_reset(self, q: np.ndarray) -> None:
        """The arm at q (n,) [rad] at rest, objects and cameras as in the scenario."""
        self._world.hard_reset(q)

    def break_in(self, kind: str, value: float = 0.0) -> None:
        """Make a fault inside the simulation; see `vita.sim.mishaps`."""
        self._world.mishaps.make(kind, value)

    def timings(self) -> dict[str, float]:
        """Milliseconds of the last `physics` and `render`."""
        return dict(self._world.milliseconds)

    def close(self) -> None:
        """Free the simulation; harmless when done twice."""
        self._closed = True
        self._world.close()
