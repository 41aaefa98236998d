"""Laws of the live rig: another process, real time, and nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vita.errors import BadInput, RigOffline, UnknownName
from vita.rig import SimulatedRig
from vita.scenario.schema import CameraSpec, Scenario, SceneSpec
from vita.sim.live import LiveRig
from vita.sim.lockstep import LockstepRig
from vita.sim.shared_frames import NUMBERS, SharedFrames
from vita.types import JointStep

SCENARIO = Scenario(
    seed=3,
    scene=SceneSpec(table=False),
    camera=(
        CameraSpec("left", look_from=(1.2, -0.9, 0.7), look_at=(0.45, 0.0, 0.25), size=(160, 120)),
        CameraSpec("right", look_from=(1.2, 0.9, 0.7), look_at=(0.45, 0.0, 0.25), size=(100, 120)),
    ),
)
WAIT_S = 10.0
"""How long a test waits for a frame before it fails; not a figure of merit."""


@pytest.fixture(scope="module")
def one_rig():
    with LiveRig(SCENARIO) as rig:
        yield rig, rig.observe(WAIT_S).q


@pytest.fixture
def rig(one_rig):
    rig, start = one_rig
    rig.command(None)
    rig.release()
    rig.hard_reset(start)
    return rig


@pytest.fixture
def doomed():
    """A rig of its own for tests that break it."""
    rig = LiveRig(SCENARIO)
    yield rig
    rig.close()


def ask(rig, seen, amount):
    rig.command(JointStep(np.full(len(seen.q), amount), seen.q, seen.stamp))


def gone(rig) -> bool:
    """Neither the process nor the shared memory is left."""
    try:
        SharedMemory(rig._shared.name).close()
    except FileNotFoundError:
        return not rig._process.is_alive()
    return False


def test_it_is_a_simulated_rig(rig):
    assert isinstance(rig, SimulatedRig)
    assert rig.visuals() and rig.cameras == ("left", "right")


def test_observations_keep_coming(rig):
    """Numbers grow, stamps go with them at 30 frames a second, data is read-only and stays as it was."""
    seen = [rig.observe(WAIT_S) for _ in range(25)]
    numbers = [o.number for o in seen]
    assert all(b > a for a, b in zip(numbers, numbers[1:], strict=False))
    assert np.diff([o.stamp for o in seen]) == pytest.approx(np.diff(numbers) / 30)
    assert seen[0].frames["right"].shape == (120, 100, 3)
    assert not seen[0].frames["left"].flags.writeable and not seen[0].q.flags.writeable
    assert seen[0].frames["left"].std() > 5


def test_it_shows_what_the_lockstep_rig_shows(rig):
    """The same scene, drawn in the other process: pictures, poses and projections agree."""
    seen = rig.observe(WAIT_S)
    with LockstepRig(SCENARIO) as lockstep:
        same = lockstep.observe()
        for camera in rig.cameras:
            assert np.abs(seen.frames[camera].astype(int) - same.frames[camera]).max() <= 2
            a, b = (r.project(camera, "tool", (0, 0, 0.1)) for r in (rig, lockstep))
            assert a == pytest.approx(b, abs=1e-6)
        assert list(rig.poses()) == list(lockstep.poses())
        assert rig.joints == lockstep.joints
        assert rig.locate("tool", (0, 0, 0.1)) == pytest.approx(lockstep.locate("tool", (0, 0, 0.1)))


def test_command_moves_the_arm(rig):
    first = rig.observe(WAIT_S)
    for _ in range(15):
        seen = rig.observe(WAIT_S)
        rig.command(JointStep(np.full(7, 0.1), first.q, seen.stamp))
    assert seen.q == pytest.approx(first.q + 0.1, abs=1e-3)


def test_stop_brings_it_to_rest(rig):
    """The stop flag brakes from full speed; steps pass again only after the release."""
    for _ in range(5):
        ask(rig, rig.observe(WAIT_S), 0.5)
    rig.stop_now()
    for _ in range(6):
        ask(rig, rig.observe(WAIT_S), 0.5)
    assert rig.gate_state()["stopped"] and rig.gate_state()["at_rest"]
    held = rig.observe(WAIT_S)
    rig.release()
    for _ in range(3):
        still = rig.observe(WAIT_S)
    assert still.q == pytest.approx(held.q, abs=1e-6), "release alone moved the arm"
    for _ in range(3):
        ask(rig, rig.observe(WAIT_S), 0.5)
    assert (rig.observe(WAIT_S).q > held.q + 1e-3).all()


def test_silent_servo_ends_in_rest(rig):
    """The lease runs on the child's clock: one step moves the arm for 100 ms, then it brakes."""
    first = rig.observe(WAIT_S)
    ask(rig, first, 1.0)
    while (seen := rig.observe(WAIT_S)).stamp < first.stamp + 0.5:
        pass
    assert rig.gate_state()["at_rest"]
    assert 1e-3 < (seen.q - first.q).max() < 0.6 * (5 / 30 + 18 / 240)


