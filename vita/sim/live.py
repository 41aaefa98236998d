"""The live rig: the simulated world in a process of its own, in real time."""

from __future__ import annotations

import contextlib
import json
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
from vita.scenario.schema import Scenario
from vita.sim import live_child
from vita.sim.rig_base import SceneRig
from vita.sim.robots import load_robot
from vita.sim.shared_frames import CAUSES, SharedFrame, SharedFrames
from vita.types import Joint, JointStep, Observation

START_S = 60.0
"""How long the simulation may take to start [s]."""
ANSWER_S = 2.0
"""How long it may take to answer a request [s]."""
LOOK_S = 0.1
"""So much of the time between two looks for a picture counts as waiting for it [s]."""
SILENT_S = 0.25
"""How long it may give no sign of life (it gives one in every cycle and before every picture) [s]."""


class LiveRig(SceneRig):
    """A `SimulatedRig` that runs by itself at 30 frames a second.

    pybullet holds the interpreter's lock while it works, so it lives in a child process; pictures
    come over in shared memory. When the machine is too slow, simulated time runs slower than the
    clock on the wall. The child ends when this process does, however that happens.

    `stop_now` may be called from any thread; `observe` belongs to one.
    """

    def __init__(self, scenario: Scenario, *, seed: int | None = None) -> None:
        context = multiprocessing.get_context("spawn")
        super().__init__(scenario)
        self._asking, self._commanding = threading.Lock(), threading.Lock()
        self._last = -1
        self._numbers: Mapping[str, float] = {}
        self._gate: dict[str, Any] = {}
        self._heard: dict[str, int] = {cause: 0 for cause in CAUSES}
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

        Raises `RigLate` when none comes within `timeout` [s] or the simulation gives no sign of life for
        `SILENT_S`, `RigOffline` when it has ended.
        """
        self._check_open()
        try:
            seen = self._await_frame(timeout)
        except (AttributeError, IndexError, OSError):
            self._check_open()  # Another thread has closed the rig meanwhile.
            raise
        self._numbers, self._last = seen.numbers, int(seen.numbers["number"])
        self._gate, self._heard["corrupt"] = json.loads(seen.words), int(seen.numbers["rebuilt"])
        mask = int(seen.numbers["frozen_mask"])
        self._truth.update(seen.poses, [name for i, name in enumerate(self.cameras) if mask >> i & 1])
        frames, depths = MappingProxyType(dict(seen.frames)), MappingProxyType(dict(seen.depths))
        return Observation(seen.numbers["stamp"], self._last, seen.q, frames, depths)

    def _await_frame(self, timeout: float) -> SharedFrame:
        looked, waited, beaten = time.monotonic(), 0.0, 0.0
        shared, beats = self._shared, -1
        patience = max(SILENT_S, 4e-3 * self._numbers.get("render", 0.0))
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
            now = time.monotonic()
            # A look that comes late was kept waiting itself: a process that was frozen blames nobody else.
            waited, looked = waited + min(now - looked, LOOK_S), now
            if beats != (beats := shared.beats):
                beaten = waited
            if waited - beaten > patience:
                raise errors.RigLate(f"the simulation gave no sign of life for {patience:.2g} s")
            if waited > timeout:
                raise errors.RigLate(f"no picture for {timeout:g} s")
            self._news.acquire(timeout=max(min(timeout - waited, 0.05), 0.001))
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
        """Let steps through again. Moves nothing by itself. A stop from outside that nobody has asked for yet
        (`outside_stop`) stays in force."""
        self._check_open()
        self._shared.lift(self._heard)
        self._shared.release()

    def outside_stop(self) -> str:
        """Whether the arm was stopped past this process since this was last asked: empty, or the gravest of
        `silent` (this process stood still), `stop` and `emergency` (signals SIGUSR1 and SIGUSR2)."""
        try:
            latched = self._shared.latched()
        except AttributeError:  # Closed.
            return ""
        new = [cause for cause in ("emergency", "stop", "silent") if latched[cause] != self._heard[cause]]
        self._heard |= {cause: latched[cause] for cause in new}
        return new[0] if new else ""

    @property
    def pid(self) -> int | None:
        """The process of the simulation."""
        return self._process.pid

    @property
    def memory(self) -> str:
        """Name of the memory that both processes share."""
        return self._shared.name

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second on the wall; below 1 where the machine is too slow."""
        return float(self._numbers.get("real_time_factor", 1.0))

    def set_limits(self, joints: Sequence[Joint], acceleration: float | None = None) -> None:
        """Put limits in force from the next cycle on; never wider than the robot's own."""
        self._joints = self._request("set_limits", tuple(joints), acceleration)

    def gate_state(self) -> dict[str, Any]:
        """At the last observation: `stopped`, `fault`, `dropped`, `saturated` (joint indices), `at_rest`, and
        whether the simulation is `corrupt` and how often it was `rebuilt`."""
        self._check_open()
        if not self._numbers:
            return self._request("gate_state")
        if self._numbers["released"] < self._shared.releases:
            # Said before the last release took effect, and so no longer true.
            return self._gate | {"stopped": False, "fault": "", "corrupt": False}
        return dict(self._gate)

    def timings(self) -> dict[str, float]:
        """`physics`, `render` and `hand_over` of the last observation [ms], and `real_time_factor`."""
        numbers = self._numbers
        if not numbers:
            return {"physics": 0.0, "render": 0.0, "hand_over": 0.0, "real_time_factor": 1.0}
        names = ("physics", "render", "hand_over", "real_time_factor")
        return {name: numbers[name] + (self._copy_ms if name == "hand_over" else 0.0) for name in names}

    # ---- what a simulation adds --------------------------------------------------------------------

    def perform(self, action: str, **arguments: object) -> None:
        """Carry out a script action; see `vita.sim.actions`. The next observation shows its effect."""
        self._request("perform", action, arguments)

    def break_in(self, kind: str, value: float = 0.0) -> None:
        """Make a fault inside the simulation; see `vita.sim.mishaps`."""
        self._request("break_in", kind, value)

    def hard_reset(self, q: np.ndarray) -> None:
        """The arm at q (n,) [rad] at rest, objects and cameras as in the scenario."""
        self._request("hard_reset", np.asarray(q, dtype=float))

    def close(self) -> None:
        """End the child and free the memory; harmless when done twice."""
        self._end()

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
        alive = self._process.is_alive()
        if not self._death and self._asking.acquire(blocking=False):
            try:
                # Nobody waits for an answer: what comes now is its last words, for which it takes longer to
                # end than to say them, or an answer that came too late.
                if not alive or self._pipe.poll():
                    self._receive(0.0)
            finally:
                self._asking.release()
        if not alive or self._death:
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
