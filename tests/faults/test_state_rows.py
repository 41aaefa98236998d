"""Rows of the states: what is refused, what is pressed at the wrong moment, and a clock that is set back."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from bench import Bench, row

import vita
from vita import commands as cmd
from vita.engine import Engine
from vita.errors import BadInput, NotNow
from vita.fuzz.stick_rig import StickRig, stick_task
from vita.types import JointStep

CLOCKS = {"time", "time_ns", "localtime", "gmtime", "ctime", "strftime", "now", "utcnow", "today"}
"""What tells the time of day, of `time` and `datetime`."""


class StickBench(Bench):
    """With the real engine, servo and gate, and an arm and cameras that cost next to nothing."""

    def __init__(self) -> None:
        self.rig = StickRig()  # type: ignore[assignment]
        self.engine = Engine(self.rig, stick_task())


@pytest.fixture
def bench() -> Bench:
    return StickBench()


def still(bench: Bench, ticks: int = 5) -> None:
    """Nothing is commanded and nothing moves."""
    q = bench.tick().q
    for _ in range(ticks):
        assert bench.engine.last_step is None
        np.testing.assert_allclose(bench.tick().q, q, atol=1e-5)


@row("T1")
def test_start_without_a_constraint_is_refused_and_the_task_is_as_it_was(bench: Bench) -> None:
    before = bench.tick()
    with pytest.raises(BadInput, match="there is no constraint yet: pick a kind"):
        bench.inject("T1")
    after = bench.tick()
    assert after.status == before.status and after.scenario.constraint == before.scenario.constraint
    still(bench)
    bench.engine.apply(cmd.ClearTask())
    with pytest.raises(BadInput, match="no constraint yet"):
        bench.engine.apply(cmd.Start())
    bench.engine.apply(cmd.Undo())  # It recovers by drawing one.
    bench.start()
    bench.until("done")


@row("T11")
def test_edits_and_loading_are_refused_while_the_arm_moves_and_the_motion_goes_on(bench: Bench) -> None:
    with pytest.raises(BadInput, match="press Start first"):
        bench.inject("T11")
    task = bench.start().scenario
    with pytest.raises(BadInput, match="stop the arm first; a task cannot be edited while it moves"):
        bench.inject("T11")
    for command, words in ((cmd.LoadTask(task), "then open the task"), (cmd.ResetArm(), "stop the arm first"),
                           (cmd.SetMode("uvs"), "the mode cannot be changed")):  # fmt: skip
        with pytest.raises(NotNow, match=words):
            bench.engine.apply(command)
    after = bench.tick()
    assert after.status.state == "servoing" and after.scenario.constraint == task.constraint
    bench.engine.apply(cmd.Halt())
    bench.engine.apply(cmd.SetWeight(task.constraint[0].name, 2.0))
    assert bench.tick().status.state == "idle"


@row("U18")
def test_a_start_from_before_a_stop_is_dropped_and_a_new_one_is_taken(bench: Bench) -> None:
    bench.start()
    with pytest.raises(BadInput, match="held meanwhile"):
        bench.inject("U18")
    assert bench.tick().status.reason == "stopped_by_user"
    bench.rests_after()
    with pytest.raises(BadInput, match="held meanwhile"):
        bench.inject("U18")  # Also where nothing moved.
    still(bench)
    bench.engine.apply(cmd.Start(), bench.tick().revision)
    bench.until("done")


@row("U17")
def test_starts_and_stops_by_everybody_at_once_are_one_stop(bench: Bench) -> None:
    with pytest.raises(BadInput, match="press Start first"):
        bench.inject("U17")
    bench.start()
    bench.inject("U17")
    assert bench.tick().status.reason == "stopped_by_user"
    bench.rests_after()
    events = [e.text for e in bench.engine.ring.take()[1] if e.kind == "state"]
    assert events == ["idle -> learning", "learning -> servoing", "servoing -> hold"]
    bench.engine.apply(cmd.Start())
    bench.until("done")


@row("C15")
def test_a_clock_on_the_wall_that_is_set_back_changes_not_a_bit_of_the_motion() -> None:
    def motion(set_back: bool) -> tuple[list[np.ndarray], list[JointStep | None]]:
        tried = StickBench()
        try:
            tried.start()
            if set_back:
                tried.inject("C15")
            seen = [(tried.tick().q, tried.engine.last_step) for _ in range(15)]
            assert tried.engine.status.state == "servoing"
            return [q for q, _ in seen], [step for _, step in seen]
        finally:
            tried.engine.apply(cmd.Mend())
            tried.close()

    (q, steps), (q_back, steps_back) = motion(False), motion(True)
    np.testing.assert_array_equal(q, q_back)
    np.testing.assert_array_equal([s.dq for s in steps], [s.dq for s in steps_back])  # type: ignore[union-attr]


def test_nothing_reads_the_clock_on_the_wall() -> None:
    """But for the age of files on the disk, and the fault itself."""
    root, found = Path(vita.__file__).parent, []
    for path in root.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            of_time = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
            if of_time and node.value.id in ("time", "datetime", "date") and node.attr in CLOCKS:  # type: ignore
                found.append(str(path.relative_to(root)))
            elif isinstance(node, ast.ImportFrom) and node.module in ("time", "datetime"):
                found += [str(path.relative_to(root))] * bool(CLOCKS & {name.name for name in node.names})
    assert set(found) == {"faults/control.py", "scenario/disk.py"}
