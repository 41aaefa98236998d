"""The rows of the catalogue about the process that the arm is in, and the ways to stop it that no jammed app
blocks. Real processes and signals; one live simulation serves most of it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import Bench, bench, row, task  # noqa: F401

from vita import cli, doze, pace, stopping
from vita import commands as cmd
from vita.faults import robot
from vita.run_file import RunFile, run_folder, running
from vita.runner import Runner
from vita.scenario import toml_io
from vita.scenario.schema import Scenario
from vita.sim.live import LiveRig
from vita.sim.shared_frames import Flags, SharedFrames
from vita.types import MOVING_STATES, Status
from vita.ui import serving
from vita.ui.app import App
from vita.ui.ports import check_free

SPEED, ACCELERATION, PERIOD_S = 0.6, 8.0, 1 / 30
BRAKING_RAD = SPEED**2 / (2 * ACCELERATION)
REST_CYCLES = 18
LEASE_CYCLES = 24
SLACK_S = 0.5
"""What a machine that does other things as well may add to a bound [s]."""
ROOT = Path(__file__).resolve().parents[2]


class Live:
    """A runner with the simulation in its own process, and short words for what the tests do with it."""

    def __init__(self, scenario: Scenario) -> None:
        self.runner = Runner(lambda s: LiveRig(s), scenario)

    @property
    def rig(self) -> LiveRig:
        rig = self.runner._engine.rig
        assert isinstance(rig, LiveRig)
        return rig

    @property
    def shared(self) -> SharedFrames:
        return self.rig._shared

    @property
    def status(self) -> Status:
        return self.runner.snapshot().status

    @property
    def pid(self) -> int:
        assert self.rig.pid is not None
        return self.rig.pid

    def until(self, condition: Callable[[], bool] | str, seconds: float = 20.0) -> float:
        """Wait for a state or a condition; how long it took [s]."""
        reached = (lambda: self.status.state == condition) if isinstance(condition, str) else condition
        began = time.monotonic()
        while not reached():
            assert time.monotonic() < began + seconds, f"{condition} did not come: {self.status}"
            time.sleep(0.002)
        return time.monotonic() - began

    def submit(self, command: cmd.Command) -> None:
        self.runner.submit(command)

    def move(self) -> None:
        """Start from the scenario's pose, and wait until the arm really moves."""
        self.runner.stop()
        self.until(lambda: self.status.state not in MOVING_STATES)
        self.submit(cmd.ResetArm())
        self.until("idle")
        self.submit(cmd.Start())
        self.until(lambda: self.status.state in MOVING_STATES and not self.shared.at_rest)

    def newest(self) -> tuple[float, np.ndarray]:
        """Stamp [s] and joints [rad] of the newest frame, whether or not the runner has seen it."""
        while (seen := self.shared.read(len(self.rig.joints), self.rig._bodies)) is None:
            pass
        return seen.numbers["stamp"], np.array(seen.q)

    def frames(self, count: int) -> None:
        """Wait for so many observations."""
        tick = self.runner.snapshot().tick
        self.until(lambda: self.runner.snapshot().tick >= tick + count)

    def said(self, text: str) -> bool:
        return any(text in notice.text for notice in self.runner.snapshot().notices)

    def is_well(self) -> None:
        """It can be started anew from here, and moves."""
        self.move()
        self.runner.stop()
        self.until("hold")


@pytest.fixture(scope="module")
def one():
    live = Live(task())
    yield live
    live.runner.close()


@pytest.fixture
def live(one: Live) -> Live:
    """The same for every test, whatever the one before has left."""
    one.runner.stop()
    one.until(lambda: one.status.state not in MOVING_STATES)
    if one.status.state == "estop":
        one.submit(cmd.Reset(confirm=True))
        one.until(lambda: one.status.state != "estop")
    if one.status.state == "fault":
        one.submit(cmd.Acknowledge())
        one.until("idle")
    return one


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("VITA_DATA", str(tmp_path))
    return tmp_path


# ---- the process of the simulation ---------------------------------------------------------------------


