"""The search for other poses at which a task counts as done, against closed forms of our own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import vita
from vita.scenario.checkup import Checkup, check_up
from vita.scenario.second_solution import Search, difference, find_second_solutions, spread_rotations
from vita.scenario.view_check import point_views, view_findings
from vita.sim.many_fits import fit, jacobian
from vita.sim.twin import Twin

pytestmark = pytest.mark.timeout(300)


@cache
def searched(name: str) -> Search:
    return find_second_solutions(vita.load(name))


# The wrench of thesis eq. 3.5 -----------------------------------------------------------------------


def wrench_rows(T: np.ndarray, eyes: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """(12,) eq. 3.5 with lines as unit normals, written out here for two pinholes of 900 px that look along
    their +z: `goal` (4, 3) are the places of jaw a, jaw b, grip a, grip b."""
    tool = np.array([[0, -0.02, 0.12], [0, 0.02, 0.12], [0, -0.01, 0.04], [0, 0.01, 0.07]])
    line = np.array([[0, -0.01, 0.12], [0, 0.01, 0.12]])
    moving = tool @ T[:3, :3].T + T[:3, 3]
    rows = []
    for eye in eyes:
        def see(p: np.ndarray, eye: np.ndarray = eye) -> np.ndarray:
            local = (p - eye[:3, 3]) @ eye[:3, :3]
            return 900 * local[..., :2] / local[..., 2:]

        rows += [*(see(moving[0]) - see(goal[0])), *(see(moving[1]) - see(goal[1]))]
        for k in (0, 1):
            a, b = see(line[k]), see(goal[2 + k])
            along = (b - a) / np.linalg.norm(b - a)
            away = see(moving[2 + k]) - a
            rows.append(along[0] * away[1] - along[1] * away[0])
    return np.array(rows)


def closed_form_scene() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Eyes, goals, the wanted pose (identity) and the one that is turned by half about jaw a - jaw b."""
    eyes = []
    for angle in (-0.5, 0.6):
        T = np.eye(4)
        turn = Rotation.from_euler("y", -np.pi / 2) * Rotation.from_euler("x", angle)
        T[:3, :3] = turn.as_matrix()
        T[:3, 3] = np.array([0, 0, 0.1]) - 0.8 * T[:3, 2]
        eyes.append(T)
    goal = np.array([[0, -0.02, 0.12], [0, 0.02, 0.12], [0, -0.01, 0.04], [0, 0.01, 0.07]])
    flip = np.eye(4)
    flip[:3, :3] = np.diag([-1.0, 1.0, -1.0])
    flip[2, 3] = 0.24
    return np.array(eyes), goal, np.eye(4), flip


