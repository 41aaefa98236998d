"""The live rig: the simulated world in a process of its own, in real time."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import threading
import time
import weakref
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import MappingProxyType
from typing import Any

import numpy as np

from vita import errors
from vita.impedance.arm_model import ArmModel
from vita.impedance.view import Capsule
from vita.scenario.schema import Scenario
from vita.sim import live_child
from vita.sim.arm_hull import scene_hull
from vita.sim.obstacles import obstacle_capsules
from vita.sim.robots import load_robot
from vita.sim.shared_frames import SharedFrame, SharedFrames
from vita.sim.truth import GroundTruth
from vita.stereo.hull import ArmHull
from vita.types import Array, Joint, JointStep, Observation, Visual

START_S = 60.0
"""How long the simulation may take to start [s]."""
ANSWER_S = 2.0
"""How long it may take to answer a request [s]."""


class LiveRig:
    """A `SimulatedRig` that runs by itself at 30 frames a second.

    pybullet holds the interpreter's lock while it works, so it lives in a child process; pictures
    come over in shared memory. When the machine is too slow, simulated time runs slower than the
    clock on the wall. The child ends when this process does, however that happens.

    `stop_now` may be called from any thread; `observe` belongs to one.
    """

    def __init__(self, scenario: Scenario, *, seed: int | None = None) -> None:
        context = multiprocessing.get_context("spawn")
        self.cameras: tuple[str, ...] = tuple(spec.name for spec in scenario.camera)
        self._truth = GroundTruth(scenario.camera)
        self._objects = scenario.scene.objects
        self._scene = scenario.scene
        self._asking, self._commanding = threading.Lock(), threading.Lock()
        self._last = -1
        self._numbers: Mapping[str, float] = {}
        self._copy_ms = 0.0
        self._death = ""
        self._requests = 0
        self._news = context.Semaphore(0)
        self._shared = SharedFrames.of(scenario.camera)
        pipe = None
        try:
            self._pipe, pipe = context.Pipe()
            self._process = context.Process(
                target=live_child.main,
                args=(scenario, seed, self._shared.name, pipe, self._news),
                name="vita live rig",
                daemon=True,
            )
            self._process.start()
        except BaseException:
            self._shared.close()
            raise
        finally:
            if pipe is not None:
                # Only the child may hold its end, or the pipe would outlive the child.
                pipe.close()
        self._end = weakref.finalize(self, _end, self._process, self._pipe, self._shared)
        try:
            self.robot_joints, self._joints, self._visuals, poses = self._greeting()
        except BaseException:
            self.close()
            raise
        self._bodies = tuple(poses)
        self._model = load_robot(scenario.scene.robot)
        self._truth.update(poses)

    def _greeting(self) -> tuple:
        message = self._receive(START_S)
        if message[0] != "ready":
            raise errors.RigOffline(f"the simulation answered {message[0]!r} instead of starting")
        return message[1:]

    # ---- the rig ---------------------------------------------------------------------------------

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints with the limits in force."""
        return self._joints

    def observe(self, timeout: float = 1.0) -> Observation:
        """Wait for the next frame that is newer than the last one observed.

        Raises `RigLate` when none comes within `timeout` [s], `RigOffline` when the simulation has ended.
        """
        self._check_open()
        try:
            seen = self._await_frame(timeout)
        except (AttributeError, IndexError, OSError):
            self._check_open()  # Another thread has closed the rig meanwhile.
            raise
        self._numbers, self._last = seen.numbers, int(seen.numbers["number"])
        mask = int(seen.numbers["frozen_mask"])
        self._truth.update(seen.poses, [name for i, name in enumerate(self.cameras) if mask >> i & 1])
        frames, depths = MappingProxyType(dict(seen.frames)), MappingProxyType(dict(seen.depths))
        return Observation(seen.numbers["stamp"], self._last, seen.q, frames, depths)

    def _await_frame(self, timeout: float) -> SharedFrame:
        deadline = time.monotonic() + timeout
        shared = self._shared
        while True:
            self._check_alive()
            # Asked at every look: the child draws only a few pictures per request, and those may be
            # stale before a thread that was kept waiting gets to see them.
            shared.ask()
            began = time.perf_counter()
            # After a pause in which nobody looked, the ring still holds pictures from before it.
            if shared.newest > self._last and shared.fresh:
                seen = shared.read(len(self._joints), self._bodies)
                if seen is not None:
                    break
            rest = deadline - time.monotonic()
            if rest <= 0:
                raise errors.RigLate(f"no picture for {timeout:g} s")
            self._news.acquire(timeout=min(rest, 0.05))
        while self._news.acquire(block=False):
            pass  # What the semaphore still counts are pictures that this one has overtaken.
        self._copy_ms = 1e3 * (time.perf_counter() - began)
        return seen

    def command(self, step: JointStep | None) -> None:
        """Replace the motion that is asked for; None brakes. Never waits."""
        self._check_open()
        with self._commanding:
            self._shared.put_command(step, len(self._joints))

    def stop_now(self) -> None:
        """Brake at the next gate cycle and let nothing through until `release`; from any thread."""
        with contextlib.suppress(AttributeError):  # Closed: the arm is gone, and at rest with that.
            self._shared.stop()

    def release(self) -> None:
        """Let steps through again. Moves nothing by itself."""
        self._check_open()
        self._shared.release()

    def set_limits(self, joints: Sequence[Joint], acceleration: float | None = None) -> None:
        """Put limits in force from the next cycle on; never wider than the robot's own."""
        self._joints = self._request("set_limits", tuple(joints), acceleration)

    def gate_state(self) -> dict[str, Any]:
        """At the last observation: `stopped`, `fault`, `dropped`, `saturated` (joint indices), `at_rest`."""
        numbers = self._numbers
        if not numbers or numbers["fault"]:  # The sentence of a fault is only in the other process.
            return self._request("gate_state")
        return {
            "stopped": bool(numbers["stopped"]),
            "fault": "",
            "dropped": int(numbers["dropped"]),
            "saturated": [i for i in range(len(self._joints)) if int(numbers["saturated_mask"]) >> i & 1],
            "at_rest": bool(numbers["at_rest"]),
        }

    def timings(self) -> dict[str, float]:
        """`physics`, `render` and `hand_over` of the last observation [ms], and `real_time_factor`."""
        numbers = self._numbers
        if not numbers:
            return {"physics": 0.0, "render": 0.0, "hand_over": 0.0, "real_time_factor": 1.0}
        names = ("physics", "render", "hand_over", "real_time_factor")
        return {name: numbers[name] + (self._copy_ms if name == "hand_over" else 0.0) for name in names}

    # ---- what a simulation adds --------------------------------------------------------------------

    def poses_at(self, q: Array) -> Mapping[str, Array]:
        """Where the robot's links would be at joints `q` (n,) [rad]."""
        return self._model.poses(q)

    def poses(self) -> Mapping[str, Array]:
        """Ground truth at the last observation: body name to (4, 4) T_world_body."""
        return self._truth.poses

    def arm_model(self) -> ArmModel:
        """The arm's kinematics as its drawing gives them."""
        return self._model.arm_model()

    def arm_hull(self) -> ArmHull:
        """What arm, tool and what they carry take up, as their drawings give it; takes a moment."""
        return scene_hull(self._model, self._scene)

    def obstacles(self) -> Sequence[Capsule]:
        """People and obstacles at the last observation as thick segments."""
        return obstacle_capsules(self._objects, self._truth.poses)

    def visuals(self) -> Sequence[Visual]:
        """The meshes of the scene."""
        return self._visuals

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
        """Carry out a script action; see `vita.sim.actions`. The next observation shows its effect."""
        self._request("perform", action, arguments)

    def hard_reset(self, q: np.ndarray) -> None:
        """The arm at q (n,) [rad] at rest, objects and cameras as in the scenario."""
        self._request("hard_reset", np.asarray(q, dtype=float))

    def close(self) -> None:
        """End the child and free the memory; harmless when done twice."""
        self._end()

    def __enter__(self) -> LiveRig:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ---- talking to the child ----------------------------------------------------------------------

    def _request(self, what: str, *arguments: object) -> Any:
        self._check_open()
        with self._asking:
            self._requests += 1
            try:
                self._pipe.send((self._requests, what, arguments))
            except OSError as error:
                raise self._offline() from error
            # An answer to an earlier request, given up on, may still be in the pipe.
            while (message := self._receive(ANSWER_S))[1] != self._requests:
                pass
        if message[0] == "refused":
            raise getattr(errors, message[2], errors.BadInput)(message[3])
        # Frames drawn before the request was carried out are no answer to it.
        self._last = max(self._last, message[3])
        return message[2]

    def _receive(self, timeout: float) -> tuple:
        """The next message of the child; what went wrong there is raised here."""
        ready = multiprocessing.connection.wait([self._pipe, self._process.sentinel], timeout)
        if not ready:
            raise errors.RigOffline(f"the simulation has not answered for {timeout:g} s; restart it")
        message: tuple = ("gone",)
        try:
            if self._pipe.poll():
                message = self._pipe.recv()
        except (EOFError, OSError):
            pass  # Nothing more will come out of this pipe.
        if message[0] == "died":
            self._death = message[2]
            kind = getattr(errors, message[1], None)
            if kind in (errors.BadInput, errors.MissingDependency) and not self._last >= 0:
                raise kind(message[2])
        if message[0] in ("died", "gone"):
            raise self._offline()
        return message

    def _check_open(self) -> None:
        if not self._end.alive:
            raise errors.RigOffline("this rig has been closed")

    def _check_alive(self) -> None:
        if self._process.is_alive():
            return
        if not self._death and self._asking.acquire(blocking=False):
            try:
                self._receive(0.0)  # Its last words, if it had time for any; raises.
            finally:
                self._asking.release()
        raise self._offline()

    def _offline(self) -> errors.RigOffline:
        self._process.join(0.5)
        code = self._process.exitcode
        ending = "" if code is None else f" (exit code {code})"
        words = f":\n{self._death}" if self._death else ""
        return errors.RigOffline(f"the simulation has ended{ending}; restart it{words}")


def _end(process: BaseProcess, pipe: Connection, shared: SharedFrames) -> None:
    """Ask the child to go, then make it; runs once, at the latest when the interpreter ends."""
    try:
        pipe.send((0, "close", ()))
    except OSError:
        pass
    process.join(1.0)
    if process.is_alive():
        process.kill()
        process.join(1.0)
    pipe.close()
    shared.close()
