"""The side-by-side experiment: its tasks, what each method is told, and how it judges who wins."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from vita.experiments.side_by_side import checks, told
from vita.experiments.side_by_side_found import (
    BOTH,
    CARRIED,
    EYE,
    FOCAL,
    MOVED,
    SPHERE,
    Found,
    methods_at,
    source,
)
from vita.experiments.side_by_side_methods import METHODS, Blind, Calibrated, Learning, TaughtLearning, Uvs
from vita.experiments.side_by_side_runs import Reach, run
from vita.experiments.side_by_side_tasks import (
    FAR_M,
    NEAR_M,
    T_TOOL_MARKER,
    TROUBLES,
    Carried,
    Tripod,
    clearance,
    draw,
)
from vita.experiments.stereo_cases import robot
from vita.impedance.inverse import solve
from vita.poses import pose_matrix
from vita.stereo.rotations import angle_between
from vita.vision.marker_pose import marker_pose

NONE, WRONG = TROUBLES["none"], TROUBLES[BOTH]


@pytest.fixture(scope="module")
def task():
    return draw("tx90", 1)


@pytest.mark.parametrize("name", ["tx90", "wam7"])
def test_a_task_is_as_far_as_it_should_be_and_within_reach(name):
    task = draw(name, 5)
    arm, q0 = robot(name)
    assert NEAR_M <= task.straight_m <= FAR_M
    assert not solve(arm, q0, task.T_goal, tries=0).limited
    assert 5.0 <= np.degrees(angle_between(task.T_start[:3, :3], task.T_goal[:3, :3])) <= 25.0
    assert np.degrees(angle_between(task.left[:3, :3], task.left_believed[:3, :3])) == pytest.approx(5.0)


def test_the_sphere_is_across_the_straight_way_and_clear_of_its_ends():
    task = draw("wam7", 0, sphere=True)
    arm, q0 = robot("wam7")
    middle = task.T_start.copy()
    middle[:3, 3] = 0.5 * (task.T_start[:3, 3] + task.T_goal[:3, 3])
    at = [solve(arm, q0, T, tries=0).q for T in (middle, task.T_goal)]
    free = [clearance(arm, q, (task.sphere,)) for q in (q0, *at)]
    assert free[0] > 0.1 and free[1] < 0.0 and free[2] > 0.1


def test_cameras_and_goal_stand_until_they_are_told_to_move(task):
    tripod, goal = Tripod(task.left, task.left_after), Carried(task)
    assert np.allclose(tripod(50.0), task.left) and np.allclose(goal(50.0), task.T_target)
    tripod.moved_s = goal.begin_s = 2.0
    assert np.linalg.norm(tripod(9.0)[:3, 3] - task.left[:3, 3]) == pytest.approx(0.05)
    assert np.degrees(angle_between(tripod(9.0)[:3, :3], task.left[:3, :3])) == pytest.approx(10.0)
    speed = np.linalg.norm(goal(4.001)[:3, 3] - goal(4.0)[:3, 3]) / 0.001
    assert speed == pytest.approx(0.05, rel=1e-4)


def test_uvs_does_the_same_to_the_bit_whatever_is_believed_of_the_cameras(task):
    joints = []
    for trouble in (NONE, WRONG):
        world = Uvs(task, trouble)
        world.start()
        for _ in range(72):
            world.tick()
        assert world.on_its_way
        joints.append(world.q)
    assert np.array_equal(*joints)


def test_what_is_taught_through_right_cameras_is_the_drawing_and_through_wrong_ones_another_thing(task):
    drawn = Learning(task, NONE).config
    right, wrong = (TaughtLearning(task, TROUBLES[name]).config for name in ("none", FOCAL))
    assert np.allclose(right.offset_xyz, drawn.offset_xyz, atol=2e-3)
    assert np.linalg.norm(np.subtract(wrong.offset_xyz, drawn.offset_xyz)) > 3e-3
    world = TaughtLearning(task, TROUBLES[FOCAL])
    assert world.controller.config.offset_xyz == wrong.offset_xyz
    # Seen through the same cameras, the goal is where the tool was seen.
    seen, sizes = world.shown, {"tool": drawn.tool_marker_m, "target": drawn.target_marker_m}
    tool, target = (marker_pose(world.believed, seen[n], sizes[n]).T_left_marker for n in ("tool", "target"))
    offset = pose_matrix(wrong.offset_xyz, wrong.offset_rpy_deg)
    assert np.allclose(target @ offset @ T_TOOL_MARKER, tool, atol=1e-9)
    assert np.allclose(world.goal(), task.T_goal)  # The truth by which it is judged stays the drawing's.


def test_a_wrong_hand_eye_stays_where_nothing_is_learned_and_a_right_one_arrives_at_once(task):
    right = run("stereo, calibrated, drawn", task, NONE)
    assert right.arrived and right.reason == "arrived" and right.learned_s == 0.0
    assert right.beyond_rad < 0.0 and right.speed < 1.0 + 1e-6
    assert right.gap_mm[0] > 1e3 * NEAR_M - 20.0 and right.gap_mm[-1] == pytest.approx(right.mm)
    wrong = run("stereo, calibrated, drawn", task, TROUBLES[EYE])
    assert 4.0 < wrong.deg < 6.0 and wrong.mm < 15.0 and not wrong.arrived


def test_the_classic_form_does_not_look_at_the_tool(task):
    ends = []
    for method in (Calibrated, Blind):
        world = method(task, TROUBLES[EYE])
        world.start()
        for _ in range(12):
            world.tick()
        assert not world.controller.notice  # Nobody says that the cameras have moved.
        ends.append(np.linalg.norm(world.controller.perception._bias))
    assert ends[0] > 0.02 and ends[1] == 0.0


GOOD = Reach(
    "uvs", "none", "tx90", 0, mm=1.0, deg=0.5, time_s=4.0, learned_s=2.0, way=1.1, clearance_mm=np.inf,
    beyond_rad=-0.1, speed=0.9, reason="arrived", stamp=np.arange(3.0), gap_mm=np.ones(3),
    tool=np.zeros((3, 3)),
)  # fmt: skip


def reach(method: str, trouble: str, **other: Any) -> Reach:
    return replace(GOOD, method=method, trouble=trouble, **other)


def everything() -> list[Reach]:
    return [reach(m, name) for name, trouble in TROUBLES.items() for m in methods_at(trouble)]


def test_who_touches_the_sphere_or_is_turned_has_not_arrived():
    assert reach("uvs", "none").arrived
    for bad in ({"mm": 5.1}, {"deg": 2.1}, {"clearance_mm": -1.0}):
        assert not reach("uvs", "none", **bad).arrived


def test_the_one_of_which_most_arrive_wins_then_the_sooner():
    runs = [
        reach("uvs", "none", mm=9.0, time_s=np.inf), reach("uvs", "none", seed=1, time_s=1.0),
        reach("uvs", "none", seed=2, time_s=1.0),
        reach("stereo, learning, drawn", "none", time_s=5.0),
        reach("stereo, calibrated, drawn", "none", time_s=2.0),
    ]  # fmt: skip
    order = Found(runs).best("none")
    assert order == ["stereo, calibrated, drawn", "stereo, learning, drawn", "uvs"]


def test_rows_are_repeated_only_for_what_a_method_is_not_given():
    for name, trouble in TROUBLES.items():
        for method, kind in METHODS.items():
            repeated = source(method, trouble) != name
            given = (trouble.focal == 1.0 or "focal" in kind.uses) and (
                not trouble.hand_eye_deg or "hand-eye" in kind.uses
            )
            assert repeated == (not given and method != "uvs")
    assert source("stereo, learning, drawn", WRONG) == FOCAL and source("uvs", WRONG) == BOTH


def test_the_report_has_every_cell():
    from vita.experiments import all as every

    report = every.EXPERIMENTS["side-by-side"].report((), [everything()], False)
    table = report.tables[0]
    assert {row[0] for row in table.rows} == set(TROUBLES) and {row[1] for row in table.rows} == set(METHODS)
    assert "cannot" in [row[2] for row in table.rows if row[1] == "uvs"]


@pytest.mark.parametrize(
    "number, method, trouble, worse",
    [
        (0, "uvs", "none", {"beyond_rad": 0.01}),
        (1, "uvs", "none", {"speed": 1.1}),
        (2, "uvs", BOTH, {"tool": np.ones((3, 3))}),
        (3, "stereo, learning, drawn", "none", {"mm": 6.0}),
        (4, "stereo, learning, drawn", MOVED, {"mm": 6.0}),
        (5, "stereo, learning, drawn", CARRIED, {"mm": 6.0}),
        (6, "stereo, calibrated, drawn", SPHERE, {"clearance_mm": -1.0}),
    ],
)
def test_each_check_sees_what_it_is_for(number, method, trouble, worse):
    runs = everything()
    place = [(r.method, r.trouble) for r in runs].index((method, trouble))
    assert all(check.met for check in checks(Found(runs))) and told(Found(runs)) == 0.0
    runs[place] = replace(runs[place], **worse)
    assert [k for k, check in enumerate(checks(Found(runs))) if not check.met] == [number]
