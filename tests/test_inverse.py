"""Inverse kinematics: the tool gets where it can be, within limits, and never by a jump."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.impedance_arms import ARMS, READY
from vita.errors import BadInput
from vita.impedance.inverse import MARGIN_RAD, damped_inverse, error_to, ranges, solve, step

names = st.sampled_from(list(ARMS))


@settings(deadline=None, max_examples=12, derandomize=True)
@given(names, st.integers(0, 10**6))
def test_every_pose_that_the_arm_can_take_is_found_within_a_millimetre(name: str, seed: int) -> None:
    """T11, from anywhere to anywhere; a four-joint arm for positions alone."""
    arm, rng = ARMS[name], np.random.default_rng(seed)
    lower, upper = ranges(arm)
    q_from, q_goal = rng.uniform(lower, upper), rng.uniform(lower, upper)
    goal = arm.pose(q_goal)
    found = solve(arm, q_from, goal, turn=arm.n >= 6)
    assert not found.limited
    off = error_to(goal, arm.pose(found.q))
    assert np.linalg.norm(off[:3]) == pytest.approx(found.position_error_m, abs=1e-9)
    assert np.linalg.norm(off[:3]) <= 1e-3
    assert arm.n < 6 or np.linalg.norm(off[3:]) <= 2e-3
    assert (found.q >= lower - 1e-12).all() and (found.q <= upper + 1e-12).all()


@settings(deadline=None, max_examples=12, derandomize=True)
@given(names, st.integers(0, 10**6))
def test_a_near_pose_is_reached_by_a_small_motion(name: str, seed: int) -> None:
    arm, rng = ARMS[name], np.random.default_rng(seed)
    q = READY[name] + rng.uniform(-0.2, 0.2, arm.n)
    goal = arm.pose(q + rng.uniform(-0.02, 0.02, arm.n))
    found = solve(arm, q, goal, turn=arm.n >= 6)
    assert not found.limited
    assert np.abs(found.q - q).max() < 0.6


def test_a_pose_out_of_reach_is_said_to_be_and_approached() -> None:
    arm, q = ARMS["tx90"], READY["tx90"]
    goal = arm.pose(q).copy()
    goal[:3, 3] = [2.0, 0.0, 0.5]
    found = solve(arm, q, goal, turn=False, tries=2)
    assert found.limited == "out of reach" or "limit" in found.limited
    # From the shoulder, no more than the stretched arm with its tool is within reach.
    reach = float(np.linalg.norm(arm.pose(found.q)[:3, 3] - [0.05, 0.0, 0.478]))
    assert found.position_error_m > 0.5
    assert reach > 0.98 * (0.425 + 0.425 + 0.2)


def test_a_joint_at_its_limit_is_named_as_people_count() -> None:
    arm, q = ARMS["wam4"], READY["wam4"].copy()
    lower, upper = ranges(arm)
    assert upper[3] == pytest.approx(3.1 - MARGIN_RAD)
    goal = arm.pose(q).copy()
    q[3] = 3.1
    folded = arm.pose(q)[:3, 3]
    shoulder = np.array([0.0, 0.0, 0.346])
    goal[:3, 3] = shoulder + 0.5 * (folded - shoulder)
    found = solve(arm, READY["wam4"], goal, turn=False, tries=0)
    assert found.limited == "joint 4 at its limit"
    assert found.q[3] == pytest.approx(upper[3])


@settings(deadline=None, max_examples=60, derandomize=True)
@given(names, st.integers(0, 10**6))
def test_one_step_keeps_every_bound_whatever_is_asked(name: str, seed: int) -> None:
    arm, rng = ARMS[name], np.random.default_rng(seed)
    lower, upper = ranges(arm)
    q = rng.uniform(lower, upper)
    J = arm.jacobian(arm.frames(q))
    most = rng.uniform(0.01, 0.1, arm.n)
    spare = rng.normal(size=arm.n)
    twist = rng.normal(size=6 if arm.n >= 6 else 3)
    near = np.minimum(rng.uniform(0, 0.05, arm.n), upper - q)
    move = step(J, twist, -near, near, most, spare)
    assert (move.dq <= near + 1e-9).all() and (move.dq >= -near - 1e-9).all()
    assert (np.abs(move.dq) <= most + 1e-9).all()
    for i in move.locked:
        assert abs(move.dq[i]) == pytest.approx(near[i])


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.integers(0, 10**6))
def test_spare_joints_move_without_moving_the_tool(seed: int) -> None:
    arm, rng = ARMS["wam7"], np.random.default_rng(seed)
    q = READY["wam7"] + rng.uniform(-0.3, 0.3, 7)
    J = arm.jacobian(arm.frames(q))
    wide = np.full(7, 10.0)
    spare = rng.normal(size=7)
    dq = step(J, np.zeros(6), -wide, wide, wide, spare).dq
    assert np.abs(J @ dq).max() < 1e-9
    assert np.linalg.norm(dq) > 1e-3 and dq @ spare > 0


def test_a_wrist_singularity_costs_orientation_and_not_position() -> None:
    arm, q = ARMS["tx90"], READY["tx90"].copy()
    q[4] = 0.0
    J = arm.jacobian(arm.frames(q))
    assert np.linalg.svd(J)[1][-1] < 1e-9
    wide = np.full(6, 10.0)
    twist = np.array([1e-3, -2e-3, 1e-3, 2e-3, 2e-3, 2e-3])
    dq = step(J, twist, -wide, wide, wide).dq
    assert J[:3] @ dq == pytest.approx(twist[:3], abs=1e-9)
    assert np.abs(dq).max() < 0.05


def test_the_damped_inverse_is_exact_away_from_singularities_and_bounded_at_them() -> None:
    rng = np.random.default_rng(0)
    U, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    V, _ = np.linalg.qr(rng.normal(size=(6, 3)))
    for s in (1.0, 0.1, 0.03, 0.02, 0.01, 1e-3, 1e-6, 0.0):
        J = U @ np.diag([1.0, 0.5, s]) @ V.T
        gain = np.linalg.norm(damped_inverse(J, 0.02), 2)
        if s >= 0.02:
            assert damped_inverse(J, 0.02) == pytest.approx(np.linalg.pinv(J), abs=1e-9)
        assert gain <= 1 / 0.02 + 1e-9


def test_what_cannot_be_solved_is_refused() -> None:
    arm = ARMS["wam4"]
    with pytest.raises(BadInput):
        solve(arm, READY["wam4"], np.eye(3))
    with pytest.raises(BadInput):
        solve(arm, READY["wam4"], np.full((4, 4), np.nan))
    crossed = replace(arm, joints=(replace(arm.joints[0], lower=1.0, upper=-1.0), *arm.joints[1:]))
    with pytest.raises(BadInput):
        ranges(crossed)


def test_a_joint_with_hardly_any_range_keeps_half_of_it() -> None:
    arm = ARMS["wam4"]
    narrow = replace(arm, joints=(replace(arm.joints[0], lower=0.1, upper=0.12), *arm.joints[1:]))
    lower, upper = ranges(narrow)
    assert (lower[0], upper[0]) == pytest.approx((0.105, 0.115))
    assert (lower <= upper).all()
    pinned = replace(arm, joints=(replace(arm.joints[0], lower=0.1, upper=0.1), *arm.joints[1:]))
    assert ranges(pinned)[0][0] == ranges(pinned)[1][0] == pytest.approx(0.1)