def test_the_stack_has_rank_six_and_no_error_at_both_poses() -> None:
    eyes, goal, wanted, flip = closed_form_scene()
    for T in (wanted, flip):
        assert np.abs(wrench_rows(T, eyes, goal)).max() <= 1e-9
        columns = []
        for axis in np.eye(6) * 1e-6:
            sides = []
            for step in (axis, -axis):
                move = np.eye(4)
                move[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix()
                move[:3, 3] = step[3:]
                sides.append(wrench_rows(move @ T, eyes, goal))
            columns.append((sides[0] - sides[1]) / 2e-6)
        values = np.linalg.svd(np.stack(columns, axis=1), compute_uv=False)
        assert values[-1] > 1e-3 * values[0], "rank below six"


def test_the_search_finds_the_flip_of_the_wrench() -> None:
    found = searched("wrench_flip")
    assert found.first is not None and found.first.rank == 6 and found.first.residual_px <= 1e-9
    (other,) = found.others
    assert other.rank == 6 and other.residual_px <= 1e-9 and other.reachable
    assert other.angle_deg == pytest.approx(180.0, abs=1e-3)
    np.testing.assert_allclose(np.abs(other.axis), [0, 1, 0], atol=1e-4)
    assert found.farthest.startswith("grip_a") and found.farthest_px > 100


def test_the_joints_that_it_gives_do_meet_the_task() -> None:
    twin = Twin(vita.load("wrench_flip"))
    (other,) = searched("wrench_flip").others
    assert other.q is not None
    # The arm was asked to come within a tenth of a millimetre.
    assert np.abs(twin.error(twin.bodies(other.q))).max() < 0.5
    for q, joint in zip(other.q, twin.joints, strict=True):
        assert joint.lower <= q <= joint.upper


@pytest.mark.parametrize("name", ["wrench", "wrench_fixed"])
def test_a_wrench_that_is_tied_down_has_one_solution(name: str) -> None:
    found = searched(name)
    assert found.first is not None and found.first.rank == 6 and not found.skipped and not found.others


def test_one_more_constraint_removes_the_flip() -> None:
    """The very same scene, and one more constraint."""
    scenario, extra = vita.load("wrench_flip"), vita.load("wrench_fixed").constraint
    names = {c.name for c in scenario.constraint}
    (more,) = [c for c in extra if c.name not in names]
    found = find_second_solutions(replace(scenario, constraint=(*scenario.constraint, more)))
    assert found.first is not None and not found.skipped
    # From this start the hand stands beside the flip, which is no solution any more.
    assert not found.others and found.first.residual_px < 1e-6


def test_three_points_in_one_view_have_several_poses() -> None:
    """Perspective three point problem: up to four solutions, all of them met to rounding."""
    found = searched("eye_in_hand")
    assert found.first is not None and 1 <= len(found.others) <= 3
    assert all(s.residual_px < 1e-6 and s.rank == 6 for s in (found.first, *found.others))


@pytest.mark.parametrize("name", ["point_to_point", "point_to_point_wam4", "line_to_line"])
def test_a_task_that_leaves_motions_free_is_not_searched(name: str) -> None:
    found = searched(name)
    assert "free" in found.skipped and not found.others


def test_goals_that_contradict_each_other_are_found_out() -> None:
    scenario = vita.load("wrench")
    moved = tuple(
        replace(t, at=(t.at[0], t.at[1] + 60.0)) if t.name == "bolt_jaw_a_l" and t.at else t
        for t in scenario.tracker
    )
    found = find_second_solutions(replace(scenario, tracker=moved))
    assert "cannot be met" in found.skipped


# Its parts ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["wrench", "eye_in_hand"])
def test_the_twin_sees_what_the_simulator_sees(name: str) -> None:
    from vita.sim.lockstep import LockstepRig

    scenario = vita.load(name)
    twin = Twin(scenario)
    bodies = twin.bodies(twin.q0)
    with LockstepRig(scenario) as rig:
        seen = rig.observe()
        for body, T in rig.poses().items():
            np.testing.assert_allclose(bodies[body], T, atol=1e-6, err_msg=body)
        for spec in scenario.tracker:
            if spec.attach is not None:
                ours = twin.pixels(bodies)[spec.name][0]
                theirs = rig.project(spec.camera, spec.attach.body, spec.attach.point)
                np.testing.assert_allclose(ours, theirs, atol=1e-2)
    np.testing.assert_allclose(seen.q, twin.q0, atol=1e-6)


def test_a_click_is_taken_back_to_the_point_that_it_hit() -> None:
    """A task drawn by clicks (`at`) has the same twin as one whose points are attached."""
    scenario = vita.load("wrench")
    twin = Twin(scenario)
    pixels = twin.pixels(twin.bodies(twin.q0))
    places = {name: tuple(uv[0].tolist()) for name, uv in pixels.items()}
    clicked = tuple(replace(t, at=places[t.name], attach=None) if t.attach else t for t in scenario.tracker)
    again = Twin(replace(scenario, tracker=clicked))
    for name, mark in twin.marks.items():
        assert again.marks[name].body == mark.body
        np.testing.assert_allclose(again.marks[name].points, mark.points, atol=1e-6, err_msg=name)


def test_many_poses_at_once_are_the_same_as_one_by_one() -> None:
    twin = Twin(vita.load("eye_in_hand"))
    q = twin.q0 + np.random.default_rng(0).normal(0, 0.05, (5, 7))
    together = twin.error(twin.bodies(q))
    np.testing.assert_allclose(together, [twin.error(twin.bodies(one)) for one in q], atol=1e-9)


def test_the_tool_jacobian_is_the_derivative_of_the_pose() -> None:
    twin = Twin(vita.load("wrench"))
    J, step = twin.tool_jacobian(twin.q0), 1e-6
    for i, dq in enumerate(step * np.eye(7)):
        ahead, behind = (twin.bodies(twin.q0 + s * dq)["tool"] for s in (1, -1))
        np.testing.assert_allclose((ahead - behind)[:3, 3] / (2 * step), J[:3, i], atol=1e-8)
        turn = Rotation.from_matrix(ahead[:3, :3] @ behind[:3, :3].T).as_rotvec() / (2 * step)
        np.testing.assert_allclose(turn, J[3:, i], atol=1e-8)


def test_many_fits_find_the_minima_of_a_known_function() -> None:
    """(x^2 - 1, y - x) has the two zeros (1, 1) and (-1, -1)."""
    def residual(s: np.ndarray) -> np.ndarray:
        return np.stack([s[..., 0] ** 2 - 1.0, s[..., 1] - s[..., 0]], axis=-1)

    starts = np.random.default_rng(0).uniform(-3, 3, (40, 2))
    found, left = fit(residual, lambda s, d: s + d, starts, 2)
    np.testing.assert_allclose(left, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.abs(found), 1.0, atol=1e-9)
    assert len(np.unique(np.sign(found), axis=0)) == 2
    J = jacobian(residual, lambda s, d: s + d, starts, 2)
    np.testing.assert_allclose(J[:, 0, 0], 2 * starts[:, 0], atol=1e-6)


def test_rotations_are_spread_and_differences_measured() -> None:
    turns = spread_rotations(60, np.random.default_rng(0))
    quats = Rotation.from_matrix(turns).as_quat()
    nearest = np.sort(np.abs(quats @ quats.T), axis=1)[:, -2]
    assert np.degrees(2 * np.arccos(np.clip(nearest, 0, 1))).min() > 25
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0, 0, 0.5]).as_matrix()
    T[:3, 3] = [0.01, 0, 0]
    angle, axis, shift = difference(np.eye(4), T, np.zeros(3))
    assert angle == pytest.approx(np.degrees(0.5)) and shift == pytest.approx(10.0)
    np.testing.assert_allclose(axis, [0, 0, 1], atol=1e-9)


