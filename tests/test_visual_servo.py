"""The public servo with any robot, any features, any units, any number of cameras."""

from __future__ import annotations

import queue
import threading

import numpy as np
import pytest
from fake_robot import FakeRobot, FakeVelocityRobot, planar_arm_pixels

from vita.errors import BadInput
from vita.experiments.arms import arm_of
from vita.experiments.cameras import Cameras, look_at
from vita.servo import Joint, ServoConfig, VisualServo
from vita.servo.error_feed import ErrorFeed
from vita.servo.visual_servo import ServoState
from vita.types import RowLabel

START, GOAL = [0.3, 0.5, -0.4], np.array([0.7, 0.2, 0.1])
PERIOD = 1.0 / 30.0


class Ticks:
    """A clock that goes on by one period with every look at it."""

    now = 0.0

    def __call__(self) -> float:
        self.now += PERIOD
        return self.now


def plane_error(q: np.ndarray) -> np.ndarray:
    return planar_arm_pixels(q) - planar_arm_pixels(GOAL)


def planar_tip(q: np.ndarray) -> np.ndarray:
    """(2,) metres: the tip of the three-joint planar arm."""
    angles = np.cumsum(q)
    return np.array([np.cos(angles) @ [1, 1, 0.5], np.sin(angles) @ [1, 1, 0.5]])


# ---- any robot, any features, any units ------------------------------------------------------------


def test_a_prismatic_gantry_reaches_a_3d_point_in_metres_to_a_tenth_of_a_millimetre() -> None:
    """Neither joint nor error is an angle or a pixel; the axes are skewed, and one is weak."""
    axes = np.array([[1.0, 0.2, 0.0], [-0.1, 0.8, 0.3], [0.0, 0.1, 0.3]])
    gantry, goal = FakeRobot([0.1, -0.2, 0.0], limit=1.0, max_speed=0.5), np.array([0.25, 0.1, -0.05])
    servo = VisualServo(gantry, lambda: axes @ gantry.q - goal, tolerance=1e-4, clock=Ticks())
    result = servo.converge(timeout_s=20.0)
    assert result.outcome == "converged"
    assert np.abs(axes @ gantry.q - goal).max() < 1e-4
    np.testing.assert_allclose(servo.jacobian, axes, atol=0.05)


@pytest.mark.parametrize("unit", [1.0, np.degrees(1.0), 1000.0])
def test_the_units_of_the_joints_do_not_matter(unit: float) -> None:
    """Joints in radians, degrees or milliradians take the same way and give the same Jacobian."""
    ends, ways = [], []
    for u in (1.0, unit):
        arm = FakeRobot([u * x for x in START], limit=3.0 * u, max_speed=3.0 * u)
        states: list[ServoState] = []
        servo = VisualServo(
            arm,
            lambda arm=arm, u=u: plane_error(arm.q / u),
            joint_scale=u,
            clock=Ticks(),
            observe=states.append,
        )
        assert servo.converge().outcome == "converged"
        ways.append(np.array([state.q / u for state in states]))
        ends.append(servo.jacobian * u)
    np.testing.assert_allclose(ways[0], ways[1], atol=1e-6)
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e4])
def test_the_unit_of_the_error_does_not_matter(unit: float) -> None:
    def way(scale: float, tolerance: float | None) -> np.ndarray:
        arm, states = FakeRobot(START), []
        servo = VisualServo(
            arm, lambda: scale * plane_error(arm.q), tolerance=tolerance, clock=Ticks(), observe=states.append
        )
        assert servo.converge().outcome == "converged"
        assert np.abs(states[-1].error).max() <= 0.5 * scale
        return np.array([state.q for state in states])

    plain, scaled = way(1.0, None), way(unit, 0.5 * unit)
    np.testing.assert_allclose(plain, scaled, atol=1e-6)


