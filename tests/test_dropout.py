"""Laws of going on without a lost tracker's rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_robot import FakeRobot, planar_arm_pixels
from hypothesis import given, settings
from hypothesis import strategies as st
from sim_rig import GOAL, KinematicRig, scenario

from vita import commands as cmd
from vita.engine import Engine
from vita.scenario.schema import AttachSpec, ConstraintSpec, Scenario, TrackerSpec
from vita.servo import ServoConfig, VisualServo
from vita.servo.dropout import KEPT_STRENGTH, RECOVERED_PERIODS, why_not
from vita.types import RowLabel

START, TARGET = np.array([0.3, 0.5, -0.4]), np.array([0.7, 0.2, 0.1])


def labels(*cameras: str) -> list[RowLabel]:
    return [RowLabel(f"row {i}", camera, "u") for i, camera in enumerate(cameras)]


# ---- the rule --------------------------------------------------------------------------------------


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 7), st.integers(1, 16), st.data())
def test_going_on_needs_rows_to_spare_a_view_of_each_camera_and_half_the_strength(
    seed: int, n: int, m: int, data: st.DataObject
) -> None:
    rng = np.random.default_rng(seed)
    jacobian = rng.normal(size=(m, n)) * rng.choice([1.0, 0.1], size=(m, 1)) * 200
    names = labels(*data.draw(st.lists(st.sampled_from("ab"), min_size=m, max_size=m)))
    seen = np.array(data.draw(st.lists(st.booleans(), min_size=m, max_size=m)))
    why = why_not(jacobian, seen, names)
    whole = np.linalg.svd(jacobian, compute_uv=False)[:6]
    held = int(np.count_nonzero(whole > 0.02 * whole[0]))
    enough = int(seen.sum()) >= n + 2
    views = {x.camera for x in names} == {x.camera for x, here in zip(names, seen, strict=True) if here}
    if enough and views:
        part = np.linalg.svd(jacobian[seen], compute_uv=False)
        assert (why == "") == bool(part[held - 1] >= KEPT_STRENGTH * whole[held - 1])
    else:
        assert why


def test_a_motion_that_only_the_lost_rows_tell_is_missed() -> None:
    jacobian = np.array([[300.0, 0], [0, 300.0], [300.0, 0], [0, 1.0], [300.0, 0], [300.0, 0]])
    seen = np.array([True, False, True, True, True, True])
    assert "apart" in why_not(jacobian, seen, labels(*"aaaaaa"))


# ---- the public servo ------------------------------------------------------------------------------


class Camera:
    """Eight rows of the planar arm, of which those in `lost` are NaN."""

    def __init__(self, arm: FakeRobot) -> None:
        self.arm, self.lost = arm, np.zeros(8, bool)

    def __call__(self) -> np.ndarray:
        here = planar_arm_pixels(self.arm.q) - planar_arm_pixels(TARGET)
        return np.where(self.lost, np.nan, np.concatenate([here, 0.7 * here + 0.2 * here[::-1]]))


def servo_with_rows_to_spare() -> tuple[FakeRobot, Camera, VisualServo]:
    arm = FakeRobot(list(START), max_speed=0.6)
    camera = Camera(arm)
    servo = VisualServo(arm, camera, ServoConfig(gain=0.8))
    servo.learn()
    return arm, camera, servo


def test_with_rows_to_spare_the_arm_goes_on_at_half_speed_and_back_to_full_when_they_return() -> None:
    arm, camera, servo = servo_with_rows_to_spare()
    assert np.abs(servo.step().dq).max() == pytest.approx(0.6 / 30)
    camera.lost[:2] = True
    state = servo.step()
    assert state.status.degraded and (state.status.state, state.status.reason) == ("servoing", "rows_lost")
    assert "6 of 8" in state.status.message
    assert np.abs(state.dq).max() == pytest.approx(0.3 / 30)
    camera.lost[:] = False
    for _ in range(RECOVERED_PERIODS - 1):
        state = servo.step()
        assert state.status.degraded and np.abs(state.dq).max() <= 0.3 / 30 + 1e-12
    servo.step()
    assert not servo.step().status.degraded


def test_it_converges_without_the_lost_rows_and_says_which_were_not_seen() -> None:
    arm, camera, servo = servo_with_rows_to_spare()
    servo.step()
    camera.lost[[1, 4]] = True
    result = servo.converge(timeout_s=60)
    assert result.outcome == "converged" and "row 1" in result.message and "row 4" in result.message
    camera.lost[:] = False
    assert np.abs(camera()).max() < 1.0


@pytest.mark.parametrize("period", [0, 5, 20])
def test_rows_that_come_and_go_are_neither_divergence_nor_stall(period: int) -> None:
    """A row that returns with hundreds of pixels of error is no leap of the error."""
    arm, camera, servo = servo_with_rows_to_spare()
    for k in range(40):
        camera.lost[:3] = k % 7 < 3 and k >= period
        assert servo.step().status.state in ("servoing", "done")
    camera.lost[:] = False
    assert servo.converge(timeout_s=60).outcome == "converged"


def test_too_few_rows_hold_the_arm_in_the_same_period_and_the_reason_is_told() -> None:
    arm, camera, servo = servo_with_rows_to_spare()
    servo.step()
    camera.lost[:4] = True
    before = arm.q.copy()
    state = servo.step()
    assert (state.status.state, state.status.reason) == ("hold", "tracker_lost")
    assert "4 error rows are left and 3 joints need 5" in state.status.message
    np.testing.assert_array_equal(arm.q, before)


def test_a_row_lost_while_learning_holds_the_arm() -> None:
    arm = FakeRobot(list(START))
    camera = Camera(arm)
    servo = VisualServo(arm, camera)
    for _ in range(3):
        servo.step()
    camera.lost[0] = True
    state = servo.step()
    assert (state.status.state, state.status.reason) == ("hold", "tracker_lost")
    assert "learning" in state.status.message


# ---- the engine ------------------------------------------------------------------------------------


def three_points_in_each_view() -> Scenario:
    base = scenario()
    trackers, constraints = list(base.tracker), list(base.constraint)
    for camera in ("left", "right"):
        for i, shift in enumerate([(0.0, 0.1, 0.0), (0.1, 0.0, 0.0)]):
            goal = tuple(np.add(GOAL, shift))
            trackers += [
                TrackerSpec(f"p{i}_{camera}", camera, "projected", attach=AttachSpec("tool", shift)),
                TrackerSpec(f"g{i}_{camera}", camera, "projected", attach=AttachSpec("world", goal)),
            ]
            constraints.append(
                ConstraintSpec(f"also {i} {camera}", "point_to_point", (f"p{i}_{camera}", f"g{i}_{camera}"))
            )
    return replace(base, tracker=tuple(trackers), constraint=tuple(constraints))


def moving_engine() -> tuple[KinematicRig, Engine]:
    rig = KinematicRig()
    engine = Engine(rig, three_points_in_each_view())
    engine.apply(cmd.Start())
    for _ in range(200):
        if engine.tick().status.state == "servoing":
            return rig, engine
    raise AssertionError("learning did not end")


def test_the_engine_names_the_lost_tracker_and_asks_the_gate_for_half_speed() -> None:
    rig, engine = moving_engine()
    engine.apply(cmd.Perform("lose_tracker", {"tracker": "p0_left", "for_s": 0.2}))
    status = engine.tick().status
    assert status.degraded and "'p0_left' in the left view" in status.message
    assert "10 of 12" in status.message
    assert rig.commands[-1] is not None and rig.commands[-1].speed_scale == 0.5
    for _ in range(400):
        status = engine.tick().status
        if status.state != "servoing":
            break
    assert status.state == "done" and not status.degraded


def test_losing_a_whole_camera_holds_the_arm_however_many_rows_are_left() -> None:
    rig, engine = moving_engine()
    for name in ("tip_left", "p0_left", "p1_left"):
        engine.apply(cmd.Perform("lose_tracker", {"tracker": name, "for_s": 9.0}))
    status = engine.tick().status
    assert (status.state, status.reason) == ("hold", "tracker_lost")
    assert "nothing is seen in the left view" in status.message
    assert rig.commands[-1] is None
