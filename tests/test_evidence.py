"""Laws of the evidence: what a fault leaves is what was seen and done, and the servo would do it again."""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sim_rig import KinematicRig
from sim_rig import scenario as three_joints

import vita
from vita import commands as cmd
from vita.data import faults_folder, tasks_folder
from vita.engine import Engine
from vita.errors import BadInput, NotNow, RigOffline
from vita.evidence import FILES, PENDING, TICKS, EvidenceFiles, Ring, recorded
from vita.runner import Runner
from vita.scenario.headless import run_scenario
from vita.scenario.record import RunRecord
from vita.scenario.replay import replay
from vita.scenario.rerun import rerun
from vita.scenario.schema import Scenario, ScriptSpec
from vita.types import Array, Joint, Status


class SevenRig(KinematicRig):
    """With as many joints as the robot that its scenario names, or no file could hold it."""

    def __init__(self) -> None:
        super().__init__()
        self.joints = self.robot_joints = tuple(Joint(f"j{i}", -2.5, 2.5, 1.5) for i in range(7))
        self.q = np.array([0.3, 0.5, -0.4, 0.0, 0.0, 0.0, 0.0])

    def hand(self) -> Array:
        a = np.cumsum(self.q[:3])
        return np.array([np.cos(a).sum(), np.sin(a).sum(), 0.8 * np.sin(a[0] - a[2])])


def scenario() -> Scenario:
    task = three_joints()
    q0 = (*np.rad2deg([0.3, 0.5, -0.4]).tolist(), 0.0, 0.0, 0.0, 0.0)
    servo = replace(task.servo, joints=(0, 1, 2))
    return replace(task, scene=replace(task.scene, q0_deg=q0), servo=servo)


def engine() -> Engine:
    return Engine(SevenRig(), scenario())  # type: ignore[arg-type]


def until(condition: Callable[[], object], seconds: float = 10.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.005)


def failed(e: Engine, ticks: int) -> RunRecord:
    """The recording of an engine that starts, works for a while, and fails."""
    e.apply(cmd.Start())
    for _ in range(ticks):
        e.tick()
    e.fail("diverged", "")
    assert e.revision
    record = recorded(*e.ring.take(), e.status, "x")
    assert record is not None
    return record


def test_the_recording_of_a_fault_is_what_was_seen_and_commanded_tick_by_tick() -> None:
    e, seen = engine(), []
    e.apply(cmd.Start())
    for _ in range(40):
        snapshot = e.tick()
        seen.append((snapshot, e.last_step, e.observation.number))
    e.fail("diverged", "")
    record = recorded(*e.ring.take(), e.status, "x")
    assert record is not None and record.ticks == 40 and record.outcome == "fault"
    for i, (snapshot, step, number) in enumerate(seen):
        np.testing.assert_array_equal(record.q[i], snapshot.q)
        np.testing.assert_array_equal(record.error[i], snapshot.error.values)
        np.testing.assert_array_equal(record.command[i], np.zeros(7) if step is None else step.dq)
        np.testing.assert_array_equal(
            record.uv[i], np.array([snapshot.features[name].uv for name in record.trackers])
        )
        assert record.state[i] == snapshot.status.state and record.series["frame"][i] == number
        assert record.stamp[i] == snapshot.stamp
    assert record.seen.all() and record.joints == tuple(e.rig.joints)


def test_only_the_last_ten_seconds_are_kept_and_no_picture() -> None:
    e = engine()
    for _ in range(TICKS + 50):
        e.tick()
    ticks, _ = e.ring.take()
    assert len(ticks) == TICKS and ticks[-1].stamp - ticks[0].stamp == pytest.approx((TICKS - 1) / 30)
    assert not any(getattr(ticks[0], name) is e.observation.frames for name in ticks[0].__slots__)


def test_state_changes_commands_refusals_and_notices_are_among_the_events() -> None:
    e = engine()
    record = failed(e, 20)
    with pytest.raises(NotNow):
        e.apply(cmd.Start())
    e.say("look here", "warning")
    e.apply(cmd.Acknowledge())
    assert e.revision
    record = recorded(*e.ring.take(), e.status, "x")
    assert record is not None
    kinds = {(event["kind"], event["text"]) for event in record.events}
    assert ("command", "Start(relearn=True)") in kinds and ("refused", "Start(relearn=True)") in kinds
    assert ("state", "idle -> learning") in kinds and ("state", "fault -> idle") in kinds
    assert ("notice", "look here") in kinds
    refusal = next(event for event in record.events if event["kind"] == "refused")
    assert "acknowledge" in refusal["message"]


