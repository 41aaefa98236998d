"""The simulated world: an arm behind its gate, objects, cameras, and its own clock.

A world belongs to the thread that made it (pybullet and OpenGL both want that). It knows no wall
clock and no randomness but the seed: the same commands give the same joints and pictures to the bit.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from vita.errors import BadInput, RigOffline
from vita.scenario.schema import Scenario
from vita.servo.gate import Gate
from vita.sim.actions import carry_out
from vita.sim.arm import Arm
from vita.sim.bullet import pybullet as p
from vita.sim.camera_view import CameraView
from vita.sim.depth_sensor import Depth
from vita.sim.environment import build_environment
from vita.sim.joint_limits import limits_in_force, within
from vita.sim.mishaps import Mishaps
from vita.sim.objects import build_object
from vita.sim.props import Props
from vita.sim.proximity import EVERY_CYCLES, proximity_of
from vita.sim.render import make_renderer
from vita.sim.robots import load_robot
from vita.sim.tools import build_tool
from vita.types import Array, Image, Joint, JointStep, Visual, frozen

GATE_HZ = 240
FRAME_HZ = 30


class World:
    """Everything that a scenario's `[scene]`, cameras and limits describe, in one pybullet client."""

    def __init__(self, scenario: Scenario, seed: int | None = None) -> None:
        scene = scenario.scene
        seed = scenario.seed if seed is None else seed
        self.model = load_robot(scene.robot)
        self._dead_band_rad = float(np.radians(scene.dead_band_deg))
        self._client, self.arm = self._open()
        self._props = Props(scene.objects)
        self.visuals: tuple[Visual, ...] = (
            *self.model.visuals(),
            *build_tool(scene.tool),
            *(visual for spec in scene.objects for visual in build_object(spec.kind, spec.name)),
            *build_environment(scene.table),
        )
        self._renderer = make_renderer(self.visuals)
        self.views = {
            spec.name: CameraView(spec, scene.image_noise, seed, scene.depth_noise_mm)
            for spec in scenario.camera
        }
        limits = limits_in_force(self.model.joints, scenario.limits)
        self._proximity = proximity_of(self.model, scenario)
        self.gate = Gate(
            limits, scenario.limits.acceleration_rad_s2, dt=1 / GATE_HZ, guarded=self._proximity is not None
        )
        self._cycles = 0
        self.mishaps = Mishaps()
        self.rebuilt = 0
        """How often the physics had to be built anew because its joint states were not numbers."""
        self.corrupt = False
        """Whether that has happened since the last `release`; the gate is stopped while it is so."""
        self.milliseconds = {"physics": 0.0, "render": 0.0}
        """What the last `advance` and the last `frames` cost."""
        q0 = self.model.q_ready if scene.q0_deg is None else np.radians(scene.q0_deg)
        self.hard_reset(q0)

    def _open(self) -> tuple[int, Arm]:
        """A pybullet client and the arm in it."""
        client = p.connect(p.DIRECT)
        if client < 0:
            raise RigOffline("pybullet could not open a simulation")
        # No gravity: the WAM's own controller compensates it, and the motors need not.
        p.setTimeStep(1 / GATE_HZ, physicsClientId=client)
        try:
            return client, Arm(client, self.model, self._dead_band_rad)
        except BaseException:
            p.disconnect(physicsClientId=client)
            raise

    @property
    def time(self) -> float:
        """Simulated time [s]; counted in whole cycles, so that it never drifts."""
        return self._cycles / GATE_HZ

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints with the limits in force."""
        return self.gate.joints

    def q(self) -> Array:
        """(n,) measured joint positions [rad], read-only."""
        return frozen(self.arm.q())

    def command(self, step: JointStep | None) -> None:
        """Hand a step to the gate; the robot's dead band swallows motions that are too small."""
        if step is not None and self.arm.dead_band_rad > 0:
            dq, q_from = np.asarray(step.dq), np.asarray(step.q_from)
            if dq.shape == q_from.shape == (self.model.n,):  # The gate deals with all others.
                step = replace(step, dq=self.arm.apply_dead_band(q_from, q_from + dq) - q_from)
        self.gate.command(step, self.time)

    def advance(
        self,
        duration: float = 1 / FRAME_HZ,
        each_cycle: Callable[[], None] | None = None,
        asleep: bool = False,
    ) -> None:
        """Let simulated time pass: gate, motors and physics at 240 Hz.

        each_cycle: called before each cycle, e.g. to look at a stop flag.
        asleep: while the arm rests, only the last cycle is worked out; nothing pulls at it without gravity.
        """
        began = time.perf_counter()
        cycles = round(duration * GATE_HZ)
        if asleep and self.gate.at_rest and cycles > 1:
            self._cycles, cycles = self._cycles + cycles - 1, 1
        try:
            q = self._sound()
            for _ in range(cycles):
                if each_cycle is not None:
                    each_cycle()
                if self._proximity is not None and (
                    self._cycles % EVERY_CYCLES == 0 or self.gate.blind(self.time)
                ):
                    poses = {"world": np.eye(4), **self._props.standing(self.time)}
                    self.gate.keep_off(self._proximity.look(q, poses, self.time))
                q_set, v_set = self.gate.cycle(self.time, q)
                self.arm.drive(q_set, v_set)
                self.mishaps.befall(self.arm)
                p.stepSimulation(physicsClientId=self._client)
                self._cycles += 1
                q = self._sound()
        except p.error as reason:
            raise RigOffline(f"the simulation ended ({reason}); restart it") from reason
        self.milliseconds["physics"] = 1e3 * (time.perf_counter() - began)

    def _sound(self) -> Array:
        """(n,) measured joint positions [rad], which are numbers whatever has become of the physics."""
        q = self.arm.q()
        if not np.isfinite(q).all():
            self._rebuild()
            q = self.arm.q()
        self._sound_q = q
        return q

    def _rebuild(self) -> None:
        """New physics with the arm at rest where it last was; once poisoned, pybullet does not recover.
        Objects, cameras, time and limits are not in there, and stay. The gate is stopped until `release`."""
        p.disconnect(physicsClientId=self._client)
        self._client = -1
        self._client, self.arm = self._open()
        self.arm.reset(self._sound_q)
        self.gate.reset(self._sound_q, self.time)
        self.gate.stop()
        self.rebuilt += 1
        self.corrupt = True

    def release(self) -> None:
        """Let steps through again. Moves nothing by itself."""
        self.gate.release()
        self.corrupt = False

    def poses(self) -> dict[str, Array]:
        """Body name to (4, 4) T_world_body; cameras as `camera:NAME`."""
        poses = self._bodies()
        return poses | {f"camera:{name}": view.pose(poses) for name, view in self.views.items()}

    def poses_at(self, q: Array) -> dict[str, Array]:
        """Body name to (4, 4) T_world_body were the joints at q (n,) [rad]; without the cameras."""
        links = self.model.poses(q)
        return {"world": np.eye(4), **links, **self._props.poses(links, self.time)}

    def _bodies(self) -> dict[str, Array]:
        return self.poses_at(self.arm.q())

    def frames(
        self, poses: Mapping[str, Array] | None = None, each_view: Callable[[], None] | None = None
    ) -> dict[str, Image]:
        """Camera name to (height, width, 3) RGB picture of this moment; `poses` if they are at hand.

        each_view: called before each picture, as a sign of life.
        """
        began = time.perf_counter()
        poses = self._bodies() if poses is None else poses
        frames = {}
        for name, view in self.views.items():
            if each_view is not None:
                each_view()
            frames[name] = view.frame(self._renderer, poses, self.time)
        self.milliseconds["render"] = 1e3 * (time.perf_counter() - began)
        return frames

    def depths(self, poses: Mapping[str, Array] | None = None) -> dict[str, Depth]:
        """Name of each camera that measures depth to its distances; see `Observation.depths`. To be asked
        after `frames` of the same moment."""
        if not any(view.spec.depth for view in self.views.values()):
            return {}
        began = time.perf_counter()
        poses = self._bodies() if poses is None else poses
        found = {name: view.depth(self._renderer, poses, self.time) for name, view in self.views.items()}
        self.milliseconds["render"] += 1e3 * (time.perf_counter() - began)
        return {name: depth for name, depth in found.items() if depth is not None}

    def gate_state(self) -> dict[str, object]:
        """What the gate has to say; `saturated` lists joint indices."""
        gate = self.gate
        return {
            "stopped": gate.stopped,
            "fault": gate.fault,
            "kind": gate.kind,
            "held_off": gate.held_off,
            "bad": gate.bad,
            "outside": np.flatnonzero(gate.outside).tolist(),
            "dropped": gate.dropped,
            "saturated": np.flatnonzero(gate.saturated).tolist(),
            "at_rest": gate.at_rest,
            "corrupt": self.corrupt or gate.corrupt,
            "rebuilt": self.rebuilt,
        }

    def frozen_views(self) -> list[str]:
        """Cameras whose feed repeats itself."""
        return [name for name, view in self.views.items() if self.time < view.frozen_until]

    def set_limits(self, joints: Sequence[Joint], acceleration: float | None = None) -> None:
        """Put limits in force; they are cut to the robot's own where they are wider."""
        self.gate.set_limits(within(joints, self.model.joints), acceleration)

    def perform(self, action: str, arguments: Mapping[str, object]) -> None:
        """Carry out a script action; see `vita.sim.actions`."""
        carry_out(self, action, arguments)

    def push(self, dq: Array) -> None:
        """Displace the arm by dq (n,) [rad] at once, as far as the limits in force allow."""
        lower = np.array([joint.lower for joint in self.joints])
        upper = np.array([joint.upper for joint in self.joints])
        q = self.arm.q()
        pushed = np.clip(q + dq, np.minimum(lower, q), np.maximum(upper, q))
        self.arm.reset(pushed)
        self.gate.reset(pushed, self.time)

    def move_prop(self, name: str, xyz: tuple | None, rpy_deg: tuple | None, over_s: float) -> None:
        """Start to move an object to a new placement."""
        self._props.move(name, xyz, rpy_deg, over_s, self.time)

    def carry_prop(self, name: str, **way: float | str) -> None:
        """Start to carry an object on and on; see `vita.sim.motions`."""
        self._props.carry(name, self.time, **way)

    def hard_reset(self, q: Array) -> None:
        """The arm at q (n,) [rad] at rest, objects and cameras as in the scenario; time goes on."""
        q = np.asarray(q, dtype=float)
        if q.shape != (self.model.n,) or not np.isfinite(q).all():
            raise BadInput(f"{self.model.name} needs {self.model.n} finite joint positions, got {q.tolist()}")
        self.arm.reset(q)
        self.gate.reset(q, self.time)
        self._props.restore()
        for view in self.views.values():
            view.restore()

    def close(self) -> None:
        """Free pybullet and OpenGL; harmless when done twice."""
        if self._client >= 0:
            self._renderer.close()
            p.disconnect(physicsClientId=self._client)
            self._client = -1
