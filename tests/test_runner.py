"""Laws of the runner: one thread, commands in, snapshots out, Stop before everything."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import cast

import numpy as np
import pytest
from sim_rig import KinematicRig, scenario

from vita import commands as cmd
from vita.errors import RigLate, RigOffline
from vita.runner import MAX_QUEUE, Runner
from vita.scenario.schema import Scenario


class PacedRig(KinematicRig):
    """A kinematic rig at 500 frames a second, so that threads get their turn."""

    def observe(self):
        time.sleep(0.002)
        return super().observe()


@pytest.fixture
def runner():
    r = Runner(lambda s: PacedRig(), scenario())  # type: ignore[arg-type]
    yield r
    r.close()


def until(condition: Callable[[], bool], seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the awaited state did not come"
        time.sleep(0.002)


def state(runner: Runner) -> str:
    return runner.snapshot().status.state


def rig_of(runner: Runner) -> PacedRig:
    return cast(PacedRig, runner._engine.rig)


def rest(runner: Runner) -> None:
    tick = runner.snapshot().tick
    until(lambda: runner.snapshot().tick > tick + 3)


def test_snapshots_grow_and_the_latest_wins(runner: Runner) -> None:
    first = runner.snapshot().tick
    newer = runner.wait_newer(first, 2.0)
    assert newer is not None and newer.tick > first


def test_start_runs_to_done(runner: Runner) -> None:
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "done")
    assert runner.snapshot().error.largest <= 0.5


def test_stop_in_the_middle_of_exploration_rests_the_arm(runner: Runner) -> None:
    runner.submit(cmd.Start())
    until(lambda: "2 of 3" in runner.snapshot().progress)
    runner.stop()
    until(lambda: state(runner) == "hold")
    rest(runner)
    q = runner.snapshot().q
    rest(runner)
    np.testing.assert_array_equal(runner.snapshot().q, q)


def test_a_start_that_was_queued_before_a_stop_is_dropped(runner: Runner) -> None:
    rig = rig_of(runner)
    gate = threading.Event()
    observe = rig.observe
    rig.observe = lambda: (gate.wait(5), observe())[1]  # type: ignore[method-assign]
    time.sleep(0.05)
    runner.submit(cmd.Start())
    runner.stop()
    gate.set()
    rest(runner)
    assert state(runner) == "idle"


def test_stop_from_many_threads_at_once_is_one_stop(runner: Runner) -> None:
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "servoing")
    threads = [threading.Thread(target=runner.stop) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    until(lambda: state(runner) == "hold")
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "done")


def test_a_refused_command_becomes_a_notice_and_the_loop_goes_on(runner: Runner) -> None:
    runner.submit(cmd.DeleteTracker("nobody"))
    until(lambda: bool(runner.snapshot().notices))
    notice = runner.snapshot().notices[-1]
    assert "unknown tracker 'nobody'" in notice.text and notice.level == "warning"
    tick = runner.snapshot().tick
    until(lambda: runner.snapshot().tick > tick)


def test_an_exception_in_the_loop_is_a_fault_that_rests_the_arm_and_can_be_left(runner: Runner) -> None:
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "servoing")
    rig = rig_of(runner)
    rig.fail = ZeroDivisionError("broken on purpose")
    until(lambda: state(runner) == "fault")
    assert "broken on purpose" in runner.snapshot().status.message
    assert rig.commands[-1] is None
    rig.fail = None
    runner.submit(cmd.Start())
    until(lambda: any("acknowledge" in n.text for n in runner.snapshot().notices))
    assert state(runner) == "fault"
    runner.submit(cmd.Acknowledge())
    until(lambda: state(runner) == "idle")
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "done")


def test_a_rig_that_is_gone_is_offline_and_one_command_restarts_it(runner: Runner) -> None:
    rig_of(runner).fail = RigOffline("the simulation ended")
    until(lambda: state(runner) == "offline")
    assert "the simulation ended" in runner.snapshot().status.message
    old, revision = rig_of(runner), runner.rig_revision
    runner.submit(cmd.ResetArm())
    until(lambda: state(runner) == "idle")
    assert old.closed and runner.rig_revision == revision + 1
    assert len(runner.snapshot().scenario.constraint) == 2
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "done")


def test_what_is_injected_is_told_also_while_every_period_fails_so_that_it_can_be_mended(
    runner: Runner,
) -> None:
    runner.submit(cmd.Inject("Q2"))
    until(lambda: state(runner) == "fault" and runner.snapshot().injected == ("Q2",))
    runner.submit(cmd.Mend())
    until(lambda: runner.snapshot().injected == ())
    runner.submit(cmd.Acknowledge())
    until(lambda: state(runner) == "idle")


def test_building_a_rig_anew_takes_what_it_takes_and_is_no_hanging_controller(monkeypatch) -> None:
    """A simulation may need seconds to start: the watchdog counts periods, not restarts."""
    monkeypatch.setattr("vita.watchdog.WAIT_S", 0.1)
    made: list[PacedRig] = []

    def slowly(_: Scenario) -> PacedRig:
        if made:
            time.sleep(0.8)
        made.append(PacedRig())
        return made[-1]

    runner = Runner(slowly, scenario())
    try:
        made[0].fail = RigOffline("the simulation ended")
        until(lambda: state(runner) == "offline")
        runner.submit(cmd.ResetArm())
        seen = set()
        while state(runner) != "idle":
            seen.add(state(runner))
            time.sleep(0.01)
        assert seen == {"offline"} and len(made) == 2
    finally:
        runner.close()


def test_a_rig_that_is_late_holds_the_arm_and_comes_back_by_itself(runner: Runner) -> None:
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "servoing")
    rig = rig_of(runner)
    rig.fail = RigLate("no picture for 1 s")
    until(lambda: state(runner) == "hold")
    assert runner.snapshot().status.reason == "images_late" and rig.commands[-1] is None
    rig.fail = None
    rest(runner)
    assert state(runner) == "hold", "it must not move again by itself"
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "done")


def test_a_rig_that_stays_silent_is_offline_until_it_is_back(runner: Runner, monkeypatch) -> None:
    monkeypatch.setattr("vita.runner.OFFLINE_AFTER_S", 0.1)
    rig = rig_of(runner)
    rig.fail = RigLate("no picture for 1 s")
    until(lambda: state(runner) == "offline")
    rig.fail = None
    until(lambda: state(runner) == "hold")


def test_the_tick_count_never_goes_back_over_a_restart(runner: Runner) -> None:
    until(lambda: runner.snapshot().tick > 20)
    tick = runner.snapshot().tick
    rig_of(runner).fail = RigOffline("gone")
    until(lambda: state(runner) == "offline")
    runner.submit(cmd.ResetArm())
    until(lambda: state(runner) == "idle")
    assert runner.snapshot().tick > tick


def test_a_rig_that_is_late_is_told_with_its_milliseconds_and_is_offline_after_a_second(
    runner: Runner, monkeypatch
) -> None:
    now = [0.0]
    monkeypatch.setattr("vita.runner.time", Clock(now))
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "servoing")
    waited = iter([0.25])

    def late():
        """A quarter of a second passes within the wait, once."""
        now[0] += next(waited, 0.0)
        raise RigLate("no picture for 0.25 s")

    monkeypatch.setattr(rig_of(runner), "observe", late)
    until(lambda: state(runner) == "hold")
    assert "(250 ms)" in runner.snapshot().status.message
    now[0] = 0.99
    rest(runner)
    assert state(runner) == "hold"
    now[0] = 1.01
    until(lambda: state(runner) == "offline")
    monkeypatch.delattr(rig_of(runner), "observe")
    until(lambda: state(runner) == "hold")


class Clock:
    """A monotonic clock that is set by hand."""

    def __init__(self, now: list[float]) -> None:
        self.monotonic = lambda: now[0]


# ---- who presses what, when ------------------------------------------------------------------------


def told(runner: Runner, text: str) -> Callable[[], bool]:
    return lambda: any(text in notice.text for notice in runner.snapshot().notices)


def test_a_click_on_an_older_revision_is_dropped_with_a_notice_and_a_setting_is_not(runner: Runner) -> None:
    old = runner.snapshot().revision
    runner.stop()
    until(lambda: runner.snapshot().revision > old)
    for command in (cmd.Start(), cmd.ClearTask(), cmd.ResetArm(), cmd.LoadTask(scenario())):
        runner.submit(command, old)
    runner.submit(cmd.SetServo("gain", 0.21), old)
    until(told(runner, "held meanwhile"))
    until(lambda: runner.snapshot().scenario.servo.gain == 0.21)
    assert state(runner) == "idle" and len(runner.snapshot().scenario.constraint) == 2
    assert runner.rig_revision == 0
    runner.submit(cmd.Start(), runner.snapshot().revision)
    until(lambda: state(runner) == "done")


def test_two_starts_within_ten_milliseconds_are_one(runner: Runner) -> None:
    revision = runner.snapshot().revision
    runner.submit(cmd.Start(), revision)
    runner.submit(cmd.Start(), revision)
    until(lambda: state(runner) == "done")
    events = [e for e in runner._engine.ring.take()[1] if e.kind == "state" and "-> learning" in e.text]
    assert len(events) == 1 and not told(runner, "held meanwhile")()


def test_the_queue_is_bounded_and_stop_goes_around_it(runner: Runner) -> None:
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "learning")
    rig = rig_of(runner)
    gate, observe = threading.Event(), rig.observe
    rig.observe = lambda: (gate.wait(5), observe())[1]  # type: ignore[method-assign]
    time.sleep(0.01)
    for _ in range(1000):
        runner.submit(cmd.SetServo("gain", 0.2))
    assert len(runner._queue) == MAX_QUEUE
    runner.stop()
    assert rig.stopped, "the gate is latched before anything in the queue is looked at"
    gate.set()
    until(lambda: state(runner) == "hold")


# ---- the emergency stop ------------------------------------------------------------------------------


def stuck(runner: Runner) -> tuple[PacedRig, threading.Event]:
    """A runner whose thread waits in the rig, and what lets it go on."""
    rig, free = rig_of(runner), threading.Event()
    command = rig.command
    rig.command = lambda step: (free.wait(20), command(step))[1]  # type: ignore[method-assign]
    until(lambda: runner._engine.phase == "servo")
    return rig, free


def test_an_emergency_stop_is_said_at_once_though_the_thread_hangs_and_is_latched(runner: Runner) -> None:
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "learning")
    rig, free = stuck(runner)
    runner.estop("pressed by the test")
    assert state(runner) == "estop" and "pressed by the test" in runner.snapshot().status.message
    assert rig.stopped
    free.set()
    rest(runner)
    assert state(runner) == "estop"
    runner.submit(cmd.Start())
    until(told(runner, "press Reset and confirm"))
    runner.submit(cmd.Reset(confirm=True))
    until(lambda: state(runner) == "idle")
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "done")


def test_an_emergency_stop_outlives_a_lost_rig_and_a_rebuild(runner: Runner) -> None:
    rig_of(runner).fail = RigOffline("the simulation ended")
    until(lambda: state(runner) == "offline")
    runner.estop()
    assert state(runner) == "estop"
    runner.submit(cmd.ResetArm())
    until(told(runner, "press Reset and confirm"))
    assert state(runner) == "estop" and runner.rig_revision == 0
    runner.submit(cmd.Reset(confirm=True))
    until(lambda: state(runner) == "offline")
    runner.submit(cmd.ResetArm())
    until(lambda: state(runner) == "idle" and runner.rig_revision == 1)


def test_an_emergency_stop_during_a_rebuild_holds_the_new_rig_too() -> None:
    building, go = threading.Event(), threading.Event()

    def make(_: object) -> PacedRig:
        if building.is_set():
            go.wait(5)
        return PacedRig()

    r = Runner(make, scenario())  # type: ignore[arg-type]
    try:
        rig_of(r).fail = RigOffline("gone")
        until(lambda: state(r) == "offline")
        building.set()
        r.submit(cmd.ResetArm())
        until(lambda: not r._queue)
        r.estop()
        go.set()
        until(lambda: r.rig_revision == 1)
        rest(r)
        assert state(r) == "estop" and rig_of(r).stopped
    finally:
        go.set()
        r.close()


def test_a_reset_that_was_clicked_before_the_last_press_lifts_nothing(runner: Runner) -> None:
    runner.estop()
    until(lambda: runner._engine.status.state == "estop")
    rig = rig_of(runner)
    gate, observe = threading.Event(), rig.observe
    rig.observe = lambda: (gate.wait(5), observe())[1]  # type: ignore[method-assign]
    time.sleep(0.02)
    runner.submit(cmd.Reset(confirm=True))
    runner.estop()
    gate.set()
    rest(runner)
    assert state(runner) == "estop" and told(runner, "held meanwhile")()


def test_an_emergency_stop_pressed_while_a_reset_is_carried_out_stays(runner: Runner) -> None:
    runner.estop()
    until(lambda: runner._engine.status.state == "estop")
    apply, done = runner._engine.apply, threading.Event()

    def apply_and_be_pressed(command: cmd.Command, revision: int | None = None) -> None:
        apply(command, revision)
        if isinstance(command, cmd.Reset) and not done.is_set():
            runner.estop()  # Another thread, before the runner has forgotten the first press.
            done.set()

    runner._engine.apply = apply_and_be_pressed  # type: ignore[method-assign]
    runner.submit(cmd.Reset(confirm=True))
    until(done.is_set)
    rest(runner)
    assert state(runner) == "estop" and runner._engine.status.state == "estop"


def test_an_emergency_stop_pressed_from_ten_threads_while_it_is_reset_is_never_lost(runner: Runner) -> None:
    """Whatever the order: after the last press it is in force."""
    for _ in range(20):
        threads = [threading.Thread(target=runner.estop) for _ in range(10)]
        for thread in threads:
            thread.start()
        runner.submit(cmd.Reset(confirm=True))
        for thread in threads:
            thread.join()
        runner.estop()
        rest(runner)
        assert state(runner) == "estop" and runner._engine.status.state == "estop"
        runner.submit(cmd.Reset(confirm=True))
        until(lambda: state(runner) == "idle")


def test_a_stop_that_comes_while_a_start_is_carried_out_wins(runner: Runner) -> None:
    engine = runner._engine
    start = engine.servoing.start

    def start_and_be_stopped(command: cmd.Start) -> None:
        runner.stop()  # Another thread, between the look at the flags and the gate's release.
        start(command)

    engine.servoing.start = start_and_be_stopped  # type: ignore[method-assign]
    moved = len(rig_of(runner).commands)
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "hold")
    rest(runner)
    assert set(rig_of(runner).commands[moved:]) == {None}


# ---- a controller that hangs -------------------------------------------------------------------------


def test_a_controller_that_hangs_is_a_fault_that_restart_leaves_and_its_thread_touches_nothing(
    runner: Runner,
) -> None:
    threads, abandoned, put = threading.active_count(), runner._thread, runner._put
    publishers: list[threading.Thread] = []
    runner._put = lambda s: (publishers.append(threading.current_thread()), put(s))[1]  # type: ignore[method-assign]
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "servoing")
    rig, free = stuck(runner)
    began = time.monotonic()
    until(lambda: state(runner) == "fault")
    assert time.monotonic() - began < 1.0
    said = runner.snapshot().status
    assert said.reason == "controller_stopped" and "Restart" in said.message and rig.stopped
    assert "the next step" in said.message, "it says what the controller was doing"
    runner.submit(cmd.Acknowledge())
    until(told(runner, "press Restart first"))
    assert state(runner) == "fault"
    runner.submit(cmd.ResetArm())
    until(lambda: state(runner) == "idle")
    assert rig_of(runner) is not rig and runner.rig_revision == 1
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "servoing")
    commands = len(rig.commands)
    publishers.clear()
    free.set()
    until(lambda: state(runner) == "done" and not abandoned.is_alive())
    assert publishers and abandoned not in publishers
    until(lambda: rig.closed and threading.active_count() == threads)
    assert len(rig.commands) <= commands + 1 and rig.stopped
    assert runner._engine.rig is not rig, "the thread that came back has put nothing of its own in place"


def test_a_controller_that_comes_back_by_itself_stays_in_the_fault_until_it_is_left(runner: Runner) -> None:
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "servoing")
    rig, free = stuck(runner)
    until(lambda: state(runner) == "fault")
    free.set()
    rest(runner)
    q = runner.snapshot().q
    rest(runner)
    assert state(runner) == "fault" and runner.snapshot().status.reason == "controller_stopped"
    np.testing.assert_array_equal(runner.snapshot().q, q)
    runner.submit(cmd.Acknowledge())
    until(lambda: state(runner) == "idle")
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "done")


def test_restart_that_fails_says_why_and_can_be_tried_again() -> None:
    made: list[PacedRig] = []
    broken = [False]

    def make(_: object) -> PacedRig:
        if broken[0]:
            raise RigOffline("no simulation to be had")
        made.append(PacedRig())
        return made[-1]

    r = Runner(make, scenario())  # type: ignore[arg-type]
    try:
        r.submit(cmd.Start())
        until(lambda: state(r) == "servoing")
        _, free = stuck(r)
        until(lambda: state(r) == "fault")
        broken[0] = True
        r.submit(cmd.ResetArm())
        until(told(r, "no simulation to be had"))
        assert state(r) == "fault"
        broken[0] = False
        r.submit(cmd.ResetArm())
        until(lambda: state(r) == "idle")
    finally:
        free.set()
        r.close()


def test_closing_does_not_wait_for_a_controller_that_hangs() -> None:
    r = Runner(lambda s: PacedRig(), scenario())  # type: ignore[arg-type]
    r.submit(cmd.Start())
    until(lambda: state(r) == "servoing")
    rig, free = stuck(r)
    until(lambda: state(r) == "fault")
    began = time.monotonic()
    r.close()
    assert time.monotonic() - began < 2.0 and rig.closed
    free.set()


def test_close_ends_the_thread_and_the_rig_and_is_idempotent() -> None:
    before = threading.active_count()
    r = Runner(lambda s: PacedRig(), scenario())  # type: ignore[arg-type]
    r.submit(cmd.Start())
    r.close()
    r.close()
    assert rig_of(r).closed and threading.active_count() == before
    assert rig_of(r).commands[-1] is None
