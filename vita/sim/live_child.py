"""The process behind the live rig: a world in real time, alone with pybullet and OpenGL."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import time
import traceback
from collections.abc import Mapping
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Semaphore
from types import FrameType

from vita.errors import BadInput, MissingDependency, VitaError
from vita.scenario.schema import Scenario
from vita.sim.shared_frames import SharedFrames

PERIOD_S = 1 / 30
LOOKERS_STAY = 2
"""Frames drawn after the last one that was asked for, so that drawing and tracking overlap."""
STALL_S = 0.3
"""A process that was suspended for longer than this forgets its command [s]."""
PAUSE_S = 0.1
"""A cycle takes no longer unless the process was suspended; nothing is drawn between two of a period [s]."""
SILENT_PARENT_S = 1.0
"""An app that moves the arm looks at it many times a second; after so long it is taken for frozen [s]."""
LOOK_S = 0.004
"""How often it looks for a Stop between two periods while the arm moves [s]."""
ASLEEP_S, ASLEEP_AFTER_S = 0.1, 0.2
"""Period of a simulation that nobody looks at while the arm rests, and how long after the last look [s]."""
NUDGE_RAD = 1e-3
REST_FRAMES = 15
"""Frame periods that braking may take at the end."""
LONGEST = 600
"""Characters of a sentence that the gate says."""


def main(
    scenario: Scenario, seed: int | None, memory: str, pipe: Connection, news: Semaphore
) -> None:
    """Run until the parent says so or is gone. Answers go through `pipe`, frames through `memory`."""
    # Both reach the whole group of processes; the parent brakes first and then ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    shared, code = None, 0

    def told(number: int, frame: FrameType | None) -> None:
        if shared is not None:
            shared.latch("stop" if number == signal.SIGUSR1 else "emergency")

    # A way to stop the arm that leads past the app, however jammed that is.
    for name in ("SIGUSR1", "SIGUSR2"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), told)
    try:
        from vita.sim.world import World

        shared = SharedFrames.of(scenario.camera, memory)
        child = LiveChild(World(scenario, seed), shared, pipe, news)
        child.greet()
        try:
            child.run()
        finally:
            child.come_to_rest()
        child.world.close()
    except (EOFError, BrokenPipeError, KeyboardInterrupt):
        pass  # The parent has gone; nobody is left to be told.
    except BaseException as error:
        if isinstance(error, ModuleNotFoundError) and not (error.name or "").startswith("vita"):
            error = MissingDependency(f"the package {error.name!r} is missing; install vita once more")
        text = str(error) if isinstance(error, VitaError) else traceback.format_exc()
        code = 1
        try:
            pipe.send(("died", error_kind(error), text))
        except OSError:
            pass
    finally:
        if shared is not None:
            shared.close()
    # Nothing is left to tidy up, and python takes longer over that than an arm over braking.
    os._exit(code)


def error_kind(error: BaseException) -> str:
    """The kind as the parent knows it: a class name from `vita.errors`, or `Exception`."""
    if isinstance(error, BadInput):
        return "BadInput"
    return type(error).__name__ if isinstance(error, VitaError) else "Exception"


def as_words(state: Mapping[str, object]) -> str:
    """What the gate says, as JSON; sentences are cut so that it always fits."""
    return json.dumps({k: v[:LONGEST] if isinstance(v, str) else v for k, v in state.items()}, default=float)


class _Interrupted(Exception):
    """The pictures of this period are given up, because the arm is to brake."""


class LiveChild:
    """The loop: serve requests, let 1/30 s pass, draw, hand over, sleep until it is time again."""

    def __init__(self, world, shared: SharedFrames, pipe: Connection, news: Semaphore) -> None:
        self.world, self._shared, self._pipe, self._news = world, shared, pipe, news
        self._stops, self._releases = 0, 0
        self._number = 0
        self._hand_over_ms = 0.0
        self._factor = 1.0
        self._asked, self._stay = 0, 0
        self._rebuilt = 0
        self._heard = self._cycled = self._asked_s = time.perf_counter()
        self._within = False
        self._driven = False

    def greet(self) -> None:
        """Tell the parent what there is. The first picture takes long, and so does the first one of an arm
        that moves: both are drawn before anybody waits for them."""
        world = self.world
        world.frames()
        world.frames(world.poses_at(world.q() + NUDGE_RAD))
        self._pipe.send(("ready", world.model.joints, world.joints, world.visuals, world.poses()))

    def run(self) -> None:
        """Returns when the parent asks for it."""
        due = last = drawn = self._heard = self._asked_s = time.perf_counter()
        period = PERIOD_S
        while self._serve_until(due):
            now = time.perf_counter()
            if now - max(due, drawn) > STALL_S:
                self._forget()  # It overslept by so much that it must have been suspended.
            elif now - last > STALL_S:
                self.world.command(None)
            self._mind_the_parent(now)
            self._factor += 0.1 * (period / max(now - last, period) - self._factor)
            last = now
            asleep = self._asleep(now)
            period = ASLEEP_S if asleep else PERIOD_S
            # Late is late: simulated time then runs slower, and no burst makes up for it. Only a Stop does
            # not wait for its turn: what is left of the motion then happens up to a period early.
            due = now + period if now < due else max(due + period, now)
            self._number += 1
            self._shared.tick(self._number)
            self._within = False
            self.world.advance(period, self._before_cycle, asleep)
            # Braking waits for no picture.
            if self._wanted() and not (self.world.gate.stopped and not self.world.gate.at_rest):
                with contextlib.suppress(_Interrupted):
                    self._publish()
            drawn = time.perf_counter()

    def come_to_rest(self) -> None:
        """Brake before leaving, as an arm must whose controller goes."""
        gate = self.world.gate
        gate.stop()
        for _ in range(REST_FRAMES):
            if gate.at_rest:
                break
            self.world.advance(PERIOD_S)
        self._shared.rests(gate.at_rest)

    def _asleep(self, now: float) -> bool:
        """Nobody looks and nothing moves: time then passes in larger steps, which cost less."""
        if self._shared.asked != self._asked or self._driven or not self.world.gate.at_rest:
            self._asked_s = now
        return now - self._asked_s > ASLEEP_AFTER_S

    def _forget(self) -> None:
        """Neither the step in force nor one that waits in the memory may move the arm after a pause."""
        self._shared.take_command(self.world.model.n)
        self.world.command(None)

    def _mind_the_parent(self, now: float) -> None:
        """An app that drives the arm but has not looked for a second is frozen: it has to start anew."""
        if self._shared.asked != self._asked or not self._driven:
            self._heard = now
        elif now - self._heard > SILENT_PARENT_S:
            self._shared.latch("silent")
            self._driven = False

    def _before_cycle(self) -> None:
        """The stop flags first, then a new command if there is one."""
        shared, world, gate = self._shared, self.world, self.world.gate
        shared.cycle()
        shared.rests(gate.at_rest)
        now = time.perf_counter()
        if now - self._cycled > PAUSE_S and self._within:
            self._forget()
        self._cycled, self._within = now, True
        if world.rebuilt != self._rebuilt:
            self._rebuilt = world.rebuilt
            shared.latch("corrupt")
        if shared.stops != self._stops:
            self._stops = shared.stops
            gate.stop()
        elif shared.held:
            if not gate.stopped:
                gate.stop()
        elif gate.stopped or shared.releases != self._releases:
            self._releases = shared.releases
            world.release()
        new, step = shared.take_command(world.model.n)
        if new:
            world.command(step)
            self._driven = step is not None

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
        frames, depths = world.frames(poses, self._between_pictures), world.depths(poses)
        began = time.perf_counter()
        numbers = {
            "stamp": world.time,
            "number": self._number,
            "frozen_mask": sum(1 << i for i, name in enumerate(world.views) if name in world.frozen_views()),
            "released": self._releases,
            "rebuilt": world.rebuilt,
            "hand_over": self._hand_over_ms,
            "real_time_factor": self._factor,
            **world.milliseconds,
        }
        self._shared.publish(numbers, world.q(), poses, frames, depths, as_words(state))
        self._news.release()
        self._hand_over_ms = 1e3 * (time.perf_counter() - began)

    def _serve_until(self, due: float) -> bool:
        """Answer requests until it is time for the next frame; False when the parent wants the end."""
        while True:
            rest = due - time.perf_counter()
            moving = not self.world.gate.at_rest
            if not self._pipe.poll(max(min(rest, LOOK_S) if moving else rest, 0.0)):
                if time.perf_counter() >= due or moving and self._told_to_stop():
                    return True
                continue
            number, request, arguments = self._pipe.recv()
            if request == "close":
                return False
            try:
                answer = getattr(self, "_do_" + request)(*arguments)
            except VitaError as error:
                self._pipe.send(("refused", number, error_kind(error), str(error)))
            else:
                self._pipe.send(("done", number, answer, self._number))

    def _between_pictures(self) -> None:
        """A sign of life, and the latest moment for a Stop that came while a picture was drawn."""
        self._shared.beat()
        if not self.world.gate.at_rest and self._told_to_stop():
            raise _Interrupted

    def _told_to_stop(self) -> bool:
        """Whether there is a stop that the gate has not been told of."""
        shared = self._shared
        return shared.stops != self._stops or shared.held and not self.world.gate.stopped

    def _do_set_limits(self, joints, acceleration):
        self.world.set_limits(joints, acceleration)
        return self.world.joints

    def _do_perform(self, action, arguments):
        self.world.perform(action, arguments)

    def _do_hard_reset(self, q):
        self.world.hard_reset(q)

    def _do_break_in(self, kind, value):
        self.world.mishaps.make(kind, value)

    def _do_gate_state(self):
        return self.world.gate_state()

    def _do_raise(self, text):
        """For tests of what the parent makes of a crash."""
        raise RuntimeError(text)
