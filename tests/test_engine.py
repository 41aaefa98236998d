"""Laws of the engine: order, edits, undo, live settings, and what is refused."""

from __future__ import annotations

import itertools
from typing import cast

import numpy as np
import pytest
from sim_rig import KinematicRig, scenario

from vita import commands as cmd
from vita.engine import Engine
from vita.errors import BadInput, NotNow, UnknownName
from vita.scenario.schema import Scenario
from vita.snapshot import Snapshot
from vita.types import JointStep


def engine(task: Scenario | None = None) -> Engine:
    return Engine(KinematicRig(), task or scenario())  # type: ignore[arg-type]


def rig(e: Engine) -> KinematicRig:
    return cast(KinematicRig, e.rig)


def step_of(e: Engine) -> JointStep:
    assert e.last_step is not None
    return e.last_step


def run(e: Engine, ticks: int = 600) -> Snapshot:
    snapshot = e.tick()
    for _ in range(ticks):
        if snapshot.status.state not in ("learning", "servoing"):
            break
        snapshot = e.tick()
    return snapshot


def test_start_learns_then_servoes_then_is_done() -> None:
    e = engine()
    e.apply(cmd.Start())
    states = []
    for _ in range(600):
        states.append(e.tick().status.state)
        if states[-1] == "done":
            break
    assert [state for state, _ in itertools.groupby(states)] == ["learning", "servoing", "done"]
    assert e.tick().error.largest <= e.controller.config.tolerance_px


def test_nothing_is_commanded_before_start_and_after_the_end() -> None:
    e = engine()
    for _ in range(5):
        e.tick()
    assert set(rig(e).commands) == {None}
    e.apply(cmd.Start())
    run(e)
    q = rig(e).q.copy()
    for _ in range(10):
        e.tick()
        assert e.last_step is None
    np.testing.assert_array_equal(rig(e).q, q)


def test_stop_rests_the_arm_in_the_same_tick_in_every_moving_state() -> None:
    for ticks in (3, 8, 14, 20):
        e = engine()
        e.apply(cmd.Start())
        for _ in range(ticks):
            e.tick()
        assert e.controller.moving
        e.stop()
        assert rig(e).commands[-1] is None
        q = rig(e).q.copy()
        snapshot = e.tick()
        assert (snapshot.status.state, snapshot.status.reason) == ("hold", "stopped_by_user")
        np.testing.assert_array_equal(rig(e).q, q)


def test_stop_is_idempotent_and_changes_nothing_at_rest() -> None:
    e = engine()
    before = e.tick().status
    e.stop()
    e.stop()
    assert e.tick().status == before


def test_an_empty_task_cannot_start() -> None:
    e = engine(scenario(tracker=(), constraint=()))
    with pytest.raises(BadInput, match="no constraint yet"):
        e.apply(cmd.Start())
    assert e.tick().status.state == "idle"


def test_a_lost_tracker_holds_in_the_same_tick_and_is_named_and_nothing_is_lost() -> None:
    e = engine()
    e.apply(cmd.Start())
    for _ in range(18):
        e.tick()
    e.apply(cmd.Perform("lose_tracker", {"tracker": "tip_left", "for_s": 0.5}))
    q, snapshot = rig(e).q.copy(), e.tick()
    assert (
        snapshot.status.reason == "tracker_lost" and "'tip_left' in the left view" in snapshot.status.message
    )
    assert rig(e).commands[-1] is None
    moved = np.abs(e.tick().q - q).max()
    assert moved <= 1.5 / 30 + 1e-9
    assert len(snapshot.scenario.constraint) == 2
    with pytest.raises(BadInput, match="tip_left"):
        e.apply(cmd.Start())
    for _ in range(20):
        e.tick()
    e.apply(cmd.Start())
    assert run(e).status.state == "done"


