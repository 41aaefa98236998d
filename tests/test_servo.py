"""Laws of the servo, on robots of a few lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_robot import FakeRobot, planar_arm_pixels
from hypothesis import given, settings
from hypothesis import strategies as st

from vita.errors import BadInput, UnknownName
from vita.servo import ServoConfig, VisualServo
from vita.servo.limits import change_setting

START, GOAL = [0.3, 0.5, -0.4], np.array([0.7, 0.2, 0.1])


def servo_on_plane(config: ServoConfig | None = None, q0: list[float] | None = None, **robot: float):
    arm = FakeRobot(q0 or START, **robot)
    goal = planar_arm_pixels(GOAL)
    return arm, VisualServo(arm, lambda: planar_arm_pixels(arm.q) - goal, config)


def true_jacobian(q: np.ndarray, step: float = 1e-6) -> np.ndarray:
    columns = [
        (planar_arm_pixels(q + step * axis) - planar_arm_pixels(q - step * axis)) / (2 * step)
        for axis in np.eye(q.size)
    ]
    return np.stack(columns, axis=1)


# ---- exploration (thesis eq. 2.17) ---------------------------------------------------------------


def test_exploration_finds_each_column_within_two_percent_and_returns_the_robot() -> None:
    arm, servo = servo_on_plane(ServoConfig(explore_deg=np.rad2deg(0.01)))
    jacobian = servo.learn()
    truth = true_jacobian(np.array(START))
    for column, expected in zip(jacobian.T, truth.T, strict=True):
        assert np.linalg.norm(column - expected) < 0.02 * np.linalg.norm(expected)
    np.testing.assert_allclose(arm.q, START, atol=1e-6)


def test_exploration_divides_by_the_measured_motion_not_the_commanded_one() -> None:
    """An arm that carries out 80 % of each motion still gives the right columns."""

    class Weak(FakeRobot):
        def move_by(self, dq: np.ndarray) -> None:
            self.q = self.q + 0.8 * dq

    arm = Weak(START)
    servo = VisualServo(arm, lambda: planar_arm_pixels(arm.q), ServoConfig(explore_deg=0.5))
    truth = true_jacobian(np.array(START))
    assert np.linalg.norm(servo.learn() - truth) < 0.02 * np.linalg.norm(truth)


def test_exploration_of_a_joint_subset_leaves_the_other_joints_alone() -> None:
    arm, servo = servo_on_plane()
    visited = []
    arm.move_by = lambda dq: (FakeRobot.move_by(arm, dq), visited.append(arm.q.copy()))  # type: ignore
    jacobian = servo.learn(joints=[0, 2])
    assert np.ptp([q[1] for q in visited]) == 0.0
    assert not jacobian[:, 1].any() and jacobian[:, [0, 2]].any()


def test_exploration_turns_round_at_a_joint_limit() -> None:
    arm = FakeRobot([2.99, 0.0, 0.0], limit=3.0)
    top = []
    servo = VisualServo(arm, lambda: (top.append(arm.q[0]), planar_arm_pixels(arm.q))[1])
    servo.learn()
    assert max(top) <= 3.0 and servo.jacobian[:, 0].any()


def test_a_joint_that_does_not_move_is_named() -> None:
    class Stuck(FakeRobot):
        def move_by(self, dq: np.ndarray) -> None:
            self.q = self.q + dq * [1.0, 0.0, 1.0]

    arm = Stuck(START)
    goal = planar_arm_pixels(GOAL)
    result = VisualServo(arm, lambda: planar_arm_pixels(arm.q) - goal).converge(timeout_s=5)
    assert (result.outcome, result.reason) == ("held", "joint_stuck")
    assert "j1" in result.message


def test_an_arm_out_of_the_picture_is_not_driven() -> None:
    arm = FakeRobot(START)
    result = VisualServo(arm, lambda: np.array([20.0, 10.0])).converge(timeout_s=5)
    assert (result.outcome, result.reason) == ("held", "no_effect")
    np.testing.assert_allclose(arm.q, START, atol=1e-9)


# ---- the loop ------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-0.35, 0.35), min_size=3, max_size=3), st.sampled_from([0.2, 0.5, 0.8]))
def test_it_converges_from_anywhere_near(offset: list[float], gain: float) -> None:
    arm, servo = servo_on_plane(ServoConfig(gain=gain, timeout_s=60), q0=list(GOAL + offset))
    result = servo.converge()
    assert result.outcome == "converged", result
    assert np.abs(result.error).max() <= 0.5


def test_a_task_that_is_met_is_done_without_any_motion() -> None:
    arm, servo = servo_on_plane(q0=list(GOAL))
    result = servo.converge()
    assert result.outcome == "converged" and result.steps == 0
    np.testing.assert_array_equal(arm.q, GOAL)


def test_limits_always_win_while_the_error_asks_for_more() -> None:
    """Goal beyond the limit of joint 0: it is named, and no position ever lies outside."""
    arm, servo = servo_on_plane(ServoConfig(gain=0.8), limit=0.5)
    seen = []
    arm.move_by = lambda dq: (FakeRobot.move_by(arm, dq), seen.append(arm.q.copy()))  # type: ignore
    result = servo.converge(timeout_s=20)
    assert np.abs(seen).max() <= 0.5 + 1e-12
    assert (result.outcome, result.reason) == ("held", "joint_limit"), result.message
    assert "j0" in result.message


def test_no_step_is_faster_than_the_speed_limit() -> None:
    arm, servo = servo_on_plane(ServoConfig(gain=1.0), max_speed=0.6)
    steps = []
    arm.move_by = lambda dq: (FakeRobot.move_by(arm, dq), steps.append(dq))  # type: ignore
    assert servo.converge(timeout_s=60).outcome == "converged"
    assert np.abs(steps).max() <= 0.6 / 30 + 1e-12


def test_a_lost_row_rests_the_arm_in_the_same_period() -> None:
    arm, servo = servo_on_plane()
    goal, lost = planar_arm_pixels(GOAL), [False]
    servo._measure = lambda: np.where([lost[0], False, False, False], np.nan, planar_arm_pixels(arm.q) - goal)
    servo.learn()
    servo.step()
    lost[0], before = True, arm.q.copy()
    state = servo.step()
    assert (state.status.state, state.status.reason) == ("hold", "tracker_lost")
    np.testing.assert_array_equal(arm.q, before)


PLAIN = ServoConfig(estimator="thesis", policy="fixed", gain=0.5, alpha=0.0)


def flipped(servo: VisualServo) -> None:
    """Turn the sign of everything that the servo has learned."""
    servo.learn()
    steering = servo.controller._steering
    assert steering is not None
    steering._estimator._estimate = replace(steering.estimate, jacobian=-servo.jacobian)


def test_a_flipped_jacobian_is_a_fault_not_a_runaway() -> None:
    arm, servo = servo_on_plane(PLAIN)
    flipped(servo)
    result = servo.converge(timeout_s=20)
    assert result.outcome == "fault" and result.reason in ("diverged", "opposite_motion")
    assert np.abs(arm.q - START).max() < 0.5


def test_the_default_servo_does_not_run_away_on_a_flipped_jacobian_either() -> None:
    arm, servo = servo_on_plane()
    farthest = []
    arm.move_by = lambda dq: (FakeRobot.move_by(arm, dq), farthest.append(np.abs(arm.q - START).max()))  # type: ignore
    flipped(servo)
    result = servo.converge(timeout_s=20)
    assert result.outcome in ("fault", "held", "converged"), result
    assert max(farthest) < 0.6


def test_contradicting_rows_stall_and_the_worst_is_named() -> None:
    arm = FakeRobot(START)
    goal = planar_arm_pixels(GOAL)
    servo = VisualServo(arm, lambda: np.append(planar_arm_pixels(arm.q) - goal, arm.q[0] * 500 + 40))
    result = servo.converge(timeout_s=60)
    assert (result.outcome, result.reason) == ("held", "stalled")
    assert "row" in result.message


def test_the_timeout_is_kept_to_a_period() -> None:
    now = [0.0]
    arm = FakeRobot(START)
    goal = planar_arm_pixels(GOAL)

    def measure() -> np.ndarray:
        now[0] += 1 / 30
        return planar_arm_pixels(arm.q) - goal

    servo = VisualServo(arm, measure, replace(PLAIN, gain=0.01), clock=lambda: now[0])
    servo.learn()
    began = now[0]
    result = servo.converge(timeout_s=2.0)
    assert result.outcome == "timeout"
    assert abs(now[0] - began - 2.0) < 3 / 30


def test_a_dead_band_ends_as_limited_and_higher_gain_ends_closer() -> None:
    """Thesis 5.1.3: steps below TOL are not carried out."""

    class DeadBand(FakeRobot):
        def move_by(self, dq: np.ndarray) -> None:
            self.q = self.q + np.where(np.abs(dq) < 0.004, 0.0, dq)

    arm = DeadBand(START)
    goal = planar_arm_pixels(GOAL)
    servo = VisualServo(arm, lambda: planar_arm_pixels(arm.q) - goal, ServoConfig(gain=0.2))
    result = servo.converge(timeout_s=60)
    assert (result.outcome, result.reason) in {("limited", "dead_band"), ("converged", "converged")}
    assert np.abs(result.error).max() < 3.0


def test_a_gain_changed_while_it_runs_is_in_force_at_the_next_period() -> None:
    arm, servo = servo_on_plane(replace(PLAIN, gain=0.1), max_speed=1e6)
    servo.learn()
    small = servo.step().dq
    error = planar_arm_pixels(arm.q) - planar_arm_pixels(GOAL)
    servo.config = change_setting(servo.config, "gain", 0.25, "servo")  # A step that is felt at once.
    large = servo.step().dq
    u, values, vt = np.linalg.svd(servo.jacobian, full_matrices=False)
    damped = values / (values**2 + (servo.config.damping * values[0]) ** 2)
    np.testing.assert_allclose(large, -0.25 * vt.T @ (damped * (u.T @ error)), atol=1e-12)
    assert np.linalg.norm(large) > 1.5 * np.linalg.norm(small)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 0.0, 99.0, True, "fast"])
def test_a_bad_setting_is_refused_with_its_path(bad: object) -> None:
    with pytest.raises(BadInput, match="servo.gain"):
        change_setting(ServoConfig(), "gain", bad, "servo")


def test_an_unknown_setting_lists_the_choices() -> None:
    with pytest.raises(UnknownName, match="gain.*alpha"):
        change_setting(ServoConfig(), "lambda", 1.0, "servo")


def test_a_joint_that_the_robot_does_not_have_is_refused() -> None:
    with pytest.raises(BadInput, match="joints 0 to 2"):
        VisualServo(FakeRobot(START), lambda: np.zeros(1), ServoConfig(joints=(0, 5)))


def test_two_runs_are_identical_to_the_bit() -> None:
    ends = []
    for _ in range(2):
        arm, servo = servo_on_plane()
        servo.converge()
        ends.append(arm.q)
    np.testing.assert_array_equal(*ends)