@row("R1")
def test_a_killed_simulation_is_offline_within_100_ms_and_one_click_brings_it_back(live: Live) -> None:
    live.move()
    old, revision, process = live.pid, live.runner.rig_revision, live.rig._process
    live.submit(cmd.Inject("R1"))
    live.until(lambda: not process.is_alive())
    assert live.until("offline") <= 0.1 + SLACK_S
    assert live.status.reason == "rig_offline" and "has ended" in live.status.message
    assert "Restart" in live.status.message
    live.submit(cmd.Start())
    live.frames(2)
    assert live.status.state == "offline", "nothing restarts by itself, and Start is no restart"
    live.submit(cmd.ResetArm())
    live.until("idle")
    assert live.pid != old and live.runner.rig_revision == revision + 1
    live.is_well()


@row("R2")
def test_a_simulation_that_stands_still_for_300_ms_is_a_hold_without_a_burst(live: Live) -> None:
    live.move()
    os.kill(live.pid, signal.SIGSTOP)
    try:
        began = time.monotonic()
        _, q = live.newest()
        live.until("hold")
        assert live.status.reason == "images_late"
        time.sleep(max(0.0, began + 0.3 - time.monotonic()))
    finally:
        os.kill(live.pid, signal.SIGCONT)
    live.until(lambda: live.shared.at_rest)
    live.frames(6)
    # The joints were read up to a period before it stood still; from there on there is only braking.
    assert np.abs(live.newest()[1] - q).max() <= SPEED * PERIOD_S + BRAKING_RAD + 1e-3
    assert live.status.state == "hold", "it must not go on by itself"
    live.submit(cmd.Start())
    live.until(lambda: live.status.state in MOVING_STATES)


@row("R2")
def test_a_simulation_that_stands_still_for_long_is_offline_and_heals(live: Live, monkeypatch) -> None:
    monkeypatch.setattr(robot, "FREEZE_S", 1.8)
    live.move()
    live.submit(cmd.Inject("R2"))
    took = live.until("offline")
    assert took <= 1.8 + SLACK_S and "no sign of life" in live.status.message
    _, q = live.newest()
    live.until("hold")
    live.frames(6)
    assert np.abs(live.newest()[1] - q).max() <= SPEED * PERIOD_S + BRAKING_RAD + 1e-3
    assert not live.runner.snapshot().injected
    live.is_well()


@row("R3")
def test_a_slow_simulation_slows_the_arm_keeps_its_limits_and_says_so(live: Live, monkeypatch) -> None:
    monkeypatch.setattr(pace, "LOOKS", 3)
    live.move()
    live.submit(cmd.Inject("R3"))
    seen = [live.newest()]

    def slow() -> bool:
        if live.newest()[0] > seen[-1][0]:
            seen.append(live.newest())
        return live.runner.snapshot().timing.real_time_factor < 0.5 and live.said("The simulation runs at 0.")

    wall = live.until(slow)
    stamps, joints = np.array([s for s, _ in seen]), np.array([q for _, q in seen])
    assert stamps[-1] - stamps[0] < 0.6 * wall, "not slow"
    speeds = np.abs(np.diff(joints, axis=0)) / np.diff(stamps)[:, None]
    assert len(seen) > 5 and speeds.max() <= SPEED * 1.01 + 1e-6
    live.submit(cmd.Mend())
    live.until(lambda: not live.runner.snapshot().injected)
    began, stamp = time.monotonic(), live.newest()[0]
    live.frames(10)
    assert live.newest()[0] - stamp <= time.monotonic() - began + 3 * PERIOD_S, "it catches up"
    live.until(lambda: live.said("keeps up again"))


def test_pace_is_told_once_and_not_for_a_single_slow_picture() -> None:
    watch = pace.Pace()
    assert not any(watch.look(factor) for factor in [0.2, 1.0] * 100)
    told = [words for words in (watch.look(0.2) for _ in range(200)) if words]
    assert len(told) == 1 and "0.2×" in told[0] and "slower" in told[0]
    assert len([words for words in (watch.look(1.0) for _ in range(200)) if words]) == 1


@row("R4")
def test_a_failure_inside_is_offline_with_its_reason(live: Live) -> None:
    live.move()
    live.submit(cmd.Inject("R4"))
    live.until("offline")
    assert "failure made on purpose" in live.runner._engine.rig._death  # type: ignore[attr-defined]
    live.submit(cmd.ResetArm())
    live.until("idle")
    live.is_well()


