"""Random sequences of everything that people and the world can do to the engine, with the rules watched."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from vita import commands as cmd
from vita import states
from vita.engine import Engine
from vita.errors import RigOffline, VitaError
from vita.fuzz.base import Report
from vita.fuzz.stick_rig import StickRig, stick_task
from vita.scenario.schema import Scenario
from vita.types import MOVING_STATES, State

LONGEST = 60
"""Events in a sequence, at most."""
CLIENTS = 3
BRAKED_TICKS = 7
"""The arm may brake for so many periods after a stop, from 1.5 rad/s at 8 rad/s^2; then it stands."""
_ENDS = ("hold", "done", "fault", "learning", "servoing")
"""Where the servo itself may take a moving arm within a period."""


class Mob:
    """An engine, three clients of whom one drives, and a world in which things go wrong.

    A client acts on what it saw when it last looked, which may be long ago.
    """

    def __init__(self, make_rig: Callable[[], Any], scenario: Scenario, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self._make_rig, self._scenario = make_rig, scenario
        self.rig = make_rig()
        self.engine = Engine(self.rig, scenario)
        self.driver = 0
        self._looked = [0] * CLIENTS
        """Revision that each client saw last."""
        self.story: list[str] = []
        self.violations: list[str] = []
        self.figures = {"events": 0, "ticks": 0, "started": 0, "refused": 0}
        self._still: tuple[int, Any] = (0, self.rig.q)
        """Since how many ticks nothing permitted motion, and where the arm stood at the last."""
        self._events: tuple[tuple[float, Callable[[int], str | None]], ...] = (
            (30, self._ticks), (20, self._start), (6, self._stop), (2, self._estop),
            (5, self._acknowledge), (5, self._reset), (4, self._edit), (1, self._load), (2, self._reset_arm),
            (1, self._mode), (3, self._setting), (2, self._limits), (2, self._robot_lost), (2, self._fail),
            (2, self._hold), (1, self._gate_fault), (2, self._driver_left), (2, self._take_over),
            (1, self._rebuild),
        )  # fmt: skip
        weights = np.array([weight for weight, _ in self._events])
        self._weights = weights / weights.sum()

    def event(self) -> None:
        """One event, by a client at random, and every rule checked after it."""
        act = self._events[self.rng.choice(len(self._events), p=self._weights)][1]
        # The driver does most of what is done.
        client = self.driver if self.rng.random() < 0.5 else int(self.rng.integers(CLIENTS))
        if self.rng.random() < 0.7:
            self._looked[client] = self.engine.revision
        before, moved, revision = self.engine.status.state, self.engine.moving, self.engine.revision
        self.story.append(f"{act.__name__[1:]} by {client} in {before}")
        self.figures["events"] += 1
        try:
            event = act(client)
        except VitaError as refusal:
            self.figures["refused"] += 1
            if not str(refusal):
                self._broke("a refusal says nothing")
            event = "refused"
        except Exception as failure:
            self._broke(f"{type(failure).__name__}: {failure}")
            return
        self._check(event, client, before, moved, revision)

    def may_start(self, client: int) -> bool:
        """Who drives may start; what the page's lease sees to in the app."""
        return client == self.driver

    # ---- what happens: each answers with the table's event, None when it is none of the table's ---------

    def _ticks(self, client: int) -> str | None:
        # Mostly short, or little would happen while the arm moves; now and then to the end of the task.
        for _ in range(40 if self.rng.random() < 0.03 else int(self.rng.integers(1, 3))):
            self._tick()
        return "tick"

    def _tick(self) -> None:
        self.figures["ticks"] += 1
        moved = self.engine.moving
        try:
            self.engine.tick()
        except RigOffline as failure:
            self.engine.lose(str(failure))  # As the runner does.
        if self.engine.moving or moved:
            self._still = (0, self.rig.q)
            return
        if self.engine.last_step is not None:
            self._broke("a step was commanded although nothing permits motion")
        count, q = self._still
        if count > BRAKED_TICKS and not np.array_equal(q, self.rig.q):
            self._broke("the arm moves although nothing permits motion")
        self._still = (count + 1, self.rig.q)

    def _start(self, client: int) -> str | None:
        if not self.may_start(client):
            return None  # The page's lease refuses it.
        self.engine.apply(cmd.Start(relearn=bool(self.rng.random() < 0.8)), self._looked[client])
        return "start"

    def _stop(self, client: int) -> str:
        self.engine.stop()
        status = self.engine.status
        self.engine.stop()
        if self.engine.status is not status:
            self._broke("a second Stop changed something")
        return "stop"

    def _estop(self, client: int) -> str:
        self.engine.estop()
        status = self.engine.status
        self.engine.estop(culprit="pressed again")
        if self.engine.status is not status:
            self._broke("a second emergency stop changed something")
        return "estop"

    def _command(self, client: int, command: cmd.Command) -> str:
        self.engine.apply(command, self._looked[client])
        event = states.event_of(command)
        assert event is not None
        return event

    def _acknowledge(self, client: int) -> str:
        return self._command(client, cmd.Acknowledge())

    def _reset(self, client: int) -> str:
        return self._command(client, cmd.Reset(confirm=bool(self.rng.random() < 0.7)))

    def _edit(self, client: int) -> str:
        weight = float(self.rng.choice([0.5, 1.0, 2.0]))
        name = str(self.rng.choice([c.name for c in self.engine.present().constraint] or ["none"]))
        edits = (cmd.SetWeight(name, weight), cmd.Undo(), cmd.Redo(), cmd.SetPriority(name, 2))
        return self._command(client, edits[int(self.rng.integers(len(edits)))])

    def _load(self, client: int) -> str:
        return self._anew(client, cmd.LoadTask(self._scenario))

    def _reset_arm(self, client: int) -> str:
        return self._anew(client, cmd.ResetArm())

    def _anew(self, client: int, command: cmd.Command) -> str:
        """What puts the arm elsewhere; without a robot the runner builds a new one."""
        if self.engine.status.state == "offline":
            event = self.engine.check(command, self._looked[client])
            self._build()
        else:
            event = self._command(client, command)
        self._still = (0, self.rig.q)
        return event

    def _mode(self, client: int) -> str:
        return self._command(client, cmd.SetMode("uvs"))

    def _setting(self, client: int) -> str:
        return self._command(client, cmd.SetServo("gain", float(self.rng.uniform(0.05, 0.9))))

    def _limits(self, client: int) -> str:
        return self._command(client, cmd.SetLimits("speed_rad_s", float(self.rng.uniform(0.1, 1.0))))

    def _robot_lost(self, client: int) -> str:
        """It may be back at once, after a while, or never."""
        self.rig.fail = RigOffline("made by the fuzzer")
        self._tick()
        if self.rng.random() < 0.7:
            self.rig.fail = None
        return "robot_lost"

    def _fail(self, client: int) -> str:
        self.engine.fail("internal_error", "made by the fuzzer")
        return "failed"

    def _hold(self, client: int) -> str:
        self.engine.hold("stalled")
        return "held"

    def _gate_fault(self, client: int) -> str:
        if hasattr(self.rig, "gate"):
            self.rig.gate.fault = "made by the fuzzer"
        self._tick()
        return "tick"

    def _driver_left(self, client: int) -> str:
        self.engine.stop("driver_left")
        return "driver_left"

    def _take_over(self, client: int) -> None:
        if not self.engine.moving:
            self.driver = client

    def _rebuild(self, client: int) -> str | None:
        """A task of another scene: a new engine in the place of this one, where the table allows loading."""
        self.engine.check(cmd.LoadTask(self._scenario), self._looked[client])
        self._build()
        return "load"

    def _build(self) -> None:
        self.rig = self._make_rig()
        fresh = Engine(self.rig, replace(self._scenario))
        fresh.resume(self.engine)
        self.engine = fresh
        self._still = (0, self.rig.q)

    # ---- the rules --------------------------------------------------------------------------------

    def _check(self, event: str | None, client: int, before: State, moved: bool, revision: int) -> None:
        after, moves = self.engine.status.state, self.engine.moving
        if moves != (after in MOVING_STATES):
            self._broke(f"the permit is {moves} in {after}")
        if moves and not moved:
            self.figures["started"] += 1
            if event != "start" or client != self.driver:
                self._broke(f"{event} by client {client} led into motion")
        if event in ("stop", "estop", "robot_lost", "driver_left") and moves:
            self._broke(f"{event} left the arm moving")
        if after not in self._allowed(event, before):
            self._broke(f"{event} led from {before} to {after}")
        if self.engine.revision < revision or (after != before and event not in ("edit", None) and
                                               self.engine.revision == revision):  # fmt: skip
            self._broke(f"the revision went from {revision} to {self.engine.revision} by {event}")
        if before == "estop" != after and event != "reset":
            self._broke(f"{event} left the emergency stop")
        if before == "fault" != after and event not in ("acknowledge", "estop", "robot_lost", "tick"):
            self._broke(f"{event} left the fault")

    def _allowed(self, event: str | None, before: State) -> tuple[State, ...]:
        if event in (None, "refused"):
            return (before,)
        if event != "tick":
            cell = states.TABLE[event][before]
            return () if isinstance(cell, str) else cell  # A refusal must have been raised.
        if before in MOVING_STATES:
            return (*_ENDS, "offline") if self.rig.fail is not None else _ENDS
        if self.rig.fail is not None:
            return ("offline",) if before != "estop" else ("estop",)
        cell = states.TABLE["robot_back"][before]
        assert not isinstance(cell, str)
        return cell

    def _broke(self, what: str) -> None:
        self.violations.append(f"{what} [after: {'; '.join(self.story[-6:])}]")


def run(seconds: float, seed: int) -> Report:
    """As many sequences as the time allows; each is told by its own seed."""
    end, tried, violations = time.monotonic() + seconds, 0, []
    figures: Mapping[str, int] = {"events": 0, "ticks": 0, "started": 0, "refused": 0}
    while time.monotonic() < end or tried == 0:
        mob = Mob(StickRig, stick_task(), seed + tried)
        for _ in range(int(mob.rng.integers(1, LONGEST + 1))):
            mob.event()
        violations += [f"seed {seed + tried}: {said}" for said in mob.violations]
        figures = {name: count + mob.figures[name] for name, count in figures.items()}
        tried += 1
    return Report("events", tried, "sequences of events", tuple(violations[:20]), dict(figures))