EDITS = [
    cmd.AddTracker("left", (300.0, 200.0), "fixed", "extra"),
    cmd.RenameTracker("tip_left", "other"),
    cmd.DeleteTracker("tip_left"),
    cmd.DeleteConstraint("meet left"),
    cmd.SetWeight("meet left", 3.0),
    cmd.SetPriority("meet left", 2),
    cmd.ClearTask(),
    cmd.AddConstraint("point_to_point", ("goal_left", "tip_left"), name="again"),
]


@pytest.mark.parametrize("edit", EDITS, ids=lambda e: type(e).__name__)
def test_undo_then_redo_brings_back_exactly_what_was_there(edit: cmd.Command) -> None:
    e = engine()
    before = e.editor.task
    e.apply(edit)
    after = e.editor.task
    assert after != before
    e.apply(cmd.Undo())
    assert e.editor.task == before
    e.apply(cmd.Redo())
    assert e.editor.task == after


@pytest.mark.parametrize("edit", EDITS, ids=lambda e: type(e).__name__)
def test_no_edit_is_taken_while_the_arm_moves(edit: cmd.Command) -> None:
    e = engine()
    e.apply(cmd.Start())
    e.tick()
    before = e.editor.task
    with pytest.raises(NotNow, match="stop the arm first"):
        e.apply(edit)
    assert e.editor.task is before and e.controller.moving


BAD_EDITS = [
    (cmd.AddTracker("top", (3.0, 3.0)), "unknown camera 'top'.*left, right"),
    (cmd.AddTracker("left", (float("nan"), 3.0)), "finite"),
    (cmd.AddTracker("left", (3.0, 3.0), "fixed", "tip_left"), "already"),
    (cmd.AddTracker("left", (3.0, 3.0), "fixed", "<b>"), "letters"),
    (cmd.AddTracker("left", (3.0, 3.0), "sonar"), "unknown tracker 'sonar'.*auto"),
    (cmd.MoveTracker("nobody", (3.0, 3.0)), "unknown tracker 'nobody'"),
    (cmd.RenameTracker("tip_left", "goal_left"), "already"),
    (cmd.DeleteTracker("tip_lef"), "Did you mean 'tip_left'"),
    (cmd.AddConstraint("point_to_pint", ("tip_left", "goal_left")), "Did you mean 'point_to_point'"),
    (cmd.AddConstraint("point_to_point", ("tip_left", "goal_right")), "one view"),
    (cmd.AddConstraint("point_to_point", ("tip_left",)), "takes 2 points"),
    (cmd.AddConstraint("point_to_point", ("tip_left", "tip_left")), "twice"),
    (cmd.AddConstraint("point_to_point", ("tip_left", "nobody")), "unknown tracker"),
    (cmd.AddConstraint("point_to_point", ("tip_left", "goal_left"), -1.0), "weight"),
    (cmd.SetWeight("meet left", float("nan")), "weight"),
    (cmd.SetPriority("meet left", 0), "priority"),
    (cmd.SetPriority("meet left", True), "priority"),
    (cmd.SetPriority("meet top", 2), "unknown constraint"),
    (cmd.SetWeight("meet top", 1.0), "unknown constraint"),
    (cmd.SetServo("gain", float("inf")), "servo.gain"),
    (cmd.SetServo("lambda", 0.1), "unknown setting"),
    (cmd.SetServo("joints", (0, 9)), "joints 0 to 2"),
    (cmd.SetLimits("speed_rad_s", -1.0), "limits.speed_rad_s"),
    (cmd.SetJointLimit(9), "no joint 9"),
    (cmd.SetJointLimit(0, lower_deg=30.0, upper_deg=10.0), "must be below"),
    (cmd.Perform("explode", {}), "unknown action"),
    (cmd.Perform("lose_tracker", {"tracker": "nobody"}), "unknown tracker"),
    (cmd.Undo(), "nothing to undo"),
]