def test_malformed_steps_are_dropped_there(rig):
    """C5 across the process border."""
    first = rig.observe(WAIT_S)
    dropped = rig.gate_state()["dropped"]
    bad: list[Any] = [np.full(7, np.nan), np.zeros(3), "nonsense"]
    for dq in bad:
        rig.command(JointStep(dq, first.q, first.stamp))
        rig.observe(WAIT_S)
        seen = rig.observe(WAIT_S)
    assert rig.gate_state()["dropped"] == dropped + 3
    assert seen.q == pytest.approx(first.q, abs=1e-9)


def test_actions_show_in_the_next_observation(rig):
    first = rig.observe(WAIT_S)
    rig.perform("push_robot", dq_deg=[5])
    assert rig.observe(WAIT_S).q[0] - first.q[0] == pytest.approx(np.radians(5), abs=1e-6)
    rig.perform("black_camera", camera="left")
    assert not rig.observe(WAIT_S).frames["left"].any()
    rig.perform("freeze_camera", camera="right")
    pixel = (rig.observe(WAIT_S), rig.project("right", "tool", (0, 0, 0)))[1]
    rig.perform("push_robot", dq_deg=[5])
    rig.observe(WAIT_S)
    assert np.array_equal(rig.project("right", "tool", (0, 0, 0)), pixel)


def test_refusals_cross_the_border(rig):
    """A bad request raises here what it raised there, and the rig lives on."""
    with pytest.raises(BadInput, match="Did you mean 'cover'"):
        rig.perform("cower", camera="left")
    with pytest.raises(BadInput):
        rig.hard_reset(np.zeros(3))
    with pytest.raises(BadInput):
        rig.set_limits(rig.joints[:2])
    with pytest.raises(UnknownName):
        rig.project("middle", "tool", (0, 0, 0))
    rig.observe(WAIT_S)


def test_limits_in_force_come_back(rig):
    before = rig.joints
    rig.set_limits([replace(j, max_speed=99.0) for j in before])
    assert [j.max_speed for j in rig.joints] == [j.max_speed for j in rig.robot_joints]
    rig.set_limits(before)
    assert rig.joints == before


def test_nobody_looking_costs_no_pictures(rig):
    """While nobody observes, no frames are drawn; the next observation is a fresh one."""
    first = rig.observe(WAIT_S)
    time.sleep(0.5)
    newest = rig._shared.newest
    seen = rig.observe(WAIT_S)
    assert newest - first.number <= 4
    assert seen.number > newest


def test_killed_child_is_noticed(doomed):
    """R1: RigOffline well within 1.5 s, and neither process nor shared memory is left."""
    doomed.observe(WAIT_S)
    os.kill(doomed._process.pid, signal.SIGKILL)
    began = time.monotonic()
    with pytest.raises(RigOffline, match="exit code -9"):
        while True:
            doomed.observe()
    assert time.monotonic() - began < 1.5
    for call in (lambda: doomed.perform("uncover", camera="left"), doomed.observe):
        with pytest.raises(RigOffline):
            call()
    doomed.command(None)
    doomed.stop_now()
    doomed.close()
    assert gone(doomed)


def test_crash_arrives_with_its_text(doomed):
    """An exception in the child is raised here as RigOffline, traceback included."""
    doomed.observe(WAIT_S)
    with pytest.raises(RigOffline, match="the belt snapped"):
        doomed._request("raise", "the belt snapped")
    with pytest.raises(RigOffline, match="the belt snapped"):
        doomed.observe()


def test_suspended_child_is_noticed_and_recovers(doomed):
    """R2: a process that hangs is offline after the timeout; it resumes without a burst of motion."""
    last = doomed.observe(WAIT_S)
    ask(doomed, last, 1.0)
    os.kill(doomed._process.pid, signal.SIGSTOP)
    try:
        with pytest.raises(RigOffline, match="no sign of life"):
            while True:
                last = doomed.observe(0.5)
    finally:
        os.kill(doomed._process.pid, signal.SIGCONT)
    seen = doomed.observe(WAIT_S)
    assert seen.number <= last.number + 5
    assert np.abs(seen.q - last.q).max() <= 0.6 * (seen.stamp - last.stamp) + 1e-6