@row("R4")
@pytest.mark.parametrize(
    ("broken", "code", "why"),
    [("missing.urdf", 2, "missing.urdf"), ("corrupt.urdf", 2, "corrupt.urdf"), ("", 3, "pybullet")],
)
def test_a_simulation_that_cannot_start_ends_serve_with_a_reason_and_nothing_is_left(
    broken: str, code: int, why: str, data: Path, capsys, monkeypatch
) -> None:
    """A robot's file that is missing or corrupt, and an environment without the physics engine."""
    (data / "corrupt.urdf").write_text("<robot name='r'><link name=")
    scene = task().scene
    if broken:
        scene = replace(scene, robot=str(data / broken))
        monkeypatch.setattr("vita.scenario.toml_io.load", lambda path: replace(task(), scene=scene))
    else:
        (data / "pybullet.py").write_text("raise ModuleNotFoundError('no', name='pybullet')\n")
        monkeypatch.syspath_prepend(str(data))  # The child gets the same path.
    file = data / "task.toml"
    toml_io.save(task(), file)
    port = check_free("127.0.0.1", 0)
    before = children()
    assert cli.main(["serve", str(file), "--port", str(port)]) == code
    out, err = capsys.readouterr()
    assert why in err and "vita is at" not in out and len(err.splitlines()) == 1
    assert children() == before and check_free("127.0.0.1", port) == port
    assert not running() and not threads("vita-runner")