def test_rows_and_trackers_that_came_and_went_leave_gaps_not_errors() -> None:
    e = engine()
    for _ in range(5):
        e.tick()
    e.apply(cmd.DeleteConstraint("meet left"))
    e.apply(cmd.AddTracker("left", (300.0, 200.0), "fixed", "extra"))
    for _ in range(5):
        e.tick()
    record = recorded(*e.ring.take(), e.status, "x")
    assert record is not None and {label.constraint for label in record.labels} == {"meet right"}
    assert np.isfinite(record.error).all()
    extra = record.trackers.index("extra")
    assert np.isnan(record.uv[:5, extra]).all() and np.isfinite(record.uv[5:, extra]).all()


def test_a_recording_with_events_loads_back_identical_and_from_one_file_alone(tmp_path: Path) -> None:
    record = failed(engine(), 30)
    record.save(tmp_path, "x", plot=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.json", "x.npz"]
    for remove in (False, True):
        if remove:
            (tmp_path / "x.json").unlink()
        again = RunRecord.load(tmp_path / "x.npz")
        assert again.events == record.events and again.joints == record.joints
        np.testing.assert_array_equal(again.command, record.command)


def test_a_recording_of_before_there_were_events_still_loads(tmp_path: Path) -> None:
    failed(engine(), 3).save(tmp_path, "x", plot=False)
    story = json.loads((tmp_path / "x.json").read_text())
    del story["events"], story["joints"]
    (tmp_path / "x.json").write_text(json.dumps(story))
    again = RunRecord.load(tmp_path / "x")
    assert again.events == () and again.joints == ()
    assert "older version" in rerun(again).why_not


# ---- files ------------------------------------------------------------------------------------------


def test_every_fault_leaves_a_file_that_the_snapshot_names(tmp_path: Path) -> None:
    class Paced(SevenRig):
        def observe(self):
            time.sleep(0.002)
            return super().observe()

    rig = Paced()
    before = threading.active_count()
    r = Runner(lambda s: rig, scenario(), tmp_path)  # type: ignore[arg-type]
    try:
        r.submit(cmd.Start())
        until(lambda: r.snapshot().status.state == "servoing")
        rig.fail = ZeroDivisionError("made by the test")
        until(lambda: r.snapshot().evidence)
        assert Path(r.snapshot().evidence).name == "000001-internal_error.npz"
        record = RunRecord.load(r.snapshot().evidence)
        assert record.reason == "internal_error" and "servoing" in record.state
        rig.fail = RigOffline("gone")
        until(lambda: "rig_offline" in r.snapshot().evidence)
        rig.fail = None
        r.estop()
        until(lambda: "000003-estop" in r.snapshot().evidence)
        until(lambda: threading.active_count() == before + 2)  # The runner's two; no writer is left.
    finally:
        r.close()


def test_the_oldest_files_go_and_what_is_not_ours_stays(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    for number in range(1, FILES + 10):
        (tmp_path / f"{number:06d}-diverged.npz").write_bytes(b"")
        (tmp_path / f"{number:06d}-diverged.json").write_text("")
    ring, written = engine().ring, []
    e = engine()
    e.tick()
    ring = e.ring
    EvidenceFiles(tmp_path).write(ring, Status("fault", "diverged", ""), written.append)
    until(lambda: written and len(list(tmp_path.glob("*.npz"))) == FILES)
    numbers = sorted(int(re.match(r"\d+", path.name)[0]) for path in tmp_path.glob("*.npz"))  # type: ignore[index]
    assert numbers == list(range(11, FILES + 11)) and (tmp_path / "notes.txt").exists()
    until(lambda: len(list(tmp_path.glob("*.json"))) == FILES)


def test_a_folder_that_cannot_be_written_is_a_line_in_the_log_and_no_more(tmp_path: Path, caplog) -> None:
    (tmp_path / "file").write_text("")
    e = engine()
    e.tick()
    files = EvidenceFiles(tmp_path / "file" / "sub")
    files.write(e.ring, Status("fault", "diverged", ""), lambda path: pytest.fail("it was written"))
    until(lambda: "was not written" in caplog.text)
    until(lambda: not files._busy)


def test_a_storm_of_faults_neither_waits_nor_piles_up(tmp_path: Path) -> None:
    go = threading.Event()

    class Slow(EvidenceFiles):
        def _save(self, *arguments: object) -> None:
            go.wait(5)

    e = engine()
    e.tick()
    files = Slow(tmp_path)
    began = time.perf_counter()
    for _ in range(1000):
        files.write(e.ring, e.status, lambda path: None)
    assert time.perf_counter() - began < 2.0 and len(files._jobs) <= PENDING
    go.set()
    until(lambda: not files._busy)


def test_the_folders_follow_the_environment(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setenv("VITA_DATA", str(tmp_path))
    assert tasks_folder() == tmp_path and faults_folder() == tmp_path / "faults"
    monkeypatch.delenv("VITA_DATA")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert tasks_folder() == tmp_path / "vita" / "tasks" and faults_folder() == tmp_path / "vita" / "faults"


def test_an_empty_ring_leaves_no_file() -> None:
    assert recorded(*Ring().take(), Status(), "x") is None


# ---- replay -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run() -> RunRecord:
    return run_scenario(scenario(), rig=SevenRig())  # type: ignore[arg-type]


def test_the_servo_run_again_on_a_shipped_task_makes_every_step_again_to_the_bit(tmp_path: Path) -> None:
    vita.run("point_to_point").save(tmp_path, "run", plot=False)
    again = rerun(RunRecord.load(tmp_path / "run"))
    assert again.identical and again.ticks > 40 and not again.outside


def test_the_servo_run_again_on_a_recording_makes_every_step_again_to_the_bit(
    run: RunRecord, tmp_path: Path
) -> None:
    run.save(tmp_path, "run", plot=False)
    again = rerun(RunRecord.load(tmp_path / "run"))
    moving = sum(state in ("learning", "servoing") for state in run.state)
    assert again.identical and again.ticks >= moving > 20 and not again.outside


def test_one_bit_of_what_was_seen_is_noticed(run: RunRecord) -> None:
    error, middle = run.error.copy(), run.state.index("servoing")
    error[middle, 0] = np.nextafter(error[middle, 0], np.inf)
    again = rerun(replace(run, error=error))
    assert not again.identical and again.different[0] in (middle, middle + 1)


def test_one_bit_of_what_was_commanded_is_noticed(run: RunRecord) -> None:
    command, middle = run.command.copy(), run.state.index("servoing")
    command[middle, 0] = np.nextafter(command[middle, 0], np.inf)
    assert rerun(replace(run, command=command)).different == (middle,)


def test_settings_that_the_script_changes_and_stops_and_starts_are_replayed(tmp_path: Path) -> None:
    script = (
        ScriptSpec(0.0, "start"), ScriptSpec(0.6, "set", {"field": "servo.gain", "value": 0.1}),
        ScriptSpec(0.9, "stop"), ScriptSpec(1.2, "start"),
    )  # fmt: skip
    record = run_scenario(replace(scenario(), script=script), rig=SevenRig())  # type: ignore[arg-type]
    again = rerun(record)
    assert again.identical and [state for _, state in again.outside] == ["hold"]
    # Without the setting the steps are others: it is not a coincidence.
    assert not rerun(replace(record, scenario=replace(record.scenario, script=()))).identical


def test_evidence_with_its_start_in_it_is_run_again_too() -> None:
    record = failed(engine(), 60)
    again = rerun(record)
    assert again.identical and again.ticks >= 30


def test_what_cannot_be_run_again_says_why(run: RunRecord) -> None:
    e = engine()
    for _ in range(20):
        e.tick()
    record = recorded(*e.ring.take(), e.status, "x")
    assert record is not None and "no Start" in rerun(record).why_not
    e.apply(cmd.Start())
    e.tick()
    e.apply(cmd.SetServo("gain", 0.1))
    record = recorded(*e.ring.take(), e.status, "x")
    assert record is not None and "settings" in rerun(record).why_not
    assert "pictures" in rerun(replace(run, scenario=replace(run.scenario, mode="impedance"))).why_not


def test_replay_tells_the_story_in_text_and_in_json(tmp_path: Path, capsys) -> None:
    e = engine()
    e.apply(cmd.Perform("lose_tracker", {"tracker": "tip_left", "for_s": 0.1}))
    for _ in range(6):
        e.tick()
    record = failed(e, 40)
    record.save(tmp_path, "x", plot=False)
    assert replay(tmp_path / "x.npz", out=tmp_path / "out") == 0
    text = capsys.readouterr().out
    assert "fault (diverged)" in text and "learning -> servoing" in text and "command: Start" in text
    assert "the same to the bit" in text and "tip_left" in text
    assert (tmp_path / "out" / "x.png").stat().st_size > 1000
    table = (tmp_path / "out" / "x.csv").read_text().splitlines()
    assert len(table) == record.ticks + 1 and "error_px" in table[0]
    assert replay(tmp_path / "x.npz", as_json=True) == 0
    story = json.loads(capsys.readouterr().out)
    assert story["replayed"]["identical"] is True and story["reason"] == "diverged"
    assert {event["kind"] for event in story["events"]} >= {"state", "command"}


def test_replay_fails_when_the_servo_would_do_something_else(run: RunRecord, tmp_path: Path, capsys) -> None:
    command = run.command.copy()
    command[run.state.index("servoing")] *= 1.0001
    replace(run, command=command).save(tmp_path, "x", plot=False)
    assert replay(tmp_path / "x") == 1
    assert "1 of" in capsys.readouterr().out
    with pytest.raises(BadInput):
        replay(tmp_path / "nothing")
