"""The thread that repeats `Engine.tick` for the browser.

Commands come in through one queue, drained before each tick; snapshots go out through a one-slot
mailbox, latest wins. Stop is a flag: it waits behind nothing.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace

from vita import commands as cmd
from vita.engine import Engine
from vita.errors import RigLate, RigOffline, Untrackable, VitaError
from vita.rig import SimulatedRig
from vita.scenario.schema import Scenario
from vita.snapshot import Snapshot
from vita.types import Visual

log = logging.getLogger("vita.runner")
MAX_QUEUE = 256
OFFLINE_AFTER_S = 5.0
"""A rig that lives but sends nothing for so long is called offline. It may still come back [s]."""


class Runner:
    """Owns the engine; everything that a client can do goes through `submit` and `stop`."""

    def __init__(self, make_rig: Callable[[Scenario], SimulatedRig], scenario: Scenario) -> None:
        """Builds the rig and the engine at once, so that a bad scenario is the caller's error."""
        self._make_rig = make_rig
        self.rig_revision = 0
        self._engine = Engine(make_rig(scenario), scenario)
        self._queue: deque[tuple[int, cmd.Command]] = deque()
        self._stop_count = 0
        self._stop = threading.Event()
        self._stop_reason, self._estop = "stopped_by_user", ""
        self._closing = threading.Event()
        self._fresh = threading.Condition()
        self._last_tick_s = time.monotonic()
        self._latest = self._engine.snapshot()
        self._thread = threading.Thread(target=self._run, name="vita-runner", daemon=True)
        self._thread.start()

    # ---- any thread ----------------------------------------------------------------------------

    def submit(self, command: cmd.Command) -> None:
        """Queue a command and return at once; a refusal appears among the snapshot's notices."""
        if len(self._queue) < MAX_QUEUE:
            self._queue.append((self._stop_count, command))

    def stop(self, reason: str = "stopped_by_user") -> None:
        """Rest now. Idempotent, never waits. A Start that was queued before it is dropped."""
        self._stop_count += 1
        self._stop_reason = reason
        self._stop.set()
        self._engine.rig.stop_now()

    def estop(self, culprit: str = "pressed at the page") -> None:
        """Rest now, and let nobody start before `Reset`. Idempotent, never waits."""
        self._stop_count += 1
        self._estop = self._estop or culprit
        self._stop.set()
        self._engine.rig.stop_now()

    def snapshot(self) -> Snapshot:
        return self._latest

    def wait_newer(self, tick: int, timeout: float) -> Snapshot | None:
        """The next snapshot after `tick`, or None when none comes in `timeout` seconds."""
        with self._fresh:
            self._fresh.wait_for(lambda: self._latest.tick != tick or self._closing.is_set(), timeout)
            return self._latest if self._latest.tick != tick else None

    def visuals(self) -> Sequence[Visual]:
        """The meshes of the present rig; `rig_revision` grows when they change."""
        return self._engine.rig.visuals()

    def close(self) -> None:
        """Stop the arm, end the thread, close the rig. Idempotent."""
        self.stop()
        self._closing.set()
        with self._fresh:
            self._fresh.notify_all()
        if self._thread is not threading.current_thread():
            self._thread.join(timeout=5.0)
        self._engine.rig.close()

    # ---- the runner's thread -------------------------------------------------------------------

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self._take_stop()
                self._drain()
                self._publish(self._engine.tick())
                self._last_tick_s = time.monotonic()
            except RigLate as failure:
                self._late(failure)
            except RigOffline as failure:
                self._offline(failure)
            except Exception as failure:
                self._survive(failure)

    def _take_stop(self) -> None:
        if self._stop.is_set():
            self._stop.clear()
            culprit, self._estop = self._estop, ""
            if culprit:
                self._engine.estop(culprit=culprit)
            self._engine.stop(self._stop_reason)

    def _drain(self) -> None:
        while self._queue:
            stops_seen, command = self._queue.popleft()
            if isinstance(command, cmd.Start) and stops_seen != self._stop_count:
                continue
            try:
                self._apply(command)
            except VitaError as refusal:
                self._engine.say(str(refusal), "warning", _instead(command, refusal))
                if isinstance(refusal, RigOffline):
                    raise

    def _apply(self, command: cmd.Command) -> None:
        offline = self._engine.status.state == "offline"
        if isinstance(command, cmd.LoadTask) and (
            offline or not self._engine.editor.same_scene(command.scenario)
        ):
            self._rebuild(command.scenario)
        elif isinstance(command, cmd.ResetArm) and offline:
            self._rebuild(self._latest.scenario)
        else:
            self._engine.apply(command)

    def _rebuild(self, scenario: Scenario) -> None:
        """A new rig for a task that needs another scene. The old one stays if it cannot be built."""
        if self._engine.moving:
            self._engine.apply(cmd.LoadTask(scenario))  # Refuses, with the reason.
        rig = self._make_rig(scenario)
        try:
            engine = Engine(rig, scenario)
        except BaseException:
            rig.close()
            raise
        engine.resume(self._engine)
        old, self._engine = self._engine, engine
        self.rig_revision += 1
        old.rig.close()

    def _publish(self, snapshot: Snapshot) -> None:
        with self._fresh:
            self._latest = snapshot
            self._fresh.notify_all()

    def _late(self, failure: RigLate) -> None:
        """The gate brakes by itself when steps stay away; here it is said, and waited for more."""
        if time.monotonic() - self._last_tick_s > OFFLINE_AFTER_S:
            self._offline(failure)
            return
        self._engine.stop("images_late")
        self._publish_status()

    def _offline(self, failure: RigOffline) -> None:
        """Say once that the rig is gone, and wait for somebody to restart it."""
        engine = self._engine
        if engine.status.state != "offline":
            log.error("rig offline: %s", failure)
            engine.fail("rig_offline", str(failure).splitlines()[0] if str(failure) else "no answer")
        self._publish_status()
        self._closing.wait(0.1)

    def _publish_status(self) -> None:
        """The last snapshot again with the state of now: there is no new observation to show."""
        engine = self._engine
        status, tick = engine.status, self._latest.tick + 1
        self._publish(replace(self._latest, tick=tick, status=status, notices=engine.notices, progress=""))

    def _survive(self, failure: Exception) -> None:
        """An error in our own code is a fault of the arm's state, shown, logged, and survivable."""
        log.exception("the control loop failed")
        self._engine.fail("internal_error", f"{type(failure).__name__}: {failure}")
        try:
            self._engine.rig.command(None)
        except VitaError:
            log.exception("the rig could not be told to rest")
        self._publish_status()
        self._closing.wait(0.1)


def _instead(command: cmd.Command, refusal: VitaError) -> cmd.Command | None:
    """The same command at the nearest place that a tracker could hold on to."""
    spot = refusal.suggestion if isinstance(refusal, Untrackable) else None
    if spot is None or not isinstance(command, (cmd.AddTracker, cmd.MoveTracker)):
        return None
    shift = float(spot[0]) - command.uv[0], float(spot[1]) - command.uv[1]
    to = None if command.to is None else (command.to[0] + shift[0], command.to[1] + shift[1])
    return replace(command, uv=(float(spot[0]), float(spot[1])), to=to)


def live_runner(scenario: Scenario) -> Runner:
    """The runner of the app: the simulation lives in a process of its own."""
    from vita.sim.live import LiveRig

    return Runner(lambda s: LiveRig(s), scenario)
