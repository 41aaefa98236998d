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
from vita.runner import Runner


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


def test_close_ends_the_thread_and_the_rig_and_is_idempotent() -> None:
    before = threading.active_count()
    r = Runner(lambda s: PacedRig(), scenario())  # type: ignore[arg-type]
    r.submit(cmd.Start())
    r.close()
    r.close()
    assert rig_of(r).closed and threading.active_count() == before
    assert rig_of(r).commands[-1] is None
