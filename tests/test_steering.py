"""Laws of the servo's exchangeable parts at work: whatever is chosen, live, it gets there and stays safe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_robot import FakeRobot, planar_arm_pixels

from vita.constraints import Term, stack
from vita.errors import UnknownName
from vita.servo import ESTIMATORS, POLICIES, Controller, ServoConfig, VisualServo
from vita.servo.limits import change_setting
from vita.types import Array, ErrorVector, Feature, RowLabel, frozen

START, GOAL = [0.3, 0.5, -0.4], np.array([0.7, 0.2, 0.1])
PERIOD = 1 / 30


def servo_to_goal(config: ServoConfig, sigma: float = 0.0, **robot: float) -> tuple[FakeRobot, VisualServo]:
    arm, random = FakeRobot(START, **robot), np.random.default_rng(0)

    def measure() -> Array:
        return planar_arm_pixels(arm.q) - planar_arm_pixels(GOAL) + sigma * random.standard_normal(4)

    return arm, VisualServo(arm, measure, config)


def slow(dq: Array) -> Array:
    """`dq` scaled as a whole to at most 0.05 rad a joint, as the gate does."""
    return dq * min(1.0, 0.05 / max(float(np.abs(dq).max()), 1e-12))


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_every_estimator_works_with_every_policy(estimator: str, policy: str) -> None:
    arm, servo = servo_to_goal(ServoConfig(estimator=estimator, policy=policy, gain=0.5), max_speed=0.6)
    result = servo.converge(timeout_s=60)
    assert result.outcome == "converged", result
    assert np.abs(planar_arm_pixels(arm.q) - planar_arm_pixels(GOAL)).max() < 1.0


def test_estimator_and_policy_can_be_exchanged_in_every_period_and_what_is_known_is_kept() -> None:
    _, servo = servo_to_goal(ServoConfig(gain=0.3), sigma=0.1, max_speed=0.6)
    servo.learn()
    first = servo.jacobian
    servo.config = replace(servo.config, estimator="rls", policy="fixed")
    servo.step()
    np.testing.assert_allclose(servo.jacobian, first, atol=0.05 * np.abs(first).max())
    pairs = [(e, p) for e in ESTIMATORS for p in POLICIES]
    for estimator, policy in pairs * 2:
        servo.config = replace(servo.config, estimator=estimator, policy=policy)
        state = servo.step()
        assert state.status.state in ("servoing", "done")
    assert servo.converge(timeout_s=60).outcome == "converged"


@pytest.mark.parametrize("field", ["estimator", "policy", "secondary"])
def test_an_unknown_kind_is_refused_with_its_path_and_the_choices(field: str) -> None:
    with pytest.raises(UnknownName, match=rf"servo\.{field}.*Choices"):
        change_setting(ServoConfig(), field, "kalmann", "servo")


def test_the_noise_is_measured_at_rest_and_sizes_the_exploration() -> None:
    def farthest(sigma: float) -> tuple[float, float]:
        arm, servo = servo_to_goal(ServoConfig(), sigma=sigma)
        moved: list[float] = []
        arm.move_by = lambda dq: (FakeRobot.move_by(arm, dq), moved.append(np.abs(arm.q - START).max()))  # type: ignore
        servo.learn()
        return servo.controller.sigma_px, max(moved)

    calm, rough = farthest(0.05), farthest(1.0)
    assert calm[0] == pytest.approx(0.05, rel=0.4) and rough[0] == pytest.approx(1.0, rel=0.4)
    # The best size grows with the square root of the noise.
    assert rough[1] / calm[1] == pytest.approx(np.sqrt(rough[0] / calm[0]), rel=0.1)


def test_the_arm_stands_still_while_its_noise_is_measured() -> None:
    arm, servo = servo_to_goal(ServoConfig())
    servo.controller.start()
    for _ in range(5):
        servo.step()
        assert "noise" in servo.controller.progress
        np.testing.assert_array_equal(arm.q, START)


def test_exploring_by_image_motion_moves_every_column_by_what_was_asked() -> None:
    arm, servo = servo_to_goal(ServoConfig(explore_px=12.0))
    servo.learn()
    steering = servo.controller._steering
    assert steering is not None
    moved = np.abs(np.array(steering._e) - steering._e[0]).max(axis=1)
    columns = np.abs(np.array(steering._q) - steering._q[0])
    for joint in range(3):
        assert moved[columns[:, joint] > 1e-3].max() == pytest.approx(12.0, rel=0.2)


# ---- rows, weights, priorities ---------------------------------------------------------------------


def conflict(first: int, second: int) -> VisualServo:
    """Two goals for the same point; `first` and `second` are their priorities."""
    arm = FakeRobot(START)

    def error() -> ErrorVector:
        pixels = planar_arm_pixels(arm.q)[2:]
        goals = [planar_arm_pixels(GOAL)[2:], planar_arm_pixels(GOAL)[2:] + [-30.0, -20.0]]
        points = {"hand": pixels, "a": goals[0], "b": goals[1]}
        features = {name: Feature(frozen(uv)) for name, uv in points.items()}
        terms = (
            Term("to a", "point_to_point", ("hand", "a"), "left", 1.0, first),
            Term("to b", "point_to_point", ("hand", "b"), "left", 1.0, second),
        )
        return stack(terms, features)

    servo = VisualServo(arm, lambda: error().values, ServoConfig(timeout_s=20))
    servo.labels = error().labels  # type: ignore[attr-defined]
    servo._error = error  # type: ignore[attr-defined]
    return servo


def run_conflict(first: int, second: int) -> ErrorVector:
    servo = conflict(first, second)
    controller, robot = servo.controller, servo._robot
    assert isinstance(robot, FakeRobot)
    controller.start()
    stamp = 0.0
    while controller.moving and stamp < 12.0:
        decision = controller.tick(stamp, robot.position(), servo._error())  # type: ignore[attr-defined]
        if decision is not None:
            robot.move_by(slow(decision.dq))
        stamp += PERIOD
    return servo._error()  # type: ignore[attr-defined]


@pytest.mark.parametrize(("first", "second", "met"), [(1, 2, "to a"), (2, 1, "to b")])
def test_of_two_goals_that_contradict_each_other_the_more_important_is_met(
    first: int, second: int, met: str
) -> None:
    assert np.abs(run_conflict(first, second).of(met)).max() < 0.5


def test_equal_priorities_share_the_error() -> None:
    error = run_conflict(1, 1)
    np.testing.assert_allclose(error.of("to a"), -error.of("to b"), atol=1.0)


def test_a_row_of_weight_zero_moves_nothing() -> None:
    arm = FakeRobot(START)
    labels = tuple(RowLabel("goal", "left", c) for c in "uvwx") + (RowLabel("ignored", "left", "u"),)
    weights = frozen([1.0, 1.0, 1.0, 1.0, 0.0])

    def error() -> ErrorVector:
        rows = planar_arm_pixels(arm.q) - planar_arm_pixels(GOAL)
        return ErrorVector(frozen([*rows, 500.0 * arm.q[0] + 40.0]), labels, weights)

    controller = Controller(arm.joints, ServoConfig(tolerance_px=0.5, timeout_s=6))
    controller.start()
    for k in range(170):
        decision = controller.tick(k * PERIOD, arm.position(), error())
        if decision is not None:
            arm.move_by(slow(decision.dq))
    assert np.abs(error().values[:4]).max() < 0.5


# ---- what is left free -----------------------------------------------------------------------------


def wrist_only(arm: FakeRobot) -> Array:
    """(1,) error of one row that three joints can change: two directions stay free."""
    return (planar_arm_pixels(arm.q) - planar_arm_pixels(GOAL))[:1]


def test_a_posture_is_taken_up_in_what_the_task_leaves_free_and_hardly_moves_the_error() -> None:
    arm = FakeRobot(START)
    posture = np.degrees([0.6, 0.2, 0.9])
    config = ServoConfig(secondary="posture", posture_deg=tuple(posture), tolerance_px=0.01)
    servo = VisualServo(arm, lambda: wrist_only(arm), config)
    servo.learn()
    worst, before = 0.0, np.degrees(arm.q)
    for k in range(250):
        servo.step()
        if k > 60:
            worst = max(worst, float(np.abs(wrist_only(arm)).max()))
        if servo.controller.status.state == "done":
            servo.controller.start(relearn=False)
    moved = np.abs(np.degrees(arm.q) - before)
    assert moved[2] > 5.0 and worst < 1.0
    assert abs(np.degrees(arm.q)[2] - posture[2]) < 2.0


# ---- goals that move -------------------------------------------------------------------------------


def lag(moving_goal: float) -> float:
    """Largest error while a goal moves on at 40 px/s, after a second of getting used to it [px]."""
    arm, now = FakeRobot(START), [0.0]

    def measure() -> Array:
        shift = -np.array([40.0, 0.0, 40.0, 0.0]) * min(now[0], 4.0)
        return planar_arm_pixels(arm.q) - planar_arm_pixels(GOAL) - shift

    config = ServoConfig(moving_goal=moving_goal)
    servo = VisualServo(arm, measure, config, clock=lambda: now[0])
    worst = 0.0
    servo.learn()
    while now[0] < 4.0:
        state = servo.step()
        now[0] += PERIOD
        if now[0] > 2.0:
            worst = max(worst, float(np.abs(state.error).max()))
    return worst


def test_a_goal_whose_speed_is_learned_is_followed_with_a_fraction_of_the_lag() -> None:
    assert lag(1.0) < 0.5 * lag(0.0)