def test_rows_of_different_units_each_have_their_own_tolerance() -> None:
    """A position in metres and a heading in radians in one task, with noise of each in its own size."""
    random, arm = np.random.default_rng(5), FakeRobot(START)
    target, heading = planar_tip(GOAL), GOAL.sum()

    def truth() -> np.ndarray:
        return np.array([*(planar_tip(arm.q) - target), arm.q.sum() - heading])

    tolerance = np.array([1e-3, 1e-3, 0.01])
    servo = VisualServo(
        arm, lambda: truth() + 0.2 * tolerance * random.standard_normal(3), tolerance=tolerance, clock=Ticks()
    )
    result = servo.converge(timeout_s=20.0)
    assert result.outcome == "converged"
    assert (np.abs(truth()) < 1.5 * tolerance).all()
    assert "x the tolerance" in result.message and "px" not in result.message


def test_one_joint_and_one_row_are_enough() -> None:
    arm = FakeRobot([0.2])
    servo = VisualServo(arm, lambda: 500.0 * np.sin(arm.q) - 150.0, clock=Ticks())
    assert servo.converge().outcome == "converged"
    assert abs(arm.q[0] - np.arcsin(0.3)) < 1e-3


def test_a_quadrotor_keeps_its_yaw_within_two_degrees_while_roll_pitch_and_height_are_driven() -> None:
    """Thesis 4.3.1: the servo has yaw alone; what it sees also moves with the rest, which it knows
    nothing of (row U5)."""

    class Quadrotor:
        joints = (Joint("yaw", -np.inf, np.inf, 1.5),)
        yaw, time = np.radians(-50.0), 0.0

        def position(self) -> np.ndarray:
            return np.array([self.yaw])

        def move_by(self, dq: np.ndarray) -> None:
            self.yaw, self.time = self.yaw + float(dq[0]), self.time + PERIOD

        def seen_angle(self) -> float:
            """Angle in the image, downward camera, of a line on the floor from 1 m to 3 m ahead [rad]."""
            t = self.time
            roll, pitch = 0.12 * np.sin(0.9 * t), 0.10 * np.sin(1.3 * t + 1.0)
            height = 2.0 + 0.5 * np.sin(0.5 * t)
            cx, sx, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
            c, s = np.cos(self.yaw), np.sin(self.yaw)
            tilt = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]]) @ np.array(
                [[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]
            )
            body = tilt @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            near, far = (body @ np.array([x, 0.0, -height]) for x in (-1.0, 1.0))
            way = far[:2] / far[2] - near[:2] / near[2]
            return float(np.arctan2(way[1], way[0]))

    drone = Quadrotor()
    upright = np.pi  # the floor is seen from above: depth is negative, the picture is turned by half
    random = np.random.default_rng(2)

    def measure() -> float:
        off = drone.seen_angle() - upright + 0.005 * random.standard_normal()
        return float((off + np.pi) % (2 * np.pi) - np.pi)

    servo = VisualServo(drone, measure, tolerance=np.radians(0.5), clock=lambda: drone.time)
    yaw: list[float] = []
    servo._observe = lambda state: yaw.append(float(state.q[0]))
    servo.follow(40.0)
    steady = np.degrees(yaw[-600:])
    assert drone.time > 39.0
    assert np.abs(steady).max() < 2.0


# ---- cameras and joints ----------------------------------------------------------------------------

RIG = look_at(np.array([[1.6, -0.9, 0.7], [1.7, -0.6, 0.8], [1.2, 1.2, 0.9]]), np.array([0.5, 0.0, 0.4]))
"""Two cameras close together, and a third that sees what they see badly."""
HAND = np.array([[0.0, 0.0, 0.1], [0.0, -0.08, 0.0], [0.0, 0.08, 0.0]])


def see(count: int, q: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Pixels of the hand's points of a WAM 4 in the first `count` cameras."""
    return Cameras(RIG[:count], 800.0).project(arm_of("wam4").points(q, points)).ravel()


def wam(start: np.ndarray) -> FakeRobot:
    arm = FakeRobot(list(start), max_speed=1.5)
    arm.joints = [
        Joint(f"j{i}", float(low), float(high), 1.5) for i, (low, high) in enumerate(arm_of("wam4").limits)
    ]
    return arm


def gap_mm(q: np.ndarray, goal: np.ndarray) -> float:
    """Largest true distance between a point of the hand and where it should be."""
    arm = arm_of("wam4")
    return 1e3 * float(np.linalg.norm(arm.points(q, HAND) - arm.points(goal, HAND), axis=-1).max())


def reach(count: int, seed: int, sigma: float) -> float:
    random = np.random.default_rng(seed)
    goal = np.array([0.1, 0.6, -0.1, 1.6]) + 0.15 * random.standard_normal(4)
    arm = wam(goal + 0.2 * random.standard_normal(4))
    noise = np.random.default_rng(seed + 1000)

    def measure() -> np.ndarray:
        error = see(count, arm.q, HAND) - see(count, goal, HAND)
        return error + sigma * noise.standard_normal(error.size)

    labels = [
        RowLabel("hand", f"camera {c}", f"p{k}{a}") for c in range(count) for k in range(3) for a in "uv"
    ]
    gaps: list[float] = []
    servo = VisualServo(
        arm, measure, ServoConfig(tolerance_px=0.05), labels=labels, clock=Ticks(),
        observe=lambda state: gaps.append(gap_mm(state.q, goal)),
    )  # fmt: skip
    if sigma == 0.0:
        assert servo.converge(timeout_s=20.0).outcome == "converged"
        return gaps[-1]
    servo.follow(5.0)  # Noise never lets it end.
    return float(np.mean(gaps[-60:]))


@pytest.mark.parametrize("count", [1, 2, 3])
def test_one_two_or_three_cameras_all_reach_the_goal(count: int) -> None:
    assert max(reach(count, seed, 0.0) for seed in range(4)) < 0.5


def test_a_third_camera_never_makes_it_worse() -> None:
    """The true 3D distance under tracker noise, over the same starts and goals (row C2)."""
    two, three = ([reach(count, seed, 0.2) for seed in range(5)] for count in (2, 3))
    assert np.mean(three) < 0.8 * np.mean(two)
    assert max(three) < 0.25


def test_joints_that_are_not_chosen_stay_exactly_where_they_are() -> None:
    """Exploring, servoing and at the end; the goal is reachable with the chosen ones."""
    goal, states = np.array([0.1, 0.6, -0.1, 1.6]), []
    arm = wam(goal + [0.2, 0.0, 0.0, -0.3])
    servo = VisualServo(
        arm, lambda: see(2, arm.q, HAND) - see(2, goal, HAND), ServoConfig(joints=(0, 3)), clock=Ticks(),
        observe=states.append,
    )  # fmt: skip
    assert servo.converge().outcome == "converged"
    ways = np.array([state.q for state in states])
    assert np.ptp(ways[:, [1, 2]], axis=0).tolist() == [0.0, 0.0]
    assert (np.ptp(ways[:, [0, 3]], axis=0) > 0.2).all()
    assert not servo.jacobian[:, [1, 2]].any()


# ---- velocity control (thesis eq. 5.1) -------------------------------------------------------------


def by_velocity(lag_s: float, sigma: float = 0.0, seed: int = 0) -> tuple[FakeVelocityRobot, VisualServo]:
    arm, random = FakeVelocityRobot(START, lag_s), np.random.default_rng(seed)

    def measure() -> np.ndarray:
        arm.wait()
        return plane_error(arm.q) + sigma * random.standard_normal(4)

    return arm, VisualServo(arm, measure, clock=lambda: arm.time)


@pytest.mark.parametrize("sigma", [0.0, 0.3])
@pytest.mark.parametrize("lag_s", [0.0, 0.03, 0.1])
def test_velocity_and_position_control_end_within_a_pixel_of_each_other(lag_s: float, sigma: float) -> None:
    """At 30 frames a second, for a robot that follows at once and for slower ones (row E13)."""
    random, still = np.random.default_rng(0), FakeRobot(START)
    noisy = lambda: plane_error(still.q) + sigma * random.standard_normal(4)  # noqa: E731
    assert VisualServo(still, noisy, clock=Ticks()).converge().outcome == "converged"
    moving, servo = by_velocity(lag_s, sigma)
    assert servo.converge().outcome == "converged"
    for _ in range(30):
        moving.wait()  # It coasts to rest by itself.
    apart = plane_error(moving.q) - plane_error(still.q)
    assert np.abs(apart).max() < 1.0


def test_without_lag_velocity_control_takes_the_very_same_way() -> None:
    position, velocity = FakeRobot(START), by_velocity(0.0)
    ways: list[list[np.ndarray]] = [[], []]
    first = VisualServo(position, lambda: plane_error(position.q), clock=Ticks())
    first._observe = lambda state: ways[0].append(state.q)
    velocity[1]._observe = lambda state: ways[1].append(state.q)
    first.converge()
    velocity[1].converge()
    np.testing.assert_allclose(ways[0], ways[1], atol=1e-9)


def test_a_robot_under_velocity_control_is_told_to_rest_at_every_end() -> None:
    arm, servo = by_velocity(0.03)
    servo.converge()
    assert not arm.wanted.any()

    def blind() -> np.ndarray:
        arm.wait()
        return np.full(4, np.nan) if arm.time > 1.0 else plane_error(arm.q)

    arm, _ = by_velocity(0.03)
    assert VisualServo(arm, blind, clock=lambda: arm.time).converge().reason == "tracker_lost"
    assert not arm.wanted.any()

    def broken() -> np.ndarray:
        arm.wait()
        if arm.time > 0.5:
            raise OSError("no camera")
        return plane_error(arm.q)

    arm, _ = by_velocity(0.03)
    with pytest.raises(OSError, match="no camera"):
        VisualServo(arm, broken, clock=lambda: arm.time).converge()
    assert arm.speed.any() and not arm.wanted.any()


# ---- how people drive it ---------------------------------------------------------------------------


def test_the_timeout_is_kept_to_a_period() -> None:
    """An arm too slow to be in time; learning counts too."""
    arm, clock = FakeRobot(START, max_speed=0.05), Ticks()
    result = VisualServo(arm, lambda: plane_error(arm.q), clock=clock).converge(timeout_s=1.5)
    assert result.outcome == "timeout" and 1.5 < clock.now - PERIOD <= 1.5 + PERIOD + 1e-9


def test_an_error_from_another_thread_is_servoed() -> None:
    """Vision in its own thread, coupled by the error alone (row C17)."""
    arm, feed, done = FakeRobot(START), ErrorFeed(4, timeout_s=10.0), threading.Event()

    def vision() -> None:
        while not done.wait(0.0005):
            feed.put(plane_error(arm.q))

    thread = threading.Thread(target=vision)
    thread.start()
    try:
        result = VisualServo(arm, feed).converge(timeout_s=30.0)
    finally:
        done.set()
        thread.join()
    assert result.outcome == "converged"
    assert np.abs(plane_error(arm.q)).max() < 0.6


def test_an_error_from_a_queue_is_servoed() -> None:
    """One error for each motion, computed elsewhere from what the robot did."""
    arm, moves, feed = FakeRobot(START), queue.Queue(), ErrorFeed(4, timeout_s=10.0, queued=True)

    def vision() -> None:
        while (q := moves.get()) is not None:
            feed.put(plane_error(q))

    def move_by(dq: np.ndarray) -> None:
        FakeRobot.move_by(arm, dq)
        moves.put(arm.q)

    arm.move_by = move_by  # type: ignore[method-assign]
    thread = threading.Thread(target=vision)
    thread.start()
    moves.put(arm.q)
    try:
        assert VisualServo(arm, feed).converge(timeout_s=30.0).outcome == "converged"
    finally:
        moves.put(None)
        thread.join()


def test_a_feed_that_falls_silent_holds_the_arm() -> None:
    arm, feed = FakeRobot(START), ErrorFeed(4, timeout_s=0.01)
    result = VisualServo(arm, feed).converge()
    assert result.reason == "tracker_lost" and arm.q.tolist() == START


def test_a_feed_does_not_give_an_error_from_before_the_call() -> None:
    feed = ErrorFeed(1, timeout_s=0.01)
    feed.put([1.0])
    assert np.isnan(feed()).all()
    queued = ErrorFeed(1, timeout_s=0.01, queued=True)
    queued.put([1.0])
    assert queued().tolist() == [1.0] and np.isnan(queued()).all()


def test_recorded_states_replay_to_the_bit() -> None:
    """What `observe` records is enough to run the same motion again, decision for decision (row C10)."""
    arm, random, states = FakeRobot(START), np.random.default_rng(3), []
    measure = lambda: plane_error(arm.q) + 0.3 * random.standard_normal(4)  # noqa: E731
    VisualServo(arm, measure, clock=Ticks(), observe=states.append).converge()

    class Tape:
        joints, number = arm.joints, -1

        def position(self) -> np.ndarray:
            return states[self.number].q

        def move_by(self, dq: np.ndarray) -> None:
            assert dq.tobytes() == states[self.number].dq.tobytes()

    tape, again = Tape(), []

    def errors() -> np.ndarray:
        tape.number += 1
        return states[tape.number].error

    servo = VisualServo(tape, errors, clock=lambda: states[tape.number].stamp, observe=again.append)
    servo.converge()
    assert len(again) == len(states) > 20
    assert all(a.jacobian.tobytes() == b.jacobian.tobytes() for a, b in zip(states, again, strict=True))


def test_stop_from_another_thread_rests_the_arm_within_a_period() -> None:
    arm, count = FakeRobot(START), [0]

    def measure() -> np.ndarray:
        count[0] += 1
        if count[0] == 5:
            thread = threading.Thread(target=servo.stop)
            thread.start()
            thread.join()
        return plane_error(arm.q)

    servo = VisualServo(arm, measure, clock=Ticks())
    result = servo.converge()
    assert result.reason == "stopped_by_user" and count[0] == 5
    assert servo.converge().outcome == "converged"  # and Start goes on


# ---- mistakes are named ----------------------------------------------------------------------------


def test_a_robot_that_cannot_be_moved_is_refused_with_what_to_write() -> None:
    class Statue:
        joints = (Joint("neck", -1.0, 1.0, 1.0),)

        def position(self) -> list[float]:
            return [0.0]

    with pytest.raises(BadInput, match=r"Statue offers neither move_by\(dq\) nor move_at\(velocity\)"):
        VisualServo(Statue(), lambda: [1.0])  # type: ignore[arg-type]
    with pytest.raises(BadInput, match="no 'velocity' control, only position"):
        VisualServo(FakeRobot(START), lambda: [1.0], control="velocity")


@pytest.mark.parametrize(
    ("option", "culprit"),
    [
        ({"labels": ["a", "b"]}, "labels: there are 2 for 4"),
        ({"weights": [1.0]}, "weights: there are 1 for 4"),
        ({"tolerance": [0.1, 0.1]}, "tolerance: there are 2 values for 4"),
        ({"tolerance": -1.0}, "tolerance: expected a number above zero"),
        ({"joint_scale": [1.0, 2.0]}, "joint_scale: give one value or one for each of the 3"),
        ({"joint_scale": 0.0}, "joint_scale: expected a number above zero"),
    ],
)
def test_options_of_the_wrong_size_are_named(option: dict, culprit: str) -> None:
    arm = FakeRobot(START)
    with pytest.raises(BadInput, match=culprit):
        VisualServo(arm, lambda: plane_error(arm.q), clock=Ticks(), **option).converge()


def test_the_worst_row_is_named_by_its_label() -> None:
    arm = FakeRobot(START)
    contradiction = np.array([0.0, 0.0, 40.0, 0.0])
    servo = VisualServo(
        arm,
        lambda: np.tile(plane_error(arm.q)[:2], 2) + contradiction,
        labels=["a", "b", "cap", "d"],
        clock=Ticks(),
    )
    result = servo.converge()
    assert result.reason == "stalled" and (
        "cap" in result.message or "'a" in result.message or "a " in result.message
    )
