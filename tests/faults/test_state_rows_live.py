"""Rows of the states that need the runner's threads: a controller that hangs or raises, a storm of faults,
and starts and stops by the hundred."""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from bench import row

from vita import commands as cmd
from vita.fuzz.stick_rig import StickRig, stick_task
from vita.logs import FILE_BYTES, FILES, OncePerSecond, keep_log
from vita.runner import Runner
from vita.types import JointStep, Observation
from vita.watchdog import HUNG_S


class Stick(StickRig):
    """The stick at 500 pictures a second, with the time of every motion taken down."""

    def __init__(self) -> None:
        super().__init__()
        self.closed = False

    def observe(self) -> Observation:
        time.sleep(0.002)
        return super().observe()

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def runner() -> Iterator[Runner]:
    r = Runner(lambda s: Stick(), stick_task())  # type: ignore[arg-type]
    yield r
    r.close()


def until(condition: Callable[[], object], r: Runner | None = None, seconds: float = 20.0) -> float:
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < seconds, f"it did not come: {r and r.snapshot().status}"
        time.sleep(0.002)
    return time.monotonic() - began


def state(r: Runner) -> str:
    return r.snapshot().status.state


def servoing(r: Runner) -> Stick:
    r.submit(cmd.Start())
    until(lambda: state(r) == "servoing")
    return r._engine.rig  # type: ignore[return-value]


@row("C14")
def test_a_controller_that_hangs_is_braked_by_the_gate_told_and_restarted_with_one_click(
    runner: Runner,
) -> None:
    rig = servoing(runner)
    runner.submit(cmd.Inject("C14"))
    until(lambda: runner._engine.phase == "servo" and runner._engine.tap.rows)
    took = until(lambda: state(runner) == "fault")
    assert took < HUNG_S + 1.0  # The machine may be busy; the watchdog itself counts 0.1 s.
    status = runner.snapshot().status
    assert status.reason == "controller_stopped" and "Restart" in status.message
    assert rig.gate_state()["stopped"]
    rig.observe()  # The gate lives in another process, in the app: its cycles go on, and brake within 18.
    rig.observe()
    rig.observe()
    q = rig.q
    assert rig.gate.at_rest
    runner.submit(cmd.ResetArm())
    until(lambda: state(runner) == "idle" and runner.rig_revision == 1)
    until(lambda: rig.closed)
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "done")
    np.testing.assert_array_equal(rig.q, q)
    assert runner.snapshot().injected == ()


@row("C14")
def test_a_controller_that_raises_is_a_fault_that_names_the_failure_and_can_be_acknowledged(
    runner: Runner,
) -> None:
    rig = servoing(runner)

    def fail(step: JointStep) -> JointStep:
        raise LookupError("made by the test")

    runner._engine.tap.step["C14"] = fail
    until(lambda: state(runner) == "fault")
    status = runner.snapshot().status
    assert status.reason == "internal_error" and "LookupError: made by the test" in status.message
    until(lambda: rig.gate.at_rest)
    runner.submit(cmd.Mend())
    runner.submit(cmd.Acknowledge())
    until(lambda: state(runner) == "idle")
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "done")


@row("C14")
def test_the_gates_lease_ends_motion_within_100_ms_when_commands_stay_away() -> None:
    """Counted in gate cycles of 1/240 s: 24 of the lease, 18 to brake."""
    rig = StickRig()
    rig.observe()
    for _ in range(10):
        rig.command(JointStep(np.array([0.5, -0.5, 0.5, 0, 0, 0, 0]), rig.q, rig._now))
        rig.observe()
    assert not rig.gate.at_rest
    cycles = 0
    while not rig.gate.at_rest:
        rig.q, _ = rig.gate.cycle(rig._now, rig.q)
        rig._cycles += 1
        cycles += 1
    fastest = 1.5 / 8.0 * 240  # From the stick's speed limit at 8 rad/s^2.
    assert cycles <= 24 + fastest


