"""Laws of the gate: whatever it is fed, the arm keeps its limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vita.errors import BadInput
from vita.servo.gate import Gate, braking_speed
from vita.types import Joint, JointStep

DT = 1 / 240
SLACK = 1e-9


def joints(n=4, lower=-1.0, upper=1.0, speed=0.6):
    return [Joint(f"j{i}", lower, upper, speed) for i in range(n)]


def step(target, q_from=None, stamp=0.0, scale=1.0):
    target = np.asarray(target, dtype=float)
    q_from = np.zeros_like(target) if q_from is None else np.asarray(q_from, dtype=float)
    return JointStep(target - q_from, q_from, stamp, scale)


def drive(gate, q, cycles, target=None, now=0.0, renew=True, scale=1.0):
    """Run an arm that follows perfectly; returns the (cycles, n) positions and speeds."""
    qs, vs = [], []
    for k in range(cycles):
        if target is not None and (renew or k == 0):
            gate.command(step(target, q, now, scale), now)
        q, v = gate.cycle(now, q)
        now += DT
        qs.append(q)
        vs.append(v)
    return np.array(qs), np.array(vs)


def stopping_point(q, v, a):
    """Where a joint comes to rest when it brakes as hard as it may, cycle by cycle (the oracle)."""
    q, v = q.copy(), v.copy()
    while v.any():
        v -= np.clip(v, -a * DT, a * DT)
        q += v * DT
    return q


def near_limits(rng, low, high):
    """Random positions, most of them within a hair of a limit: random inner ones hide naive gates."""
    span = high - low
    hair = span * 10.0 ** rng.uniform(-6, -1, low.size)
    choices = np.stack([low + hair, high - hair, rng.uniform(low, high), low, high])
    return choices[rng.integers(0, 5, low.size), np.arange(low.size)]


def hostile_run(seed, cycles, n):
    """One run with random targets, moved limits and bad input; asserts the laws in each cycle."""
    rng = np.random.default_rng(seed)
    a = float(rng.choice([0.5, 8.0, 50.0]))

    def draw(q=None, v=None):
        """Random limits; with a state, only such that it can still be kept inside."""
        mid, half = rng.uniform(-1, 1, n), 10.0 ** rng.uniform(-2, 0.5, n)
        low, high = mid - half, mid + half
        if q is not None:
            rest = stopping_point(q, v, a)
            low = np.minimum(low, np.minimum(q, rest) - 1e-9 - 0.02)
            high = np.maximum(high, np.maximum(q, rest) + 1e-9 + 0.02)
        speed = 10.0 ** rng.uniform(-2, 0.5, n)
        return [Joint(str(i), low[i], high[i], speed[i]) for i in range(n)]

    def bounds(limits):
        lower, upper = (np.array([getattr(j, k) for j in limits]) for k in ("lower", "upper"))
        margin = np.minimum(0.02, (upper - lower) / 4)
        return lower + margin, upper - margin, np.array([j.max_speed for j in limits])

    limits = draw()
    low, high, speed = bounds(limits)
    gate = Gate(limits, a)
    q = near_limits(rng, low, high)
    v = np.zeros(n)
    now, allowed = 0.0, speed.copy()
    for k in range(cycles):
        event = rng.integers(0, 40)
        if event < 8:
            target = near_limits(rng, low, high) + rng.choice([0, 0, 1e-7, 0.3, -5, 1e6])
            gate.command(step(target, q, now, rng.choice([0.01, 0.5, 1, 100])), now)
        elif event == 8:
            limits = draw(q, v)
            gate.set_limits(limits)
            low, high, speed = bounds(limits)
        elif event == 9:
            bad = rng.choice([np.nan, np.inf, -np.inf, 1e308])
            gate.command(JointStep(np.full(n, bad), np.full(n, bad), now), now)
        elif event == 10:
            gate.command(JointStep(np.zeros(n + 1), np.zeros(n + 1), now), now)
        elif event == 11:
            gate.stop()
        elif event <= 14:
            gate.release()
        q_next, v_next = gate.cycle(now, q)
        # A lowered speed limit is reached at the allowed braking, not at once.
        allowed = np.maximum(speed, allowed - a * DT)
        assert np.isfinite(q_next).all() and np.isfinite(v_next).all()
        assert (q_next >= low - SLACK).all() and (q_next <= high + SLACK).all(), f"position, cycle {k}"
        assert (np.abs(v_next) <= allowed + SLACK).all(), f"speed, cycle {k}"
        assert (np.abs(v_next - v) <= a * DT + SLACK).all(), f"acceleration, cycle {k}"
        assert np.allclose(q_next, q + v_next * DT, atol=1e-15), "the set points do not fit together"
        q, v, now = q_next, v_next, now + DT


@pytest.mark.parametrize("seed", range(12))
def test_limits_hold_whatever_is_commanded(seed):
    """120,000 joint cycles of hostile input: no violation of position, speed or acceleration."""
    hostile_run(seed, cycles=1000, n=10)


def test_limits_hold_with_limits_of_one_joint_arm():
    """The same for a single joint, where no other joint slows it down: 12,000 cycles."""
    for seed in range(12):
        hostile_run(100 + seed, cycles=1000, n=1)


@settings(max_examples=20, deadline=None)
@given(
    start=st.lists(st.floats(-0.98, 0.98), min_size=3, max_size=3),
    goal=st.lists(st.floats(-0.98, 0.98), min_size=3, max_size=3),
    acceleration=st.sampled_from([2.0, 8.0, 30.0]),
)
def test_target_is_reached_without_overshoot(start, goal, acceleration):
    """From rest the target is met to 1e-9, each joint moves one way only, and the arm is at rest."""
    gate = Gate(joints(3), acceleration)
    start, goal = np.array(start), np.array(goal)
    qs, vs = drive(gate, start, 1500, goal)
    assert np.allclose(qs[-1], goal, atol=1e-9)
    assert gate.at_rest
    way = np.sign(goal - start)
    assert ((goal - qs) * way >= -1e-12).all()
    assert (vs * way >= 0).all()


@settings(max_examples=20, deadline=None)
@given(goal=st.lists(st.floats(-0.9, 0.9), min_size=3, max_size=3), scale=st.sampled_from([0.1, 1.0]))
def test_direction_is_kept(goal, scale):
    """Far from the limits the arm moves on the straight joint-space line, also while accelerating."""
    goal = np.array(goal)
    if np.abs(goal).max() < 1e-3:
        return
    _, vs = drive(Gate(joints(3)), np.zeros(3), 400, goal, scale=scale)
    along = vs @ goal / (goal @ goal)
    assert np.allclose(vs, along[:, None] * goal, atol=1e-9)
    assert np.abs(vs).max() <= 0.6 * scale + SLACK


def test_retarget_does_not_overshoot():
    """A new target while moving: no joint passes the new target further than braking demands."""
    rng = np.random.default_rng(5)
    for _ in range(15):
        gate = Gate(joints(3))
        qs, vs = drive(gate, np.zeros(3), int(rng.integers(2, 120)), rng.uniform(-0.9, 0.9, 3))
        rest = stopping_point(qs[-1], vs[-1], 8.0)
        goal = rng.uniform(-0.9, 0.9, 3)
        after, _ = drive(gate, qs[-1], 1500, goal, now=len(qs) * DT)
        assert np.allclose(after[-1], goal, atol=1e-9)
        # Only a joint that had to reverse, or that could not stop in time, may be past the goal.
        free = (np.sign(goal - qs[-1]) == np.sign(goal - rest)) & (vs[-1] * (goal - qs[-1]) >= 0)
        over = (after - goal) * np.sign(goal - qs[-1])
        assert (over[:, free] <= 1e-9).all()


def test_a_joint_that_turns_round_does_not_push_another_past_its_goal():
    """One joint must brake hard for its new goal while the other has much to change: no overshoot."""
    gate = Gate(joints(2))
    qs, vs = drive(gate, np.zeros(2), 100, [0.9, 0.9])
    rest = stopping_point(qs[-1], vs[-1], 8.0)
    goal = np.array([rest[0] + 1e-6, -0.9])
    after, _ = drive(gate, qs[-1], 1500, goal, now=100 * DT)
    assert after[:, 0].max() <= goal[0] + 1e-9
    assert after[-1] == pytest.approx(goal, abs=1e-9)


@settings(max_examples=200, deadline=None)
@given(st.floats(1e-12, 10.0), st.sampled_from([0.5, 8.0, 50.0]))
def test_braking_speed_is_exact(distance, acceleration):
    """From the braking speed the arm stops within the distance; it uses all of it."""
    v = braking_speed(np.array([distance]), acceleration, DT)[0]
    path = v * DT
    while v > 0:
        v -= min(v, acceleration * DT)
        path += v * DT
    assert path == pytest.approx(distance, rel=1e-9, abs=1e-15)


def test_rest_within_18_cycles_of_a_stop():
    """From 0.6 rad/s at 8 rad/s^2 the arm is at rest 18 cycles after the stop, and stays so."""
    gate = Gate(joints())
    qs, vs = drive(gate, np.zeros(4), 60, np.full(4, 0.9))
    assert vs[-1] == pytest.approx(0.6)
    gate.stop()
    qs, vs = drive(gate, qs[-1], 60, np.full(4, 0.9), now=60 * DT)
    assert not vs[17:].any() and gate.at_rest
    gate.release()
    held, _ = drive(gate, qs[-1], 20, now=120 * DT)
    assert (held == qs[-1]).all(), "release alone moved the arm"


def test_lease_ends_in_rest():
    """A servo that hangs: its last step moves the arm for 100 ms, then the gate brakes."""
    gate = Gate(joints())
    _, vs = drive(gate, np.zeros(4), 24 + 1 + 18, np.full(4, 0.9), renew=False)
    assert vs[23].all()
    assert not vs[-1].any()


def test_old_image_gives_no_permission():
    """A step that answers an old image moves nothing, however freshly it was sent."""
    gate = Gate(joints())
    gate.command(step(np.full(4, 0.9), stamp=0.0), now=0.2)
    gate.cycle(0.2, np.zeros(4))
    assert gate.at_rest


def test_older_step_is_ignored():
    """Steps that arrive out of order do not replace the newest one (R8)."""
    gate = Gate(joints(1))
    gate.command(step([0.5], stamp=0.10), now=0.11)
    gate.command(step([-0.5], stamp=0.05), now=0.11)
    _, v = gate.cycle(0.11, np.zeros(1))
    assert v[0] > 0 and gate.dropped == 1


@pytest.mark.parametrize(
    "bad",
    [
        JointStep(np.full(4, np.nan), np.zeros(4), 0.3),
        JointStep(np.zeros(4), np.array([0, 0, np.inf, 0]), 0.3),
        JointStep(np.full(4, 1e308), np.full(4, 1e308), 0.3),
        JointStep(np.zeros(3), np.zeros(3), 0.3),
        JointStep(np.zeros(4), np.zeros(4), float("nan")),
        JointStep(np.zeros(4), np.zeros(4), 0.3, float("nan")),
        JointStep(None, np.zeros(4), 0.3),  # pyright: ignore[reportArgumentType]
        JointStep("abcd", np.zeros(4), 0.3),  # pyright: ignore[reportArgumentType]
    ],
)
def test_malformed_step_is_dropped_and_brakes(bad):
    """C5: NaN, infinity and wrong shapes never reach the arm, are counted, and brake it."""
    gate = Gate(joints())
    qs, _ = drive(gate, np.zeros(4), 60, np.full(4, 0.9))
    gate.command(bad, 0.3)
    _, vs = drive(gate, qs[-1], 18, now=60 * DT)
    assert gate.dropped == 1 and not vs[-1].any()


def test_outside_limits_only_inward_motion_passes():
    """C8: an arm that starts outside moves inwards on command and never further out."""
    for target, direction in ((2.0, 0), (0.0, -1)):
        gate = Gate(joints(1))
        qs, vs = drive(gate, np.array([1.3]), 600, [target])
        assert (np.sign(vs) <= 0).all() and np.sign(qs[-1, 0] - 1.3) == direction
    assert qs[-1, 0] == pytest.approx(0.0, abs=1e-9)


def test_retreat_from_a_limit_is_possible():
    """A joint that a limit holds is flagged, and goes back as soon as it is asked to (C6)."""
    gate = Gate(joints(2))
    qs, _ = drive(gate, np.zeros(2), 600, [5.0, 0.3])
    assert qs[-1] == pytest.approx([0.98, 0.3])
    assert gate.saturated.tolist() == [True, False]
    qs, _ = drive(gate, qs[-1], 600, [0.5, 0.3], now=600 * DT)
    assert qs[-1] == pytest.approx([0.5, 0.3])
    assert not gate.saturated.any()


def test_limit_moved_past_the_arm_brakes_then_holds():
    """A limit moved behind a moving arm: the shortest stop, then nothing but inward motion."""
    gate = Gate(joints(1))
    qs, vs = drive(gate, np.zeros(1), 60, [0.9])
    shortest = stopping_point(qs[-1], vs[-1], 8.0)
    gate.set_limits(joints(1, upper=0.0))
    after, vs = drive(gate, qs[-1], 200, [0.9], now=60 * DT)
    assert after.max() == pytest.approx(shortest[0])
    assert not vs[20:].any()
    back, _ = drive(gate, after[-1], 600, [-0.5], now=260 * DT)
    assert back[-1, 0] == pytest.approx(-0.5)


def test_arm_that_does_not_follow_is_noticed():
    """R7: more than 0.1 rad away for 5 cycles stops the gate, which names the joint."""
    gate = Gate(joints())
    stuck = np.zeros(4)
    q = v = stuck
    for k in range(120):
        gate.command(step(np.full(4, 0.9), stamp=k * DT), k * DT)
        q, v = gate.cycle(k * DT, stuck)
    assert "j0" in gate.fault and not v.any() and q[0] < 0.2


def test_nan_from_the_arm_stops_the_gate():
    """R5: a broken measurement never becomes a set point."""
    gate = Gate(joints())
    drive(gate, np.zeros(4), 60, np.full(4, 0.9))
    q = v = np.full(4, np.nan)
    for k in range(18):
        q, v = gate.cycle(60 * DT + k * DT, np.full(4, np.nan))
    assert gate.fault and np.isfinite(q).all() and not v.any()


def test_reset_voids_earlier_steps():
    """After a reset the arm stands where it was put; steps from before are refused."""
    gate = Gate(joints(1))
    drive(gate, np.zeros(1), 30, [0.5])
    gate.reset(np.array([-0.4]), now=1.0)
    gate.command(step([0.5], stamp=0.99), now=1.0)
    q, v = gate.cycle(1.0, np.array([-0.4]))
    assert q[0] == -0.4 and v[0] == 0.0


def test_senseless_limits_are_refused():
    gate = Gate(joints(1))
    for bad in (joints(2), joints(1, lower=2.0), joints(1, speed=-1.0), joints(1, upper=np.nan)):
        with pytest.raises(BadInput):
            gate.set_limits(bad)
    with pytest.raises(BadInput):
        gate.set_limits(joints(1), acceleration=0.0)