@pytest.mark.parametrize(("command", "message"), BAD_EDITS, ids=lambda x: repr(x)[:50])
def test_bad_input_is_refused_with_the_culprit_and_nothing_changes(
    command: cmd.Command, message: str
) -> None:
    e = engine()
    before, config, limits = e.editor.task, e.controller.config, e.limits
    with pytest.raises(BadInput, match=message):
        e.apply(command)
    assert e.editor.task is before and e.controller.config == config and e.limits == limits
    e.tick()
    assert rig(e).commands[-1] is None


def test_an_unknown_command_is_refused() -> None:
    with pytest.raises(UnknownName, match="str"):
        engine().apply("start")  # type: ignore[arg-type]


def test_a_setting_changed_in_motion_is_in_force_from_the_next_tick_on_without_a_leap() -> None:
    def first_steps(gain: float | None) -> float:
        """Length of the second step of servoing, the gain having been changed after the first."""
        e = engine()
        e.apply(cmd.SetServo("gain", 0.1))
        e.apply(cmd.Start())
        while e.tick().status.state != "servoing":
            pass
        if gain is not None:
            e.apply(cmd.SetServo("gain", gain))
            assert e.tick().scenario.servo.gain == gain
        else:
            e.tick()
        return float(np.linalg.norm(step_of(e).dq))

    assert first_steps(0.05) < 0.8 * first_steps(None) < 0.8 * first_steps(0.6) < 0.8 * 4 * first_steps(None)


def test_limits_changed_in_motion_are_in_force_at_the_next_tick() -> None:
    e = engine()
    e.apply(cmd.Start())
    while e.tick().status.state != "servoing":
        pass
    e.apply(cmd.SetLimits("speed_rad_s", 0.1))
    before = rig(e).q.copy()
    e.tick()
    assert np.abs(rig(e).q - before).max() <= 0.1 / 30 + 1e-12
    e.apply(cmd.SetJointLimit(1, upper_deg=float(np.rad2deg(rig(e).q[1]))))
    top = rig(e).q[1]
    for _ in range(60):
        e.tick()
        assert rig(e).q[1] <= top + 1e-9


def test_a_limit_that_was_narrowed_can_be_widened_again_up_to_the_robots_own() -> None:
    e = engine()
    e.apply(cmd.SetJointLimit(0, upper_deg=20.0))
    assert rig(e).joints[0].upper == pytest.approx(np.deg2rad(20))
    e.apply(cmd.SetJointLimit(0, upper_deg=100.0))
    assert rig(e).joints[0].upper == pytest.approx(np.deg2rad(100))
    e.apply(cmd.SetLimits("acceleration_rad_s2", 3.0))
    assert rig(e).acceleration == 3.0


def test_a_fault_of_the_gate_is_a_fault_of_the_state() -> None:
    e = engine()
    e.apply(cmd.Start())
    e.tick()
    rig(e).gate_fault = "Joint j1 does not follow."
    snapshot = e.tick()
    assert (snapshot.status.state, snapshot.status.reason) == ("fault", "gate_fault")
    assert "j1" in snapshot.status.message and rig(e).commands[-1] is None


def test_a_joint_that_is_not_in_use_never_moves() -> None:
    e = engine()
    e.apply(cmd.SetServo("joints", (0, 2)))
    e.apply(cmd.Start())
    start = rig(e).q[1]
    for _ in range(200):
        e.tick()
        assert rig(e).q[1] == start


def test_a_saved_task_is_the_one_that_was_drawn_not_where_it_ended() -> None:
    e = engine()
    e.apply(cmd.AddTracker("left", (300.0, 200.0), "fixed", "mark"))
    drawn = e.tick().scenario
    e.apply(cmd.Start())
    run(e)
    saved = e.tick().scenario
    assert saved == drawn
    np.testing.assert_allclose(np.deg2rad(saved.scene.q0_deg or ()), [0.3, 0.5, -0.4], atol=1e-6)