@row("U17")
def test_three_threads_that_press_stop_while_two_press_start_leave_the_arm_at_rest(runner: Runner) -> None:
    rig = servoing(runner)
    seen = runner.snapshot().revision
    presses = [lambda: runner.submit(cmd.Start(), seen)] * 2 + [runner.stop] * 3
    threads = [threading.Thread(target=press) for press in presses]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    until(lambda: state(runner) == "hold")
    until(lambda: rig.gate.at_rest)
    q, tick = rig.q, runner.snapshot().tick
    until(lambda: runner.snapshot().tick > tick + 10)
    np.testing.assert_array_equal(rig.q, q)
    runner.submit(cmd.Start(), runner.snapshot().revision)
    until(lambda: state(runner) == "done")


@row("Q2")
def test_a_storm_of_faults_is_a_line_a_second_with_one_traceback_and_ends_when_it_is_mended(
    runner: Runner, caplog
) -> None:
    servoing(runner)
    caplog.clear()
    runner.submit(cmd.Inject("Q2"))
    until(lambda: state(runner) == "fault")
    began = time.monotonic()
    time.sleep(2.2)
    lasted = time.monotonic() - began
    lines = [record for record in caplog.records if "the control loop failed" in record.message]
    assert 2 <= len(lines) <= lasted + 2
    assert [bool(record.exc_info) for record in lines] == [True] + [False] * (len(lines) - 1)
    assert "more)" in lines[-1].message and "ArithmeticError" in lines[-1].message
    runner.submit(cmd.Mend())
    runner.submit(cmd.Acknowledge())
    until(lambda: state(runner) == "idle")
    runner.submit(cmd.Start())
    until(lambda: state(runner) == "done")


@row("Q2")
def test_a_storm_that_goes_on_fills_three_files_and_no_more(tmp_path: Path) -> None:
    now = [0.0]
    handler = keep_log(tmp_path)
    log = logging.getLogger("vita.storm")
    try:
        handler.filters[:] = [OncePerSecond(lambda: now[0])]
        handler.maxBytes = 3000  # type: ignore[attr-defined]
        logging.getLogger("vita").propagate = False  # Or the report of a failure would be a storm, too.
        for i in range(900):
            now[0] = float(i)
            for _ in range(20):
                log.error("the same again")
            log.error("another kind")
        assert len(list(tmp_path.iterdir())) == FILES
        assert all(path.stat().st_size <= 3000 for path in tmp_path.iterdir())
        newest = (tmp_path / "vita.log").read_text().splitlines()
        assert sum("the same again (and 19 more)" in line for line in newest) >= 1
    finally:
        logging.getLogger("vita").propagate = True
        logging.getLogger("vita").removeHandler(handler)
        handler.close()
    assert FILE_BYTES == 10_000_000


def resources() -> dict[str, int]:
    """What may not grow: threads, open files, child processes."""
    children = sum(len(Path(f).read_text().split()) for f in Path("/proc/self/task").glob("*/children"))
    fds = len(os.listdir("/proc/self/fd"))
    return {"threads": threading.active_count(), "fds": fds, "children": children}


@row("Q3")
@pytest.mark.skipif(sys.platform != "linux", reason="counts what Linux shows of a process")
def test_five_hundred_starts_stops_and_faults_leave_threads_files_and_children_as_they_were(
    tmp_path: Path,
) -> None:
    before = resources()
    r = Runner(lambda s: StickRig(), stick_task(), tmp_path)  # type: ignore[arg-type]
    running = resources()
    try:
        for i in range(500):
            r.submit(cmd.Start())
            until(lambda: state(r) == "learning")
            if i % 10 == 9:
                r._engine.tap.step["x"] = lambda step: 1 / 0  # type: ignore[assignment,return-value]
                until(lambda: state(r) == "fault")
                r._engine.tap.mend()
                r.submit(cmd.Acknowledge())
            elif i % 50 == 25:
                r.estop()
                until(lambda: state(r) == "estop")
                r.submit(cmd.Reset(confirm=True))
            else:
                r.stop()
            until(lambda: state(r) in ("hold", "idle"), r)
        until(lambda: resources() == running)
    finally:
        r.close()
    until(lambda: resources() == before)
