"""The thread that repeats `Engine.tick` for the browser.

Commands come in through one queue, drained before each tick; snapshots go out through a one-slot
mailbox, latest wins. Stop is a flag: it waits behind nothing. A second thread watches the first: a
controller that hangs is a fault that is published without it, and left by Restart, which builds a new
engine on a new rig in a new thread. Every thread has a number; one whose number is no longer in force
touches nothing and ends.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vita import commands as cmd
from vita.data import faults_folder
from vita.doze import Doze
from vita.engine import HELD_MEANWHILE, Engine
from vita.errors import RigLate, RigOffline, Untrackable, VitaError
from vita.evidence import EvidenceFiles
from vita.logs import OncePerSecond
from vita.rig import SimulatedRig
from vita.scenario.schema import Scenario
from vita.servo import status_for
from vita.snapshot import Snapshot
from vita.types import Status, Visual
from vita.watchdog import Beating, Watchdog

log = logging.getLogger("vita.runner")
log.addFilter(OncePerSecond())
MAX_QUEUE = 256
OFFLINE_AFTER_S = 1.0
"""A rig that lives but sends nothing for so long is called offline. It may still come back [s]."""
LEAVES_EVIDENCE = ("fault", "estop", "offline")


@dataclass(frozen=True)
class _Click:
    """A command on its way."""

    command: cmd.Command
    revision: int | None
    stops: int
    """How many stops there had been when it was made."""


class Runner:
    """Owns the engine; everything that a client can do goes through `submit`, `stop` and `estop`."""

    def __init__(
        self,
        make_rig: Callable[[Scenario], SimulatedRig],
        scenario: Scenario,
        evidence: Path | None = None,
    ) -> None:
        """Builds the rig and the engine at once, so that a bad scenario is the caller's error.

        evidence: folder for what faults leave behind; None writes nothing.
        """
        self._make_rig = make_rig
        self.rig_revision = 0
        self._evidence = None if evidence is None else EvidenceFiles(evidence)
        self._queue: deque[_Click] = deque()
        self._flags = threading.RLock()  # A signal may interrupt its own holder.
        """Guards the three below. Nothing is ever done under it that could wait."""
        self._stop_count = 0
        self._stop_asked: str | None = None
        self._estop = ""
        self._closing = threading.Event()
        self._fresh = threading.Condition()
        """Guards the snapshot and the number of the thread in force."""
        self._number = 0
        self._hung: Status | None = None
        self._restarting = False
        self._engine = self._equipped(Engine(make_rig(scenario), scenario))
        self._latest = self._engine.snapshot()
        self._heard_s = time.monotonic()
        self._doze = Doze()
        self._thread = self._worker(self._run)
        self._watchdog = Watchdog(lambda: self._engine, self._stuck, self._answer)

    def _worker(self, run: Callable[[int], None]) -> threading.Thread:
        thread = threading.Thread(target=run, args=(self._number,), name="vita-runner", daemon=True)
        thread.start()
        return thread

    def _equipped(self, engine: Engine) -> Engine:
        engine.site.later = engine.site.later or _in_a_thread
        return engine

    def has_page(self, page: Any) -> None:
        """The page that shows this runner, a `vita.ui.drill.Drill`: faults of the page are tried on it."""
        site = self._engine.site
        site.address, site.page = page.own_address, page

    # ---- any thread ----------------------------------------------------------------------------

    def submit(self, command: cmd.Command, revision: int | None = None) -> None:
        """Queue a command and return at once; a refusal appears among the snapshot's notices.

        revision: `Snapshot.revision` that the person saw. A click (`vita.states.CLICKS`) that was made in
        another state, or before a Stop, is dropped with a notice.
        """
        if len(self._queue) < MAX_QUEUE:
            self._queue.append(_Click(command, revision, self._stop_count))
            self._doze.wake()

    def stop(self, reason: str = "stopped_by_user") -> None:
        """Rest now. Idempotent, never waits. A Start that was queued before it is dropped."""
        with self._flags:
            self._stop_count += 1
            self._stop_asked = reason
        self._engine.rig.stop_now()

    def estop(self, culprit: str = "pressed at the page") -> None:
        """Rest now, and let nobody start before `Reset`. Idempotent, never waits, and in force at once: it is
        said even when the control loop hangs."""
        with self._flags:
            self._stop_count += 1
            self._stop_asked = self._stop_asked or "stopped_by_user"
            self._estop = self._estop or culprit
        self._engine.rig.stop_now()
        self._publish_status()

    def snapshot(self) -> Snapshot:
        return self._latest

    def wait_newer(self, tick: int, timeout: float) -> Snapshot | None:
        """The next snapshot after `tick`, or None when none comes in `timeout` seconds."""
        self._doze.wake()
        with self._fresh:
            self._fresh.wait_for(lambda: self._latest.tick != tick or self._closing.is_set(), timeout)
            return self._latest if self._latest.tick != tick else None

    @property
    def arm_process(self) -> tuple[int, str] | None:
        """The process that the arm is in and the memory shared with it; None where it is in this one."""
        rig = self._engine.rig
        pid = getattr(rig, "pid", None)
        return None if pid is None else (pid, getattr(rig, "memory", ""))

    @property
    def dropped_steps(self) -> int:
        """Commands that the gate did not carry out, since the rig was built."""
        return self._engine.dropped_steps

    def visuals(self) -> Sequence[Visual]:
        """The meshes of the present rig; `rig_revision` grows when they change."""
        return self._engine.rig.visuals()

    def close(self) -> None:
        """Stop the arm, end the threads, close the rig. Idempotent."""
        self.stop("closing")
        self._closing.set()
        self._doze.wake()
        with self._fresh:
            self._fresh.notify_all()
        self._watchdog.close()
        if self._thread is not threading.current_thread():
            # A controller that hangs cannot be waited for.
            self._thread.join(timeout=0.2 if self._hung else 5.0)
        self._engine.rig.close()

    # ---- the runner's thread -------------------------------------------------------------------

    def _run(self, number: int) -> None:
        while self._in_force(number):
            try:
                self._come_back(number)
                self._drain(number)
                self._take_stop()  # A Start must not have lifted what a Stop has latched meanwhile.
                self._publish(self._engine.tick(), number)
                self._doze.nap(self._engine.moving)
                self._heard_s = time.monotonic()
            except RigLate as failure:
                self._late(failure, number)
            except RigOffline as failure:
                self._offline(failure, number)
            except Exception as failure:
                self._survive(failure, number)

    def _in_force(self, number: int) -> bool:
        return number == self._number and not self._closing.is_set()

    def _heed_outside(self) -> None:
        """The arm may have been stopped past this process (`vita stop`), or because this process stood still:
        the gate has it in force already, here it is said."""
        outside = getattr(self._engine.rig, "outside_stop", str)()
        if outside == "emergency":
            self.estop("vita stop --emergency")
        elif outside:
            self.stop("app_silent" if outside == "silent" else "stopped_by_user")

    def _take_stop(self) -> None:
        self._heed_outside()
        with self._flags:
            reason, self._stop_asked = self._stop_asked, None
            estop = self._estop
        if estop and self._engine.status.state != "estop":
            self._engine.estop(culprit=estop)
        if reason is not None:
            self._engine.stop(reason)

    def _drain(self, number: int) -> None:
        held = False
        while self._queue and self._in_force(number):
            click = self._queue.popleft()
            self._take_stop()  # Whatever was pressed before this click is in force when it is looked at.
            if isinstance(click.command, BEFORE_A_STOP) and click.stops != self._stop_count:
                held = True
                continue
            self._heard_s = time.monotonic()
            try:
                self._apply(click, number)
            except VitaError as refusal:
                self._engine.say(str(refusal), "warning", _instead(click.command, refusal))
                if isinstance(refusal, RigOffline):
                    raise
        if held:
            self._engine.say(HELD_MEANWHILE, "warning")

    def _apply(self, click: _Click, number: int) -> None:
        engine, command = self._engine, click.command
        status = engine.status
        if isinstance(command, cmd.LoadTask) and (
            status.state == "offline" or not engine.editor.same_scene(command.scenario)
        ):
            engine.check(command, click.revision)
            self._rebuild(command.scenario, number)
        elif isinstance(command, cmd.ResetArm) and status.state == "offline":
            engine.check(command, click.revision)
            self._rebuild(self._latest.scenario, number)
        elif isinstance(command, cmd.ResetArm) and status.reason == "controller_stopped":
            self._rebuild(self._latest.scenario, number)
        else:
            engine.apply(command, click.revision)
            if isinstance(command, cmd.Reset):
                self._lift(click.stops)

    def _lift(self, stops: int) -> None:
        """Forget the emergency stop that has been reset, unless it was pressed again meanwhile."""
        with self._flags:
            if self._stop_count == stops:
                self._estop = ""

    def _rebuild(self, scenario: Scenario, number: int) -> None:
        """A new rig for a task that needs another scene. The old one stays if it cannot be built."""
        rig = self._make_rig(scenario)
        try:
            engine = self._equipped(Engine(rig, scenario))
            engine.resume(self._engine)
            with self._fresh:
                if number != self._number:
                    raise RigOffline("somebody else has restarted it")
                old, self._engine = self._engine, engine
                self.rig_revision += 1
                self._hung = None
        except BaseException:
            rig.close()
            raise
        self._heard_s = time.monotonic()
        try:
            old.tap.mend()  # What was injected reached outside the old engine, perhaps.
        except Exception:
            log.exception("an injected fault could not be taken back")
        old.rig.close()

    def _publish(self, snapshot: Snapshot, number: int) -> None:
        with self._fresh:
            if number == self._number:
                self._put(snapshot)

    def _publish_status(self, number: int | None = None) -> None:
        """The last snapshot again with the state of now: there is no new observation to show. Threads other
        than the one in force leave the number out; they say what the flags say."""
        with self._fresh:
            if number not in (None, self._number):
                return
            engine, latest = self._engine, self._latest
            revision = latest.revision if number is None else engine.revision
            self._put(
                replace(latest, tick=latest.tick + 1, status=engine.status, notices=engine.notices,
                        progress="", revision=revision, evidence=engine.evidence,
                        injected=engine.tap.rows)
            )  # fmt: skip

    def _put(self, snapshot: Snapshot) -> None:
        """Hand out a snapshot; under the lock. What the flags say lies above what the engine says."""
        before, tick = self._latest, snapshot.tick
        if tick <= before.tick:
            tick = self._engine.skip_to(before.tick + 1)
        status = snapshot.status
        if self._estop and status.state != "estop":
            status = status_for("estop", culprit=self._estop)
        elif self._hung is not None and status.state != "estop":
            status = self._hung
        if tick != snapshot.tick or status is not snapshot.status:
            snapshot = replace(snapshot, tick=tick, status=status)
        self._latest = snapshot
        self._fresh.notify_all()
        entered = (status.state, status.reason) != (before.status.state, before.status.reason)
        if self._evidence is not None and entered and status.state in LEAVES_EVIDENCE:
            self._evidence.write(self._engine.ring, status, self._has_evidence)

    def _has_evidence(self, path: str) -> None:
        self._engine.evidence = path
        self._publish_status()

    # ---- what goes wrong -------------------------------------------------------------------------

    def _late(self, failure: RigLate, number: int) -> None:
        """The gate brakes by itself when steps stay away; here it is said, and waited for more."""
        silent_s = time.monotonic() - self._heard_s
        if silent_s > OFFLINE_AFTER_S:
            self._offline(failure, number)
            return
        if self._engine.moving:
            self._engine.stop("images_late", late="every camera", ms=1e3 * silent_s)
        self._publish_status(number)

    def _offline(self, failure: RigOffline, number: int) -> None:
        """Say once that the rig is gone, and wait for somebody to restart it."""
        if not self._in_force(number):
            return
        if not self._engine.away:
            log.error("rig offline: %s", failure)
            said = str(failure).splitlines()[0] if str(failure) else "no answer"
            self._engine.lose(said, silent_s=time.monotonic() - self._heard_s)
        self._publish_status(number)
        self._closing.wait(0.1)

    def _survive(self, failure: Exception, number: int) -> None:
        """An error in our own code is a fault of the arm's state, shown, logged, and survivable."""
        log.exception("the control loop failed")
        if not self._in_force(number):
            return
        self._engine.fail("internal_error", f"{type(failure).__name__}: {failure}")
        try:
            self._engine.rig.command(None)
        except VitaError:
            log.exception("the rig could not be told to rest")
        self._publish_status(number)
        self._closing.wait(0.1)

    # ---- a controller that hangs -----------------------------------------------------------------

    def _stuck(self, engine: Beating, doing: str, ms: float) -> None:
        """The watchdog's word. The state is a fault although the thread that owns it says nothing."""
        with self._fresh:
            if engine is not self._engine or self._hung is not None:
                return
            self._hung = status_for("controller_stopped", ms=ms, culprit=f"it was {doing}")
        log.error("%s", self._hung.message)
        self._engine.rig.stop_now()
        self._publish_status()

    def _come_back(self, number: int) -> None:
        """A thread that went on after all, before anybody restarted it, takes the fault over."""
        with self._fresh:
            if self._hung is None or number != self._number:
                return
            status, self._hung = self._hung, None
        self._engine.stop()
        self._engine.active.status = status

    def _answer(self) -> None:
        """While the control loop hangs, the watchdog's thread reads what people ask for."""
        while self._hung is not None and self._queue:
            command = self._queue.popleft().command
            if not isinstance(command, cmd.ResetArm):
                self._engine.say("the controller does not answer: press Restart first", "warning")
                self._publish_status()
            elif not self._restarting:
                self._restarting = True
                with self._fresh:
                    self._number += 1
                self._thread = self._worker(self._restart)

    def _restart(self, number: int) -> None:
        """A new engine on a new rig; the thread that hangs is left behind and ends when it comes back."""
        try:
            self._rebuild(self._latest.scenario, number)
        except Exception as failure:
            log.exception("the restart failed")
            self._engine.say(f"the restart failed: {failure}", "error")
            self._publish_status()
            return
        finally:
            self._restarting = False
        self._run(number)


BEFORE_A_STOP = (cmd.Start, cmd.Acknowledge, cmd.Reset)
"""What is dropped when somebody presses Stop before it is carried out."""


def _in_a_thread(what: Callable[[], None]) -> None:
    threading.Thread(target=what, name="vita-fault", daemon=True).start()


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

    return Runner(lambda s: LiveRig(s), scenario, faults_folder())