def test_reset_puts_the_arm_back_and_the_task_can_run_again() -> None:
    e = engine()
    e.apply(cmd.Start())
    assert run(e).status.state == "done"
    e.apply(cmd.ResetArm())
    snapshot = e.tick()
    np.testing.assert_allclose(snapshot.q, [0.3, 0.5, -0.4], atol=1e-7)
    assert snapshot.status.state == "idle" and snapshot.error.largest > 20
    e.apply(cmd.Start())
    assert run(e).status.state == "done"


def test_reset_goes_where_the_task_was_drawn_also_after_a_stop_half_way_and_edits() -> None:
    e = engine()
    e.apply(cmd.Start())
    while e.tick().status.state != "servoing":
        pass
    e.stop()
    e.tick()
    e.apply(cmd.SetWeight("meet left", 2.0))
    e.apply(cmd.RenameTracker("tip_left", "tip"))
    e.apply(cmd.Start())
    e.tick()
    e.stop()
    e.apply(cmd.ResetArm())
    np.testing.assert_allclose(e.tick().q, [0.3, 0.5, -0.4], atol=1e-7)


def test_a_tracker_placed_at_another_pose_makes_that_pose_the_start() -> None:
    """Its pixel belongs to that pose; together with another one the file would show it elsewhere."""
    e = engine()
    e.apply(cmd.Start())
    run(e)
    q = e.tick().q
    e.apply(cmd.AddTracker("left", (300.0, 200.0), "fixed", "mark"))
    saved = e.tick().scenario
    np.testing.assert_allclose(np.deg2rad(saved.scene.q0_deg or ()), q, atol=1e-6)


def test_a_fault_needs_an_acknowledgement_which_never_moves_the_arm() -> None:
    e = engine()
    e.fail("internal_error", "test")
    with pytest.raises(NotNow, match="acknowledge"):
        e.apply(cmd.Start())
    q = rig(e).q.copy()
    e.apply(cmd.Acknowledge())
    for _ in range(5):
        assert e.tick().status.state == "idle"
    np.testing.assert_array_equal(rig(e).q, q)


def test_loading_a_task_of_another_scene_is_refused_by_the_engine() -> None:
    from dataclasses import replace

    e = engine()
    other = scenario()
    other = replace(other, scene=replace(other.scene, robot="wam4"))
    with pytest.raises(BadInput, match="another scene"):
        e.apply(cmd.LoadTask(other))


def test_a_task_that_cannot_be_placed_leaves_the_old_one() -> None:
    from dataclasses import replace

    e = engine()
    before = e.editor.task
    bad = replace(scenario(), constraint=(*scenario().constraint, scenario().constraint[0]))
    with pytest.raises(BadInput, match="already"):
        e.apply(cmd.LoadTask(bad))
    assert e.editor.task is before


def test_adding_a_tracker_does_not_change_the_noise_of_the_others() -> None:
    from dataclasses import replace

    from vita.scenario.schema import NoiseSpec

    noisy = tuple(replace(t, noise=NoiseSpec("gaussian", 0.3)) for t in scenario().tracker)
    plain, more = engine(scenario(tracker=noisy)), engine(scenario(tracker=noisy))
    more.apply(cmd.AddTracker("left", (30.0, 20.0), "fixed", "extra"))
    for _ in range(5):
        a, b = plain.tick(), more.tick()
    # The edit itself took one more look at each tracker, so compare statistics, then streams.
    assert a.features["tip_left"].uv.tolist() != a.features["tip_right"].uv.tolist()
    assert set(b.features) == {*a.features, "extra"}


def test_snapshots_are_frozen_and_complete() -> None:
    e = engine()
    snapshot = e.tick()
    with pytest.raises(ValueError, match="read-only"):
        snapshot.q[0] = 1.0
    assert set(snapshot.frames) == {"left", "right"} and set(snapshot.features) == set(e.editor.task.names)
    assert len(snapshot.error.labels) == 4 and snapshot.timing.ms.keys() >= {"observe", "track", "servo"}