def test_suspended_child_can_be_closed(doomed):
    os.kill(doomed._process.pid, signal.SIGSTOP)
    doomed.close()
    assert gone(doomed)


def test_close_is_idempotent_and_final(doomed):
    doomed.close()
    doomed.close()
    assert gone(doomed)
    doomed.stop_now()
    for call in (doomed.observe, doomed.release, lambda: doomed.command(None)):
        with pytest.raises(RigOffline, match="closed"):
            call()


def test_ctrl_c_does_not_end_the_child(rig):
    """Ctrl-C reaches the child too; only the parent decides what it means."""
    os.kill(rig._process.pid, signal.SIGINT)
    first = rig.observe(WAIT_S)
    assert rig.observe(WAIT_S).number > first.number


def test_child_ends_with_its_parent():
    """A parent that is killed leaves neither a process nor shared memory behind."""
    code = (
        "from tests.test_live_rig import *\n"
        "rig = LiveRig(SCENARIO)\n"
        "print(rig._process.pid, rig._shared.name, flush=True)\n"
        "while True: rig.observe(WAIT_S)"
    )
    root = Path(__file__).resolve().parents[1]
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=root)
    try:
        assert parent.stdout is not None
        pid, name = parent.stdout.readline().split()
    finally:
        parent.kill()
        parent.communicate()
    until = time.monotonic() + WAIT_S
    while time.monotonic() < until and (Path(f"/proc/{pid}").exists() or Path(f"/dev/shm/{name}").exists()):
        time.sleep(0.05)
    assert not Path(f"/proc/{pid}").exists() and not Path(f"/dev/shm/{name}").exists()


def test_close_from_another_thread_ends_the_wait(doomed):
    """Closing while a thread observes gives that thread RigOffline, not a crash."""
    caught: list[BaseException] = []

    def look():
        try:
            while True:
                doomed.observe(WAIT_S)
        except BaseException as error:
            caught.append(error)

    thread = threading.Thread(target=look)
    thread.start()
    time.sleep(0.2)
    doomed.close()
    thread.join(WAIT_S)
    assert len(caught) == 1 and isinstance(caught[0], RigOffline)
    assert gone(doomed)


def test_bad_scenario_is_refused_as_such():
    """A scene that cannot be built raises what it would raise in this process."""
    with pytest.raises(BadInput, match="no_such_robot"):
        LiveRig(Scenario(scene=SceneSpec(robot="no_such_robot")))


# ---- the shared memory, in one process -----------------------------------------------------------


def make_pair():
    cameras = [("a", (8, 6)), ("b", (5, 3))]
    owner = SharedFrames(cameras)
    return owner, SharedFrames(cameras, owner.name)


def publish(shared, number):
    q = np.full(7, float(number))
    frames = {"a": np.full((6, 8, 3), number % 256, np.uint8), "b": np.full((3, 5, 3), 7, np.uint8)}
    numbers = dict.fromkeys(NUMBERS, 0.0) | {"number": number}
    shared.publish(numbers, q, {"x": np.eye(4) * number, "y": np.eye(4)}, frames)


def test_ring_hands_over_the_newest():
    owner, other = make_pair()
    try:
        assert owner.read(7, ["x", "y"]) is None
        for number in range(1, 11):
            publish(other, number)
        seen = owner.read(7, ["x", "y"])
        assert seen is not None
        assert seen.numbers["number"] == 10 and (seen.q == 10).all()
        assert (seen.frames["a"] == 10).all() and (seen.frames["b"] == 7).all()
        assert np.array_equal(seen.poses["x"], np.eye(4) * 10)
        publish(other, 14)  # The same slot again: what was read must not change.
        assert (seen.q == 10).all() and (seen.frames["a"] == 10).all()
    finally:
        other.close()
        owner.close()
        owner.close()


def test_half_written_data_is_not_read():
    owner, other = make_pair()
    try:
        publish(other, 1)
        other._sequence[1][0] += 1
        assert owner.read(7, ["x", "y"]) is None
        owner.put_command(JointStep(np.ones(7), np.zeros(7), 1.0, 0.5), 7)
        owner._control[3] += 1
        assert other.take_command(7) == (False, None)
        owner._control[3] += 1
        new, step = other.take_command(7)
        assert new and step is not None and (step.dq == 1).all()
        assert step.stamp == 1.0 and step.speed_scale == 0.5
        assert other.take_command(7) == (False, None)
    finally:
        other.close()
        owner.close()


def test_short_stop_is_not_missed():
    """A stop that is released before the child looked still counts as a stop."""
    owner, other = make_pair()
    try:
        owner.stop()
        owner.release()
        assert other.stops == 1 and not other.held
    finally:
        other.close()
        owner.close()