def children() -> set[int]:
    """Live child processes of this one, python's own tracker of shared memory left out."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
            if int(fields[1]) == os.getpid() and fields[0] != "Z" and b"resource_tracker" not in (
                path.with_name("cmdline").read_bytes()
            ):  # fmt: skip
                found.add(int(path.parent.name))
        except OSError:
            continue
    return found


def threads(name: str) -> list[threading.Thread]:
    return [t for t in threading.enumerate() if t.name == name and t.ident not in KNOWN]


KNOWN: set[int | None] = set()


@pytest.fixture(autouse=True)
def known_threads(one: Live):
    KNOWN.update(t.ident for t in threading.enumerate())


@row("R5")
def test_joints_that_are_no_numbers_are_an_emergency_and_the_world_is_rebuilt_where_it_was(
    bench: Bench,  # noqa: F811
) -> None:
    bench.rig.perform("move_camera", camera="left", look_from=(1.5, -0.7, 0.8))
    bench.start()
    before = bench.tick()
    camera = bench.rig.poses()["camera:left"]
    bench.inject("R5")
    after = bench.tick()
    assert (after.status.state, after.status.reason) == ("estop", "state_corrupt")
    assert "rebuilt" in after.status.message
    gate = bench.rig.gate_state()
    assert gate["corrupt"] and gate["stopped"] and gate["at_rest"] and gate["rebuilt"] == 1
    assert np.isfinite(after.q).all() and np.abs(after.q - before.q).max() <= SPEED * PERIOD_S
    assert after.tick > before.tick and after.stamp == pytest.approx(before.stamp + PERIOD_S)
    assert np.array_equal(bench.rig.poses()["camera:left"], camera), "the scene has forgotten what was moved"
    with pytest.raises(Exception, match="Reset"):
        bench.engine.apply(cmd.Start())
    bench.rests_after(1)
    bench.engine.apply(cmd.Reset(confirm=True))
    assert bench.tick().status.state == "idle" and np.array_equal(bench.tick().q, bench.tick().q)
    bench.engine.apply(cmd.Start())
    bench.until("done")
    assert not bench.rig.gate_state()["corrupt"]


@row("R5")
def test_the_next_cycle_after_the_corruption_works_with_the_last_good_joints(
    bench: Bench,  # noqa: F811
) -> None:
    world, seen = bench.rig._world, []
    world.mishaps.make("corrupt")
    world.advance(3 / 240, lambda: seen.append((world.rebuilt, world.gate.stopped, world.q())))
    assert [(rebuilt, stopped) for rebuilt, stopped, _ in seen] == [(0, False), (1, True), (1, True)]
    assert all(np.abs(q - seen[0][2]).max() < 1e-6 for _, _, q in seen)


@row("R5")
def test_it_is_an_emergency_also_while_the_arm_rests(live: Live) -> None:
    live.submit(cmd.Inject("R5"))
    live.until("estop")
    assert live.status.reason == "state_corrupt" and live.shared.held
    live.submit(cmd.Reset(confirm=True))
    live.until("idle")
    live.is_well()


# ---- stops past the app -----------------------------------------------------------------------------------


def test_vita_stop_rests_the_arm_and_the_page_says_hold(live: Live, data: Path, capsys) -> None:
    del data
    file = RunFile(8123)
    file.follow(live.runner)
    try:
        live.move()
        assert stopping.stop(8123) == 0
        assert live.shared.at_rest
        out = capsys.readouterr().out
        assert "8123: the arm rests" in out and "press Start" in out and len(out.splitlines()) == 1
        live.until("hold")
        assert live.status.reason == "stopped_by_user"
        live.submit(cmd.Start())
        live.until(lambda: live.status.state in MOVING_STATES and not live.shared.at_rest)
        assert stopping.stop(emergency=True) == 0
        live.until("estop")
        assert "vita stop" in live.status.message and "Reset" in capsys.readouterr().out
        live.submit(cmd.Start())
        live.frames(3)
        assert live.shared.at_rest and live.status.state == "estop"
        live.submit(cmd.Reset(confirm=True))
        live.until("idle")
        live.is_well()
    finally:
        file.remove()
    assert stopping.stop(8123) == 3 and "no app runs" in capsys.readouterr().err


def test_run_files_of_apps_that_are_gone_are_not_believed(data: Path, capsys) -> None:
    """A number that now belongs to another process must not be signalled."""
    folder = run_folder()
    assert folder.parent == data
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    folder.mkdir()
    good = f'"child": {os.getpid()}, "child_born": "1", "memory": "x"'
    for name, text in {
        "1.json": f'{{"port": 1, "app": {dead.pid}, "app_born": "5", {good}}}',
        "2.json": f'{{"port": 2, "app": {os.getpid()}, "app_born": "not then", {good}}}',
        "3.json": "{",
        "4.json": '{"port": 4, "app": -1, "app_born": "", "child": -1, "child_born": "", "memory": ""}',
    }.items():
        (folder / name).write_text(text)
    assert running() == [] and stopping.stop() == 3
    assert "no app runs" in capsys.readouterr().err
    assert list(folder.iterdir()) == [], "stale files are swept"


def test_a_start_cannot_lift_a_stop_that_nobody_has_heard_of_yet(live: Live) -> None:
    """The signal came last, so it wins, whatever was on its way."""
    live.is_well()
    rig = live.rig
    os.kill(live.pid, signal.SIGUSR1)
    live.until(lambda: live.shared.latched()["stop"] != rig._heard["stop"] or live.shared.held)
    held = dict(rig._heard)
    rig._heard["stop"] -= 1  # As it is until the runner has asked.
    rig.release()
    assert live.shared.held
    rig._heard.update(held)
    rig.release()


PARENT = """
import sys, time
if __name__ == "__main__":
    from vita import commands as cmd
    from vita.runner import live_runner
    from vita.scenario.toml_io import load
    runner = live_runner(load(sys.argv[1]))
    print(*runner.arm_process, flush=True)
    runner.submit(cmd.Start())
    said = None
    while True:
        status = runner.snapshot().status
        if said != (said := (status.state, status.reason)):
            print(*said, flush=True)
        time.sleep(0.005)
