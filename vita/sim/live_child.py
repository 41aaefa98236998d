"""The process behind the live rig: a world in real time, alone with pybullet and OpenGL."""

from __future__ import annotations

import signal
import time
import traceback
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Semaphore

from vita.errors import BadInput, VitaError
from vita.scenario.schema import Scenario
from vita.sim.shared_frames import SharedFrames

PERIOD_S = 1 / 30
LOOKERS_STAY = 2
"""Frames drawn after the last one that was asked for, so that drawing and tracking overlap."""
STALL_S = 0.3
"""A process that was suspended for longer than this forgets its command [s]."""


def main(
    scenario: Scenario, seed: int | None, memory: str, pipe: Connection, news: Semaphore
) -> None:
    """Run until the parent says so or is gone. Answers go through `pipe`, frames through `memory`."""
    # Both reach the whole group of processes; the parent brakes first and then ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    shared = None
    try:
        from vita.sim.world import World

        shared = SharedFrames.of(scenario.camera, memory)
        child = LiveChild(World(scenario, seed), shared, pipe, news)
        child.greet()
        child.run()
        child.world.close()
    except (EOFError, BrokenPipeError, KeyboardInterrupt):
        pass  # The parent has gone; nobody is left to be told.
    except BaseException as error:
        text = str(error) if isinstance(error, VitaError) else traceback.format_exc()
        try:
            pipe.send(("died", error_kind(error), text))
        except OSError:
            pass
        raise SystemExit(1) from None
    finally:
        if shared is not None:
            shared.close()


def error_kind(error: BaseException) -> str:
    """The kind as the parent knows it: a class name from `vita.errors`, or `Exception`."""
    if isinstance(error, BadInput):
        return "BadInput"
    return type(error).__name__ if isinstance(error, VitaError) else "Exception"


class LiveChild:
    """The loop: serve requests, let 1/30 s pass, draw, hand over, sleep until it is time again."""

    def __init__(self, world, shared: SharedFrames, pipe: Connection, news: Semaphore) -> None:
        self.world, self._shared, self._pipe, self._news = world, shared, pipe, news
        self._stops, self._releases = 0, 0
        self._number = 0
        self._hand_over_ms = 0.0
        self._factor = 1.0
        self._asked, self._stay = 0, 0

    def greet(self) -> None:
        """Tell the parent what there is. The first picture takes long, so it is drawn before."""
        world = self.world
        world.frames()
        self._pipe.send(("ready", world.model.joints, world.joints, world.visuals, world.poses()))

    def run(self) -> None:
        """Returns when the parent asks for it."""
        due = last = time.perf_counter()
        while self._serve_until(due):
            now = time.perf_counter()
            if now - last > STALL_S:
                self.world.command(None)
            # Late is late: simulated time then runs slower, and no burst makes up for it.
            due = max(due + PERIOD_S, now)
            self._factor += 0.1 * (PERIOD_S / max(now - last, PERIOD_S) - self._factor)
            last = now
            self._number += 1
            self._shared.tick(self._number)
            self.world.advance(PERIOD_S, self._before_cycle)
            if self._wanted():
                self._publish()

    def _before_cycle(self) -> None:
        """The stop flag first, then a new command if there is one."""
        shared, gate = self._shared, self.world.gate
        if shared.stops != self._stops:
            self._stops = shared.stops
            gate.stop()
        elif not shared.held and (gate.stopped or shared.releases != self._releases):
            self._releases = shared.releases
            gate.release()
        new, step = shared.take_command(self.world.model.n)
        if new:
            self.world.command(step)

    def _wanted(self) -> bool:
        """Pictures are only drawn while somebody looks: an idle page costs next to nothing."""
        if self._shared.asked != self._asked:
            self._asked, self._stay = self._shared.asked, LOOKERS_STAY
        else:
            self._stay -= 1
        return self._stay > 0

    def _publish(self) -> None:
        world, state = self.world, self.world.gate_state()
        poses = world.poses()
        frames, depths = world.frames(poses), world.depths(poses)
        began = time.perf_counter()
        numbers = {
            "stamp": world.time,
            "number": self._number,
            "frozen_mask": sum(1 << i for i, name in enumerate(world.views) if name in world.frozen_views()),
            "stopped": state["stopped"],
            "fault": bool(state["fault"]),
            "dropped": state["dropped"],
            "saturated_mask": sum(1 << joint for joint in state["saturated"]),
            "at_rest": state["at_rest"],
            "hand_over": self._hand_over_ms,
            "real_time_factor": self._factor,
            **world.milliseconds,
        }
        self._shared.publish(numbers, world.q(), poses, frames, depths)
        self._news.release()
        self._hand_over_ms = 1e3 * (time.perf_counter() - began)

    def _serve_until(self, due: float) -> bool:
        """Answer requests until it is time for the next frame; False when the parent wants the end."""
        while True:
            rest = due - time.perf_counter()
            if not self._pipe.poll(max(rest, 0.0)):
                return True
            number, request, arguments = self._pipe.recv()
            if request == "close":
                return False
            try:
                answer = getattr(self, "_do_" + request)(*arguments)
            except VitaError as error:
                self._pipe.send(("refused", number, error_kind(error), str(error)))
            else:
                self._pipe.send(("done", number, answer, self._number))

    def _do_set_limits(self, joints, acceleration):
        self.world.set_limits(joints, acceleration)
        return self.world.joints

    def _do_perform(self, action, arguments):
        self.world.perform(action, arguments)

    def _do_hard_reset(self, q):
        self.world.hard_reset(q)

    def _do_gate_state(self):
        return self.world.gate_state()

    def _do_raise(self, text):
        """For tests of what the parent makes of a crash."""
        raise RuntimeError(text)