# What the views hide ---------------------------------------------------------------------------------


def with_right_camera(angle_deg: float | None):
    """point_to_point with the second view at an angle to the first, about the vertical through the ball;
    None leaves it out."""
    scenario = vita.load("point_to_point")
    left = scenario.camera[0]
    assert left.look_from is not None and left.look_at is not None
    if angle_deg is None:
        return replace(
            scenario, camera=(left,), tracker=tuple(t for t in scenario.tracker if t.camera == "left"),
            constraint=tuple(c for c in scenario.constraint if "left" in c.name), expect=None,
        )  # fmt: skip
    at = np.array(left.look_at)
    eye = at + Rotation.from_euler("z", angle_deg, degrees=True).apply(np.array(left.look_from) - at)
    x, y, z = eye.tolist()
    return replace(scenario, camera=(left, replace(scenario.camera[1], look_from=(x, y, z))))


def test_nearly_the_same_view_twice_cannot_decide() -> None:
    """A law of triangulation: what one pixel hides in depth goes with one over the sine of half the angle."""
    worst, said = {}, {}
    for angle in (4.0, 8.0, 90.0):
        twin = Twin(with_right_camera(angle))
        q = searched_pose(twin)
        (view,) = point_views(twin, q)
        worst[angle] = view.worst_mm
        assert view.angle_deg == pytest.approx(angle, rel=0.2)
        said[angle] = view_findings((view,))[0]
    assert worst[4.0] / worst[8.0] == pytest.approx(2.0, rel=0.15)
    assert worst[4.0] > 10 * worst[90.0]
    assert said[4.0].code == "ambiguous" and "right angle" in said[4.0].text
    assert said[90.0].code == "accuracy"


def searched_pose(twin: Twin) -> np.ndarray:
    first = find_second_solutions(twin, seeds=4).first
    assert first is not None and first.q is not None
    return first.q


def test_in_one_view_the_point_slides() -> None:
    twin = Twin(with_right_camera(None))
    (view,) = point_views(twin, twin.q0)
    assert np.isinf(view.worst_mm) and view.along == "left"
    (finding,) = view_findings((view,))
    assert finding.code == "ambiguous" and "slide" in finding.text


# The whole check ---------------------------------------------------------------------------------------


@cache
def checked(name: str) -> Checkup:
    return check_up(vita.load(name))


def test_check_flags_the_flip_and_not_the_wrench_that_is_tied_down() -> None:
    flip = {f.code: f for f in checked("wrench_flip").findings}
    assert flip["second_solution"].level == "warning" and "180 degrees" in flip["second_solution"].text
    assert "grip_a" in flip["second_solution"].text
    fixed = {f.code for f in checked("wrench_fixed").findings}
    assert "second_solution" not in fixed and "one_solution" in fixed


def test_check_counts_and_sorts() -> None:
    found = checked("wrench_fixed")
    assert found.diagnosis is not None and found.diagnosis.rows == 14
    assert found.freedom.startswith(f"14 error rows hold {found.diagnosis.held} of 7 joint motions")
    order = ["bad", "warning", "info", "good"]
    levels = [order.index(f.level) for f in found.findings]
    assert levels == sorted(levels)
    table = found.summary()
    assert table["held"] == found.diagnosis.held and table["second_solutions"] == []