"""


def test_the_arm_rests_when_the_whole_app_is_frozen_and_it_is_a_hold_when_it_is_back(data: Path) -> None:
    """The command's lease ends in the other process; when the app wakes up after a second, the arm has been
    stopped, and does not go on as if nothing had been."""
    toml_io.save(task(), data / "task.toml")
    code = ["-c", PARENT, str(data / "task.toml")]
    app = subprocess.Popen([sys.executable, *code], stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert app.stdout is not None
    try:
        pid, memory = app.stdout.readline().split()
        while not app.stdout.readline().startswith("learning"):
            pass
        flags = Flags(memory)
        wait_for(lambda: not flags.at_rest)
        app.send_signal(signal.SIGSTOP)
        began, cycles = time.monotonic(), flags.cycles
        wait_for(lambda: flags.at_rest)
        took, cycles = time.monotonic() - began, flags.rested - cycles
        assert cycles <= LEASE_CYCLES + REST_CYCLES, f"{cycles} cycles of 1/240 s"
        assert took <= (LEASE_CYCLES + REST_CYCLES + 8) / 240 + SLACK_S
        wait_for(lambda: flags.latched()["silent"] == 1)
        app.send_signal(signal.SIGCONT)
        while not (said := app.stdout.readline()).startswith("hold"):
            assert said
        assert said.split() == ["hold", "app_silent"]
        assert flags.at_rest
        flags.close()
    finally:
        app.kill()
        app.communicate()
    wait_for(lambda: not Path(f"/proc/{pid}").exists())


def wait_for(condition: Callable[[], bool], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the awaited did not come"
        time.sleep(0.001)


@row("U21")
@pytest.mark.parametrize("which", [signal.SIGTERM, signal.SIGINT])
def test_ending_the_program_in_motion_brakes_first_and_leaves_nothing(
    which: signal.Signals, data: Path, capsys
) -> None:
    del data
    seen: dict[str, object] = {}
    before = children()

    def in_motion(app: App) -> None:
        runner = app.runner
        assert isinstance(runner, Runner) and runner.arm_process is not None
        memory = runner.arm_process[1]

        def act() -> None:
            seen["app"], seen["flags"] = app.port, (flags := Flags(memory))
            seen["files"] = [entry.port for entry in running()]
            runner.submit(cmd.Start())
            wait_for(lambda: runner.snapshot().status.state in MOVING_STATES and not flags.at_rest)
            seen["began"] = time.monotonic()
            os.kill(os.getpid(), which)

        threading.Thread(target=act, daemon=True).start()

    serving.serve(
        task(), port=0, make_runner=lambda s: Runner(lambda s: LiveRig(s), s), ready=in_motion
    )
    took = time.monotonic() - float(seen["began"])  # type: ignore[arg-type]
    port, flags = seen["app"], seen["flags"]
    assert isinstance(port, int) and isinstance(flags, Flags)
    assert took <= 2.0 + SLACK_S
    assert flags.at_rest, "the arm still moved when its process ended"
    flags.close()
    assert seen["files"] == [port] and not running() and not list(run_folder().iterdir())
    assert children() == before and check_free("127.0.0.1", port) == port
    assert "vita is stopping" in capsys.readouterr().err
    assert not threads("vita-runner") and not threads("vita-page")


# ---- nobody there ---------------------------------------------------------------------------------------


@row("Q4")
def test_nobody_there_costs_next_to_no_pictures_and_none_is_encoded(live: Live, monkeypatch) -> None:
    monkeypatch.setattr(doze, "AFTER_S", 0.2)
    encoded = []
    monkeypatch.setattr("vita.ui.stream.cv2_imencode_with_fallback", lambda *a, **k: encoded.append(1))
    app = App(live.runner, port=0)
    try:
        live.until(lambda: live.shared.at_rest)
        time.sleep(0.4)
        idle = pictures(live.shared, 1.0)
        tick = live.runner.snapshot().tick
        end = time.monotonic() + 1.0
        began = drawn(live.shared)
        while time.monotonic() < end:
            newer = live.runner.wait_newer(tick, 0.5)
            tick = tick if newer is None else newer.tick
        watched = drawn(live.shared) - began
    finally:
        app.close()
    assert idle <= 8 and watched >= 2 * idle and watched >= 10
    assert not encoded
    live.submit(cmd.Start())
    live.until(lambda: live.status.state in MOVING_STATES)  # A click wakes it.


def drawn(shared: SharedFrames) -> int:
    """Pictures handed over so far."""
    return sum(int(sequence[0]) for sequence in shared._sequence) // 2


def pictures(shared: SharedFrames, seconds: float) -> int:
    before = drawn(shared)
    time.sleep(seconds)
    return drawn(shared) - before
