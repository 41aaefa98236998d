"""One tick of everything, in order: observe, track, stack the error, servo, command, publish.

The engine has no thread and no wall clock that matters: time comes with the observation, seeds
with the scenario. The browser's runner and a headless script run the same engine.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from vita import commands as cmd
from vita import states
from vita.camera_watch import CameraWatch
from vita.editing import Editor
from vita.errors import NotNow, RigOffline, UnknownName, VitaError
from vita.evidence import Ring
from vita.faults import Site, Tap
from vita.gate_words import GateWords
from vita.impedance.view import ImpedanceView
from vita.orders import ORDERS
from vita.outlook import ghost, ghost_poses
from vita.pace import Pace
from vita.rig import SimulatedRig
from vita.scenario.schema import Scenario
from vita.servo import Controller, status_for
from vita.servo.reasons import REASONS
from vita.servoing import Servoing
from vita.snapshot import Snapshot
from vita.stopwatch import Stopwatch
from vita.tuning import set_mode
from vita.types import ErrorVector, JointStep, Notice, Observation, Status

if TYPE_CHECKING:
    from vita.following import Following
    from vita.impedance.controller import ImpedanceController

HELD_MEANWHILE = "held meanwhile: the state has changed since this was clicked; look, and click again"


def words(command: object) -> str:
    """A command in a few words, for the evidence; a whole scenario would not be."""
    return "LoadTask" if isinstance(command, cmd.LoadTask) else repr(command)[:120]


class Engine:
    """Owns the rig, the task and the servo."""

    def __init__(
        self, rig: SimulatedRig, scenario: Scenario, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        self.rig = rig
        self._watch = Stopwatch(clock)
        self._tick = 0
        self._notices: list[Notice] = []
        self.lost_until: dict[str, float] = {}
        """Tracker name to when a script gives it back [s]."""
        self.tap = Tap()
        """Where injected faults get in; empty unless people try one."""
        self.site = Site(self, self.tap, child_pid=getattr(rig, "pid", None))
        self._estop: Status | None = None
        self._away: Status | None = None
        self._revision, self._last_state = 0, "idle"
        self.ring = Ring()
        """What the last ten seconds saw and did."""
        self.evidence = ""
        """File of the last recording that a fault left; whoever writes it says so here."""
        self.phase, self.beats = "", 0
        """What a tick is at, for people, and a count that stands still while it is stuck."""
        self.following: Following | None = None
        """The stereo-impedance mode, while it is in force."""
        self.impedance = scenario.impedance
        self.observation: Observation = rig.observe()
        self.editor = Editor(rig, scenario, self.observation)
        self.servoing = Servoing(rig, self.editor, scenario.servo)
        """The servo of the drawn constraints; it keeps what it knows while the other mode is in force."""
        self.limits = scenario.limits
        set_mode(self, scenario.mode)
        self.cameras = CameraWatch(
            {spec.name: spec.size for spec in scenario.camera}, getattr(rig, "reopen", None)
        )
        self.last_step: JointStep | None = None
        self.dropped_steps = 0
        """Commands that the gate did not carry out, since the rig was built."""
        self._rebuilt = 0
        self._pace = Pace()
        self._gate: Mapping[str, object] | None = None
        self._gate_words = GateWords()

    @property
    def mode(self) -> Servoing | Following:
        """What Start starts."""
        return self.servoing if self.following is None else self.following

    @property
    def controller(self) -> Controller:
        """The servo of the drawn constraints."""
        return self.servoing.controller

    @property
    def error(self) -> ErrorVector:
        """The stacked error of the last observation."""
        return self.servoing.error

    @property
    def active(self) -> Controller | ImpedanceController:
        """Whose turn it is: the servo, or the controller of the stereo-impedance mode."""
        return self.mode.controller

    @property
    def status(self) -> Status:
        """An emergency stop lies above a robot that is gone, and that above the servo's own state."""
        return self._estop or self._away or self.active.status

    @property
    def moving(self) -> bool:
        return self._estop is None and self._away is None and self.active.moving

    @property
    def away(self) -> bool:
        """Whether the robot is gone."""
        return self._away is not None

    @property
    def revision(self) -> int:
        """Grows with every change of state, and with every Stop."""
        status = self.status
        if status.state != self._last_state:
            change = f"{self._last_state} -> {status.state}"
            self.ring.say(self.observation.stamp, "state", change, status.reason, status.message)
            self._revision, self._last_state = self._revision + 1, status.state
        return self._revision

    # ---- one tick ------------------------------------------------------------------------------

    def tick(self) -> Snapshot:
        """Run one control period and publish it. Raises `RigOffline` when the rig is gone."""
        try:
            return self._one_period()
        finally:
            self._at("")  # Also when it raised: what comes next is no part of this period.

    def _one_period(self) -> Snapshot:
        watch = self._watch
        watch.begin()
        self._at("observe")
        seen = self.rig.observe()
        self._at("work")
        self.observation = self._pictures(seen)
        watch.lap("observe")
        self._away = None  # It is there, again.
        self.phase = "track"
        self.editor.track(
            self.observation, self._forced_losses(), self.cameras.unusable, tap=self.tap.reports
        )
        self.mode.see(self.observation)
        self._offer()
        self._pass_on()
        if words := self._pace.look(self._real_time_factor()):
            self.say(words)
        watch.lap("track")
        self.phase = "servo"
        self.last_step = self.tap.command(self._decide())
        self.rig.command(self.last_step)
        watch.lap("servo")
        self._tick += 1
        self.phase = "publish"
        snapshot = self.snapshot()
        self.ring.note(self.observation, snapshot, self.last_step, self._gate)
        watch.lap("publish")
        return snapshot

    def _at(self, phase: str) -> None:
        self.phase = phase
        self.beats += 1

    def _heed_gate(self) -> None:
        """A simulation that had to be rebuilt is an emergency, also while the arm rests."""
        gate = self.rig.gate_state()
        self.dropped_steps = int(gate.get("dropped", 0))  # type: ignore[call-overload]
        rebuilt = int(gate.get("rebuilt", bool(gate.get("corrupt"))))  # type: ignore[arg-type]
        if rebuilt > self._rebuilt:
            self.estop("state_corrupt")
        self._rebuilt = rebuilt

    def _decide(self) -> JointStep | None:
        self._heed_gate()
        if not self.moving:
            self._gate = None
            return None
        self._gate = self.rig.gate_state()
        for words_of_gate in self._gate_words.update(self._gate, self.rig.joints):
            self.say(words_of_gate, "warning")
        gate_fault = str(self._gate["fault"])
        if gate_fault:
            self.fail(str(self._gate.get("kind") or "gate_fault"), gate_fault)
            return None
        self._check_feeds()
        return self.mode.decide(self.observation, self.limits) if self.moving else None

    def _pictures(self, seen: Observation) -> Observation:
        """The observation with a blank picture in place of each that cannot be used."""
        try:
            seen = self.tap.observation(seen)
        except RigOffline:
            raise
        except Exception as failure:  # It stands for a camera whose driver raises.
            seen = self.cameras.failed(seen, failure)
        return self.cameras.take(seen)

    def _check_feeds(self) -> None:
        """Rest when the cameras show nothing to move by."""
        trouble = self.cameras.trouble(self.observation, self.mode.cameras)
        if trouble is not None:
            self.active.halt(trouble.reason, **trouble.facts)

    def _offer(self) -> None:
        """Say so when the cameras that stopped the arm are well again."""
        words = self.cameras.offer(self.observation, self.active.status)
        if words:
            self.active.status = replace(self.active.status, message=words)
            self.say(words)

    def _pass_on(self) -> None:
        """What the mode has to tell people."""
        if self.following is not None and self.following.controller.notice:
            self.say(self.following.controller.notice, "warning")
            self.following.controller.notice = ""

    def _forced_losses(self) -> frozenset[str]:
        now = self.observation.stamp
        return frozenset(name for name, until in self.lost_until.items() if now < until)

    # ---- what people ask -----------------------------------------------------------------------

    def apply(self, command: cmd.Command, revision: int | None = None) -> None:
        """Carry out one command. Raises `VitaError` and changes nothing when it cannot.

        revision: `Snapshot.revision` that was seen when this was asked for. What was meant for another state
        is refused, because it would mean something else now.
        """
        try:
            event = self.check(command, revision)
            if event == "start" and self.moving:
                return  # A second click is not a second start.
            ORDERS[type(command)](self, command)
        except VitaError as refusal:
            self.ring.say(self.observation.stamp, "refused", words(command), "", str(refusal))
            raise
        self.ring.say(self.observation.stamp, "command", words(command))
        if event == "edit" and self._last_state in ("hold", "done"):
            # The task has changed, not what the arm is permitted: the clicks after it are still meant.
            self._last_state = self.status.state

    def check(self, command: cmd.Command, revision: int | None = None) -> str:
        """The event that a command stands for. Raises `NotNow` where the state of now does not allow it."""
        event = states.event_of(command)
        if event is None or type(command) not in ORDERS:
            raise UnknownName("command", type(command).__name__, (t.__name__ for t in ORDERS))
        stale = revision is not None and revision < self.revision and event in states.CLICKS
        if stale and not (event == "start" and self.moving):
            raise NotNow(HELD_MEANWHILE)
        states.following(event, self.status.state)
        return event

    def stop(self, reason: str = "stopped_by_user", **facts: object) -> None:
        """Rest now: the arm brakes from the next gate cycle on. Whatever was clicked before is stale."""
        self._revision += 1
        self.hold(reason, **facts)
        self.last_step = None
        self.rig.command(None)

    def hold(self, reason: str, **facts: object) -> None:
        """Leave motion, if the arm moves, for the state that `reason` leads to."""
        if self.moving:
            self.active.halt(reason, **facts)
        self.last_step = None

    def estop(self, reason: str = "estop", culprit: str = "pressed at the page") -> None:
        """Rest now, and stay there until `Reset`. Idempotent: the first reason stays."""
        self.hold("stopped_by_user")
        self._estop = self._estop or status_for(reason, culprit=culprit)
        self._revision += 1
        # The latch comes first: a rig that is gone cannot be told, and is not to undo it.
        try:
            self.rig.stop_now()
            self.rig.command(None)
        except RigOffline as failure:
            self.lose(culprit=str(failure).partition("\n")[0])

    def fail(self, reason: str, culprit: str, **facts: object) -> None:
        """A fault from outside (exception in the loop, a controller that hung): rest and say so."""
        if REASONS[reason][0] == "offline":
            self.lose(culprit, reason)
            return
        self.active.status = status_for(reason, culprit=culprit, **facts)
        self.active.progress = ""
        self.last_step = None

    def lose(self, culprit: str, reason: str = "rig_offline", silent_s: float = 1.0) -> None:
        """The robot is gone, and was silent for `silent_s`: offline until it is back. A fault beneath it
        stays, and nothing moves again before somebody presses Start."""
        self.active.halt("images_late", late="every camera", ms=1e3 * silent_s)
        self.last_step = None
        self._away = self._away or status_for(reason, culprit=culprit)
        with suppress(RigOffline):
            self.rig.stop_now()  # Should it be there after all, or come back, it is to stay where it is.

    @property
    def notices(self) -> tuple[Notice, ...]:
        """The latest messages, oldest first."""
        return tuple(self._notices)

    def resume(self, other: Engine) -> None:
        """Go on with the messages and the tick count of an engine whose place this one takes, so
        that readers who compare numbers see them grow."""
        self._tick, self._revision = other._tick, other.revision + 1
        self._notices, self.evidence = list(other._notices), other.evidence
        self.ring = other.ring
        self._last_state, self._estop = other._last_state, other._estop
        if self._estop is not None:
            self.rig.stop_now()
        self.site.address, self.site.later = other.site.address, other.site.later
        self.site.page = other.site.page

    def skip_to(self, tick: int) -> int:
        """Count on from `tick`, which somebody has given out already; returns it."""
        self._tick = max(self._tick, tick)
        return tick

    def say(self, text: str, level: str = "info", instead: cmd.Command | None = None) -> None:
        """Tell the people at the page; `instead` is the command that would have been taken."""
        number = self._notices[-1].id + 1 if self._notices else 1
        notice = Notice(number, level, text, instead)  # type: ignore[arg-type]
        self._notices = [*self._notices[-19:], notice]
        self.ring.say(self.observation.stamp, "notice", text, level)

    def lift_estop(self) -> None:
        """Leave an emergency stop for idle, or for offline where the robot is gone. Moves nothing."""
        self._estop = None
        self.active.forget()
        if not self.away:
            self.active.status = Status()

    def _real_time_factor(self) -> float:
        """Simulated seconds per second on the wall; 1 for a rig that knows no other time."""
        return float(getattr(self.rig, "real_time_factor", 1.0))

    # ---- what everybody sees -------------------------------------------------------------------

    def present(self) -> Scenario:
        """The scene, task and settings of now."""
        return replace(
            self.editor.to_save(), servo=self.controller.config, limits=self.limits,
            impedance=self.impedance, mode="uvs" if self.following is None else "impedance",
        )  # fmt: skip

    def snapshot(self) -> Snapshot:
        """The state after the last tick."""
        seen, editor, controller = self.observation, self.editor, self.controller
        following = self.following
        insight = controller.insight
        ahead = insight.next_dq if insight is not None and controller.status.state == "servoing" else None
        return Snapshot(
            tick=self._tick,
            stamp=seen.stamp,
            status=self.status,
            q=seen.q,
            joints=tuple(self.rig.joints),
            frames=seen.frames,
            features=dict(editor.features),
            scenario=self.present(),
            error=self.error,
            progress=self.active.progress,
            jacobian=controller.jacobian,
            can_undo=editor.can_undo,
            can_redo=editor.can_redo,
            notices=self.notices,
            timing=replace(self._watch.timing(), real_time_factor=self._real_time_factor()),
            poses=self.rig.poses(),
            insight=insight,
            findings=tuple(self.servoing.findings()),
            ghost=ghost(self.servoing.motion, ahead),
            ghost_poses=ghost_poses(self.rig, seen.q, ahead),
            revision=self.revision,
            injected=self.tap.rows,
            evidence=self.evidence,
            impedance=ImpedanceView() if following is None else following.view(),
        )
