"""The rows of the catalogue that the gate answers: bad, wild and old commands, limits, obstacles, a locked
joint. Each is made by its injector, seen in the snapshot, and recovered from."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bench import GOAL_DEG, POINTS, Bench, row, task

from vita import commands as cmd
from vita.scenario.schema import ObjectSpec
from vita.servo.pressed import STILL_RAD
from vita.sim.proximity import Proximity
from vita.types import JointStep

NEAR_GOAL_M = 0.004
DT = 1 / 240


@pytest.fixture
def bench():
    made = Bench()
    yield made
    made.close()


def said(bench: Bench) -> str:
    """Every notice, one a line."""
    return "\n".join(notice.text for notice in bench.engine.notices)


def record(bench: Bench) -> list[tuple[np.ndarray, np.ndarray]]:
    """From now on, every set point and speed that leaves the gate."""
    gate, out = bench.rig._world.gate, []
    cycle = gate.cycle

    def listening(now, q_measured):
        answer = cycle(now, q_measured)
        out.append(answer)
        return answer

    gate.cycle = listening
    return out


def gate_of(bench: Bench) -> Any:
    """What the gate says."""
    return bench.rig.gate_state()


def keeps_limits(out: list[tuple[np.ndarray, np.ndarray]], speed=0.6, acceleration=8.0) -> bool:
    v = np.array([v for _, v in out])
    return np.abs(v).max() <= speed + 1e-9 and np.abs(np.diff(v, axis=0)).max() <= acceleration * DT + 1e-9


def at_goal(bench: Bench) -> bool:
    """Whether the three points are where they are to be, in truth."""
    bench.tick()
    goals = bench.rig.poses_at(np.radians(GOAL_DEG))["flange"]
    return all(
        np.linalg.norm(bench.rig.locate("flange", p) - (goals @ [*p, 1.0])[:3]) < NEAR_GOAL_M for p in POINTS
    )


def no_faults(bench: Bench) -> bool:
    return not bench.rig.gate_state()["fault"]


@row("C5")
def test_a_command_that_is_no_number_is_stopped_at_the_gate_and_the_rest_goes_on(bench: Bench) -> None:
    bench.start()
    out = record(bench)
    bench.inject("C5")
    bench.tick()  # The bad command is given at the end of this period ...
    before = np.abs(out[-1][1]).max()
    bench.tick()  # ... and brakes the arm from the first cycle of the next.
    speeds = [np.abs(v).max() for _, v in out[-8:]]
    assert before > 0.1 and speeds[0] < before
    assert bench.rig.gate_state()["bad"] == 1 and "not a number was stopped" in said(bench)
    bench.until("done")
    assert all(np.isfinite(q).all() and np.isfinite(v).all() for q, v in out)
    assert keeps_limits(out) and at_goal(bench) and no_faults(bench)
    assert said(bench).count("not a number") == 1, "one story is told once"


@row("C6")
def test_a_push_into_a_limit_is_held_after_fifteen_periods(bench: Bench) -> None:
    bench.start()
    bench.inject("C6")
    joint = next(
        i for i, (now, own) in enumerate(zip(bench.rig.joints, bench.rig.robot_joints, strict=True))
        if now.upper != own.upper or now.lower != own.lower
    )  # fmt: skip
    bench.until(lambda s: joint in gate_of(bench)["saturated"])
    limit, qs = bench.rig.joints[joint], []
    snapshot = bench.tick()
    while snapshot.status.state == "servoing":
        qs.append(snapshot.q)
        assert limit.lower <= snapshot.q[joint] <= limit.upper
        snapshot = bench.tick()
        assert len(qs) < 100
    # The other joints may go on to their best place; from then on it takes 15 periods.
    assert 13 <= sum(bool(np.abs(q - snapshot.q).max() < STILL_RAD) for q in qs) <= 18
    assert (snapshot.status.state, snapshot.status.reason) == ("hold", "joint_limit")
    assert bench.rig.joints[joint].name in snapshot.status.message
    bench.rests_after()
    bench.engine.apply(cmd.Mend())
    bench.engine.apply(cmd.Start())
    bench.until("done")
    assert at_goal(bench)


@row("C7")
def test_a_hundred_times_too_fast_is_scaled_in_its_direction(bench: Bench) -> None:
    bench.start()
    out = record(bench)
    bench.inject("C7")
    bench.tick()
    assert bench.engine.last_step is not None
    asked = bench.engine.last_step.dq
    assert np.abs(asked).max() > 1.0, "the command is wild"
    bench.tick()
    v = np.array([v for _, v in out[-8:]])
    assert np.abs(v).max() == pytest.approx(0.6, abs=1e-6), "and is carried out as fast as is allowed"
    along = v[-1] @ asked / (np.linalg.norm(v[-1]) * np.linalg.norm(asked))
    assert along > 0.95, "the direction is kept, but for what is left of the one before"
    bench.until("done")
    assert keeps_limits(out) and at_goal(bench) and no_faults(bench)


@row("C8")
def test_an_arm_outside_a_limit_moves_only_inwards_and_people_are_told(bench: Bench) -> None:
    bench.start()
    bench.inject("C8")
    out = record(bench)
    joint = int(gate_of(bench)["outside"][0])
    limit, q0 = bench.rig.joints[joint], bench.tick().q[joint]
    sign = 1.0 if q0 < limit.lower else -1.0
    bench.until("done")
    number = bench.rig.joints[joint].name.removeprefix("joint")
    assert f"Joint {number} is out of its range: only motion inwards is possible" in said(bench)
    moved = sign * np.array([v[joint] for _, v in out])
    inside = sign * (np.array([q[joint] for q, _ in out]) - (limit.lower if sign > 0 else limit.upper)) > 0
    assert (moved[~inside] >= 0).all() and inside[-1]
    assert at_goal(bench) and not bench.rig.gate_state()["outside"]


@row("C8")
def test_a_start_outside_a_limit_says_so(bench: Bench) -> None:
    bench.inject("C8")
    bench.start(servoing=0)
    assert "is out of its range" in said(bench)


# The robot ---------------------------------------------------------------------------------------


@pytest.fixture
def with_ball():
    scenario = task()
    ball = ObjectSpec("ball", "ball", (0.3, 0.6, 0.4))
    made = Bench(replace(scenario, scene=replace(scenario.scene, objects=(ball,))))
    yield made
    made.close()


@row("R6")
def test_an_obstacle_at_the_arm_stops_it_and_lets_it_retreat(with_ball: Bench) -> None:
    bench = with_ball
    bench.start()
    bench.inject("R6")
    snapshot, periods = bench.until("fault", most=3)
    assert periods == 1, "within one look of the monitor"
    assert snapshot.status.reason == "too_close"
    assert "The forearm touches the ball" in snapshot.status.message
    bench.rests_after()
    # Acknowledged, it moves away but not nearer.
    bench.engine.apply(cmd.Acknowledge())
    assert bench.tick().status.state == "idle"
    monitor, world = bench.rig._world._proximity, bench.rig._world
    near = look(bench)
    away = np.linalg.pinv(near.gradients[near.distances < 0.01]).sum(axis=1)
    away /= np.abs(away).max()
    bench.rig.release()
    for way, moves in ((-away, False), (away, True)):
        q = np.array(bench.engine.observation.q)
        for _ in range(6):
            seen = bench.rig.observe()
            bench.rig.command(replace(_step(seen), dq=0.3 * way))
        assert (np.abs(bench.rig.observe().q - q).max() > 0.01) == moves
        bench.rig.command(None)
        bench.engine.observation = bench.rig.observe()
    assert monitor is not None and world.gate.fault == "", "a known contact is no news"
    # The obstacle goes away, and so does all that it did.
    bench.engine.apply(cmd.Mend())
    bench.engine.apply(cmd.Start())
    bench.until("done")
    assert at_goal(bench)


@row("R6")
def test_the_arm_slows_down_and_stops_short_of_what_is_in_its_way(with_ball: Bench) -> None:
    """A ball where the forearm is about to pass: it comes to rest a centimetre off, and people are told."""
    bench = with_ball
    monitor = bench.rig._world._proximity
    assert monitor is not None
    frames = bench.rig.arm_model().frames(np.radians(GOAL_DEG))
    starts, ends = monitor._hull.segments(frames)
    part = monitor._hull.frames.index(3)
    middle = 0.5 * (starts[part] + ends[part]) + np.array([0.0, 0.06, 0.0])
    bench.rig.perform("drag_target", object="ball", xyz=middle.tolist())
    bench.start(servoing=0)
    bench.until(lambda _: "close together" in said(bench))
    assert "the forearm and the ball are close together" in said(bench)
    least, snapshot = 1.0, bench.tick()
    for _ in range(40):
        snapshot = bench.tick()
        least = min(least, float(look(bench).distances.min()))
    assert 0.008 < least < 0.03 and snapshot.status.state != "fault"


@row("R7")
def test_a_locked_joint_is_named_and_nothing_jumps_when_it_comes_free(bench: Bench) -> None:
    bench.start()
    out = record(bench)
    bench.inject("R7")
    snapshot, _ = bench.until("fault", most=60)
    assert snapshot.status.reason == "gate_fault"
    locked = bench.rig._world.arm._locked
    joint = bench.rig._world.arm._index.index(next(iter(locked)))
    assert f"joint {bench.rig.joints[joint].name} does not follow" in snapshot.status.message
    bench.rests_after()
    q = bench.tick().q
    bench.engine.apply(cmd.Mend())
    assert np.allclose(bench.tick(5).q, q, atol=1e-3), "a joint that comes free does not jump"
    bench.engine.apply(cmd.Acknowledge())
    assert np.allclose(bench.tick(5).q, q, atol=1e-3), "nor does leaving the fault move anything"
    bench.engine.apply(cmd.Start())
    bench.until("done")
    assert at_goal(bench) and len(out) > 0


@row("R8")
def test_old_and_doubled_commands_change_nothing(bench: Bench) -> None:
    bench.start()
    bench.inject("R8")
    out = record(bench)
    bench.until("done")
    assert gate_of(bench)["dropped"] > 5, "the old ones are refused"
    assert keeps_limits(out) and at_goal(bench) and no_faults(bench)


def look(bench: Bench):
    """What the monitor sees now."""
    world = bench.rig._world
    assert isinstance(world._proximity, Proximity)
    poses = {"world": np.eye(4), **world._props.standing(world.time)}
    return world._proximity.look(world.q(), poses, world.time)


def _step(seen):
    return JointStep(np.zeros(len(seen.q)), seen.q, seen.stamp)
