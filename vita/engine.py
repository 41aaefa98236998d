"""One tick of everything, in order: observe, track, stack the error, servo, command, publish.

The engine has no thread and no wall clock that matters: time comes with the observation, seeds
with the scenario. The browser's runner and a headless script run the same engine.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vita import commands as cmd
from vita.editing import Editor
from vita.errors import BadInput, NotNow, UnknownName
from vita.faults import Site, Tap, inject
from vita.feeds import FrozenFeeds
from vita.impedance.view import ImpedanceView
from vita.outlook import ghost, ghost_poses
from vita.rig import SimulatedRig
from vita.scenario.schema import Scenario
from vita.servo import Controller, status_for
from vita.servoing import Servoing
from vita.snapshot import Snapshot
from vita.stopwatch import Stopwatch
from vita.tuning import SETTINGS, put_limits, set_mode
from vita.types import ErrorVector, JointStep, Notice, Observation, Status

if TYPE_CHECKING:
    from vita.following import Following
    from vita.impedance.controller import ImpedanceController


class Engine:
    """Owns the rig, the task and the servo."""

    def __init__(
        self, rig: SimulatedRig, scenario: Scenario, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        self.rig = rig
        self._watch = Stopwatch(clock)
        self._tick = 0
        self._notices: list[Notice] = []
        self._lost_until: dict[str, float] = {}
        self.tap = Tap()
        """Where injected faults get in; empty unless people try one."""
        self.site = Site(self, self.tap)
        self._estop: Status | None = None
        self._revision, self._last_state = 0, "idle"
        self.following: Following | None = None
        """The stereo-impedance mode, while it is in force."""
        self.impedance = scenario.impedance
        self.observation: Observation = rig.observe()
        self.editor = Editor(rig, scenario, self.observation)
        self.servoing = Servoing(rig, self.editor, scenario.servo)
        """The servo of the drawn constraints; it keeps what it knows while the other mode is in force."""
        self.limits = scenario.limits
        set_mode(self, scenario.mode)
        self._feeds = FrozenFeeds()
        self.last_step: JointStep | None = None

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
        return self._estop or self.active.status

    @property
    def moving(self) -> bool:
        return self._estop is None and self.active.moving

    @property
    def revision(self) -> int:
        """Grows with every change of state."""
        state = self.status.state
        if state != self._last_state:
            self._revision, self._last_state = self._revision + 1, state
        return self._revision

    # ---- one tick ------------------------------------------------------------------------------

    def tick(self) -> Snapshot:
        """Run one control period and publish it. Raises `RigOffline` when the rig is gone."""
        watch = self._watch
        watch.begin()
        self.observation = self.tap.observation(self.rig.observe())
        watch.lap("observe")
        if self.status.state == "offline":
            self.active.status = status_for("images_late")  # It has come back by itself.
        self.editor.track(self.observation, lost=self._forced_losses())
        self.editor.features = dict(self.tap.reports(self.editor.features, self.observation))
        self.mode.see(self.observation)
        self._pass_on()
        watch.lap("track")
        self.last_step = self.tap.command(self._decide())
        self.rig.command(self.last_step)
        watch.lap("servo")
        self._tick += 1
        snapshot = self.snapshot()
        watch.lap("publish")
        return snapshot

    def _decide(self) -> JointStep | None:
        if not self.moving:
            return None
        gate_fault = str(self.rig.gate_state()["fault"])
        if gate_fault:
            self.fail("gate_fault", gate_fault)
            return None
        self._check_feeds()
        return self.mode.decide(self.observation, self.limits) if self.moving else None

    def _check_feeds(self) -> None:
        frozen = self._feeds.update(self.observation, self.mode.cameras)
        if frozen:
            self.active.halt("frozen_feed", culprit=", ".join(repr(name) for name in frozen))

    def _pass_on(self) -> None:
        """What the mode has to tell people."""
        if self.following is not None and self.following.controller.notice:
            self.say(self.following.controller.notice, "warning")
            self.following.controller.notice = ""

    def _forced_losses(self) -> frozenset[str]:
        now = self.observation.stamp
        return frozenset(name for name, until in self._lost_until.items() if now < until)

    # ---- what people ask -----------------------------------------------------------------------

    def apply(self, command: cmd.Command) -> None:
        """Carry out one command. Raises `VitaError` and changes nothing when it cannot."""
        handler = self._HANDLERS.get(type(command))
        if handler is None:
            raise UnknownName("command", type(command).__name__, (t.__name__ for t in self._HANDLERS))
        handler(self, command)

    def stop(self, reason: str = "stopped_by_user") -> None:
        """Rest now: the arm brakes from the next gate cycle on."""
        if self.moving:
            self.active.halt(reason)
        self.last_step = None
        self.rig.command(None)

    def estop(self, reason: str = "estop", culprit: str = "pressed at the page") -> None:
        """Rest now, and stay there until `Reset`. Idempotent: the first reason stays."""
        self.stop()
        self.rig.stop_now()
        self._estop = self._estop or status_for(reason, culprit=culprit)

    def fail(self, reason: str, culprit: str) -> None:
        """A fault from outside (exception in the loop, rig gone): rest and say so."""
        self.active.status = status_for(reason, culprit=culprit)
        self.active.progress = ""

    @property
    def notices(self) -> tuple[Notice, ...]:
        """The latest messages, oldest first."""
        return tuple(self._notices)

    def resume(self, other: Engine) -> None:
        """Go on with the messages and the tick count of an engine whose place this one takes, so
        that readers who compare numbers see them grow."""
        self._tick, self._revision = other._tick, other.revision + 1
        self._notices = list(other._notices)
        self.site.address, self.site.later = other.site.address, other.site.later

    def say(self, text: str, level: str = "info", instead: cmd.Command | None = None) -> None:
        """Tell the people at the page; `instead` is the command that would have been taken."""
        number = self._notices[-1].id + 1 if self._notices else 1
        notice = Notice(number, level, text, instead)  # type: ignore[arg-type]
        self._notices = [*self._notices[-19:], notice]

    def _start(self, command: cmd.Start) -> None:
        if self.moving:
            return
        if self.status.state == "fault":
            raise NotNow("acknowledge the fault first; then press Start again")
        if self.status.state == "estop":
            raise NotNow("the emergency stop is in force: press Reset and confirm, then Start")
        self._feeds = FrozenFeeds()
        self.mode.start(command)

    def _acknowledge(self, _: cmd.Acknowledge) -> None:
        if self.status.state == "fault":
            self.active.forget()
        self.active.acknowledge()

    def _reset_stop(self, command: cmd.Reset) -> None:
        if self._estop is None:
            raise NotNow("no emergency stop is in force")
        if command.confirm is not True:
            raise BadInput("say that it is safe (confirm), then Reset", "reset")
        self._estop = None
        self.active.forget()
        self.active.acknowledge()

    def _inject(self, command: cmd.Inject) -> None:
        inject(command.fault, self.site)

    def _edit(self, command: cmd.Command) -> None:
        if self.moving:
            raise NotNow("stop the arm first; a task cannot be edited while it moves")
        before = self.editor.task
        self.editor.apply(command, self.observation)
        if self.editor.task is not before and self.controller.status.state in ("done", "hold"):
            self.controller.status = Status()

    def _reset(self, _: cmd.ResetArm) -> None:
        if self.moving:
            raise NotNow("stop the arm first")
        self._back_to_start(self.editor.to_save())

    def _load(self, command: cmd.LoadTask) -> None:
        if self.moving:
            raise NotNow("stop the arm first; then open the task")
        scenario = command.scenario
        if not self.editor.same_scene(scenario):
            raise BadInput("this task needs another scene or other cameras; open it with a new rig")
        self._back_to_start(scenario)
        self.controller.config, self.impedance = scenario.servo, scenario.impedance
        put_limits(self, scenario.limits)
        set_mode(self, scenario.mode)

    def _back_to_start(self, scenario: Scenario) -> None:
        """Arm at the scenario's start pose and every tracker placed afresh; one undoable edit."""
        self.rig.hard_reset(self.editor.start_pose(scenario))
        self.observation = self.rig.observe()
        self.editor.load(scenario, self.observation)
        for controller in {self.controller, self.active}:
            controller.forget()
            controller.status = Status()

    def _perform(self, command: cmd.Perform) -> None:
        arguments = dict(command.arguments)
        if command.action == "lose_tracker":
            self.editor.task.slot(str(arguments.get("tracker")))
            for_s = float(arguments.get("for_s", np.inf))  # type: ignore[arg-type]
            self._lost_until[str(arguments["tracker"])] = self.observation.stamp + for_s
        else:
            self.rig.perform(command.action, **arguments)

    _HANDLERS: dict[type, Callable[[Engine, cmd.Command], None]] = {  # type: ignore[assignment]
        cmd.Start: _start,
        cmd.Halt: lambda self, _: self.stop(),
        cmd.Acknowledge: _acknowledge,
        cmd.Reset: _reset_stop,
        cmd.Inject: _inject,
        cmd.Mend: lambda self, _: self.tap.mend(),
        **SETTINGS,
        cmd.ResetArm: _reset,
        cmd.LoadTask: _load,
        cmd.Perform: _perform,
        **dict.fromkeys(
            (
                cmd.AddTracker,
                cmd.MoveTracker,
                cmd.RenameTracker,
                cmd.DeleteTracker,
                cmd.AddConstraint,
                cmd.DeleteConstraint,
                cmd.SetWeight,
                cmd.SetPriority,
                cmd.ClearTask,
                cmd.Undo,
                cmd.Redo,
            ),
            _edit,
        ),
    }

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
            timing=self._watch.timing(),
            poses=self.rig.poses(),
            insight=insight,
            findings=tuple(self.servoing.findings()),
            ghost=ghost(self.servoing.motion, ahead),
            ghost_poses=ghost_poses(self.rig, seen.q, ahead),
            revision=self.revision,
            injected=self.tap.rows,
            impedance=ImpedanceView() if following is None else following.view(),
        )
