"""The random tasks are what they claim to be, and the servo runs on them keep the laws of the world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vita.errors import UnknownName
from vita.experiments.analytic import Ibvs
from vita.experiments.arms import ARMS
from vita.experiments.cameras import Reading
from vita.experiments.estimators import Estimators, Outcomes, trial
from vita.experiments.estimators_cases import (
    DELTA_DEG,
    GAIN,
    ROBOTS,
    TASKS,
    case_of,
    cases,
    source_of,
    tasks_of,
)
from vita.experiments.estimators_exact import exact_jacobian, point_jacobian
from vita.experiments.estimators_loop import DONE_PX, Course, explored, inside, servo
from vita.experiments.scene import POINTS
from vita.experiments.starts import IMAGE, Kind, angle_between, random_starts, turned, visible
from vita.experiments.trial import JUMP_PX, Method, World
from vita.servo.estimators import ESTIMATORS
from vita.servo.policies import POLICIES

DELTA = np.radians(DELTA_DEG)
NOISE = Reading("gaussian", 0.2)


def run(world: World, key: str, steps: int = 40, seed: int = 1) -> Course:
    case = case_of(key)
    source = source_of(case.source, world, seed)
    return servo(world, case.method, gain=GAIN, delta=DELTA, steps=steps, seed=seed, source=source)


# The tasks ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("seed", [0, 1])
def test_every_pair_of_cameras_is_30_to_150_degrees_apart_and_sees_every_point(robot: str, seed: int) -> None:
    world = random_starts(robot, 60, seed)
    apart = np.degrees(angle_between(world.cameras.T_camera_world))
    assert apart.shape == (60,)
    assert apart.min() > 30.0 and apart.max() < 150.0
    # Over the range, not at one end of it.
    assert apart.min() < 50.0 and apart.max() > 110.0
    for q in (world.q0, world.goal):
        points = world.arm.points(q, world.local)
        assert world.cameras.depth(points).min() > 0.1
        pixels = np.abs(world.cameras.project(points))
        assert pixels[..., 0].max() < IMAGE[0] / 2 and pixels[..., 1].max() < IMAGE[1] / 2


def test_cameras_so_near_that_most_would_miss_a_point_still_see_them_all() -> None:
    kind = Kind(away_m=(0.4, 0.6))
    world = random_starts("wam7", 30, 2, kind=kind)
    for q in (world.q0, world.goal):
        points = world.arm.points(q, world.local)
        assert visible(world.cameras, points, kind.border_px).all()
        pixels = np.abs(world.cameras.project(points))
        assert (pixels < np.array(IMAGE) / 2 - kind.border_px).all()
    behind = world.cameras.T_camera_world * np.array([1.0, 1.0, -1.0, 1.0])[:, None]
    assert not visible(replace(world.cameras, T_camera_world=behind), points).any()


@pytest.mark.parametrize("robot", ROBOTS)
def test_start_and_goal_are_a_realistic_way_apart_and_inside_the_limits(robot: str) -> None:
    world, kind = random_starts(robot, 60, 3), Kind()
    low, high = world.arm.limits.T
    for q in (world.q0, world.goal):
        assert (q - low > np.radians(kind.margin_deg)).all()
        assert (high - q > np.radians(kind.margin_deg)).all()
    start, goal = world.arm.pose(world.q0), world.arm.pose(world.goal)
    travel = np.linalg.norm(start[:, :3, 3] - goal[:, :3, 3], axis=-1)
    assert travel.min() > 0.05 and travel.max() < 0.40
    assert 0.10 < np.median(travel) < 0.25
    assert np.degrees(turned(start, goal)).max() < 60.0


def test_a_shorter_list_of_tasks_is_the_beginning_of_a_longer_one() -> None:
    some, more = random_starts("wam7", 10, 4), random_starts("wam7", 90, 4)
    np.testing.assert_array_equal(some.q0, more.q0[:10])
    np.testing.assert_array_equal(some.cameras.T_camera_world, more.cameras.T_camera_world[:10])
    assert not np.array_equal(some.q0, random_starts("wam7", 10, 5).q0)


# The exact Jacobian ---------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", ARMS)
def test_the_exact_jacobian_is_that_of_finite_differences(robot: str) -> None:
    world = random_starts(robot, 20, 6)
    expected = world.true_jacobian(world.q0)
    np.testing.assert_allclose(exact_jacobian(world, world.q0), expected, atol=1e-7 * np.abs(expected).max())
    points, _ = point_jacobian(world.arm, world.q0, POINTS)
    np.testing.assert_allclose(points, world.arm.points(world.q0, POINTS), atol=1e-12)


def test_a_calibrated_servo_computes_the_exact_jacobian_from_perfect_readings() -> None:
    world = random_starts("puma560", 20, 6)
    jacobian = Ibvs(world.cameras).jacobian(world.q0, world.features(world.q0), world)
    np.testing.assert_allclose(jacobian, exact_jacobian(world, world.q0), atol=1e-6)


def test_exploring_hands_on_the_readings_that_the_jacobian_was_made_of() -> None:
    world = random_starts("wam4", 5, 6, NOISE)
    jacobian, samples = explored(world, DELTA, np.random.default_rng(0))
    assert samples.q.shape == (5, 5, 4) and samples.e.shape == (5, 5, 12)
    dq, de = samples.q[:, 1:] - samples.q[:, :1], samples.e[:, 1:] - samples.e[:, :1]
    np.testing.assert_allclose(dq @ jacobian.swapaxes(-1, -2), de, atol=1e-9)


# The runs -------------------------------------------------------------------------------------------


def tight(world: World) -> World:
    """The same tasks for an arm whose limits are right behind start and goal."""
    q = np.concatenate([world.q0, world.goal])
    limits = np.stack([q.min(0), q.max(0)], axis=-1) + np.radians([-1.0, 1.0])
    return replace(world, arm=replace(world.arm, limits=limits))


@pytest.mark.parametrize("key", [case.key for case in cases() if case.thin == 1])
def test_no_run_of_any_method_leaves_the_joint_limits(key: str) -> None:
    """Also with limits so tight, and tasks so few, that some runs end at them."""
    world = tight(random_starts("wam7", 8, 8, NOISE))
    outside = []
    case = case_of(key)
    course = servo(
        world, case.method, gain=GAIN, delta=DELTA, steps=25, seed=1,
        source=source_of(case.source, world, 1),
        each=lambda number, q, estimate, dq: outside.append(
            np.maximum(world.arm.limits[:, 0] - q, q - world.arm.limits[:, 1]).max()
        ),
    )  # fmt: skip
    assert course.blocked.any()
    assert max(outside) <= 0.0
    assert course.outside.max() <= 0.0
    assert (course.q >= world.arm.limits[:, 0]).all() and (course.q <= world.arm.limits[:, 1]).all()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_a_step_that_would_pass_a_limit_keeps_its_direction(seed: int) -> None:
    random = np.random.default_rng(seed)
    limits = np.sort(random.uniform(-2, 2, (5, 2)), axis=-1)
    q = random.uniform(limits[:, 0], limits[:, 1], (6, 5))
    dq = random.normal(0, 1, (6, 5))
    moved = inside(q, dq, limits) - q
    share = np.linalg.norm(moved, axis=-1) / np.linalg.norm(dq, axis=-1)
    np.testing.assert_allclose(moved, share[:, None] * dq, atol=1e-12)
    assert (share <= 1 + 1e-12).all()
    # It goes as far as it can: to the end, or until one joint is at its limit.
    touched = np.isclose(q + moved, limits[:, 0]) | np.isclose(q + moved, limits[:, 1])
    assert (touched.any(-1) | (share > 1 - 1e-9)).all()


@pytest.mark.parametrize("robot", ROBOTS)
def test_nothing_is_faster_in_the_median_than_knowing_the_jacobian(robot: str) -> None:
    world = random_starts(robot, 40, 9, NOISE)
    floor, default = run(world, "floor"), run(world, "default")
    assert np.nanmedian(floor.steps_to(DONE_PX)) <= np.nanmedian(default.steps_to(DONE_PX))
    assert floor.converged.mean() >= 0.95


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_default_converges_without_growing_by_100_px_in_a_step(robot: str) -> None:
    course = run(random_starts(robot, 60, 11, NOISE), "default", steps=60)
    assert course.converged.mean() >= 0.95
    assert not course.diverged.any()


def test_the_thesis_law_fails_on_the_far_start_where_the_default_does_not() -> None:
    world = tasks_of("far", 12, "gaussian", 0)
    thesis, default = run(world, "thesis", steps=60), run(world, "default", steps=60)
    assert thesis.diverged.sum() >= 4
    assert default.converged.all() and not default.diverged.any()


def test_the_thesis_law_keeps_its_first_jacobian_and_the_floor_has_the_true_one() -> None:
    world = replace(random_starts("puma560", 4, 12), reading=Reading("perfect"))
    for key in ("thesis", "floor"):
        case, seen = case_of(key), []
        source = source_of(case.source, world, 0)
        servo(
            world, case.method, gain=GAIN, delta=DELTA, steps=5, seed=1, source=source,
            each=lambda number, q, estimate, dq, seen=seen: seen.append((q.copy(), estimate.jacobian)),
        )  # fmt: skip
        for q, jacobian in seen:
            expected = seen[0][1] if key == "thesis" else exact_jacobian(world, q)
            np.testing.assert_allclose(jacobian, expected, rtol=1e-6, atol=1e-3)


def test_the_robust_filter_is_best_where_readings_are_wild() -> None:
    world = tasks_of("puma560", 40, "impulsive", 2)
    robust, default = run(world, "robust+uncertainty", 60), run(world, "default", 60)
    assert robust.converged.sum() > default.converged.sum()


def test_a_run_of_many_is_the_run_of_one() -> None:
    """What happens in one run of a batch does not touch the others."""
    many = replace(random_starts("wam7", 12, 13), reading=Reading("perfect"))
    one = replace(many, q0=many.q0[:1], goal=many.goal[:1])
    one = replace(one, cameras=replace(many.cameras, T_camera_world=many.cameras.T_camera_world[:1]))
    together, alone = run(many, "default", 15), run(one, "default", 15)
    np.testing.assert_allclose(together.largest[:1], alone.largest, rtol=1e-6, atol=1e-6)


def test_the_same_seed_gives_the_same_numbers_and_another_one_does_not() -> None:
    # These tasks are the same with every seed, so that it is the noise that differs.
    one, same, other = (trial("near", 6, "gaussian", "default", 15, seed) for seed in (1, 1, 2))
    for field in ("converged", "growth", "distance", "off", "curve"):
        np.testing.assert_array_equal(getattr(one, field), getattr(same, field))
    assert not np.array_equal(one.distance, other.distance)


def test_a_course_tells_steps_growth_and_convergence() -> None:
    def course(largest: list[float]) -> Course:
        error = np.array([largest])
        flag, zero = np.zeros(1, bool), np.zeros(1, int)
        return Course(error, error, error, error[:, 1:], np.zeros(1), flag, zero, zero, np.zeros((1, 2)))

    falling = course([300.0, 20.0, 9.0, *[0.5] * 12])
    assert falling.steps_to(10.0) == [2] and falling.steps_to(1.0) == [3]
    assert falling.converged.all() and not falling.diverged.any()
    rising = course([100.0, 99.0, 99.0 + JUMP_PX + 1.0, 50.0])
    assert rising.diverged.all() and not rising.converged.any()
    assert rising.growth == [JUMP_PX + 1.0]
    assert np.isnan(rising.steps_to(10.0)).all()
    assert course([1.0, np.nan]).diverged.all()


# The experiment -------------------------------------------------------------------------------------


def test_every_estimator_and_every_policy_is_compared() -> None:
    methods = {(case.method.estimator, case.method.policy) for case in cases() if case.group != "references"}
    default = case_of("default").method
    assert {(kind, default.policy) for kind in ESTIMATORS} <= methods
    assert {(default.estimator, kind) for kind in POLICIES} <= methods
    assert len({case.key for case in cases()}) == len(cases())


def test_an_unknown_method_or_set_of_tasks_lists_the_choices() -> None:
    with pytest.raises(UnknownName, match="default"):
        case_of("defualt")
    with pytest.raises(UnknownName, match="puma560"):
        tasks_of("puma", 3, "gaussian", 0)


def test_the_report_counts_what_the_runs_did() -> None:
    jobs = Estimators().jobs(quick=True, seed=0)
    assert len({job.label for job in jobs}) == len(jobs)
    random, results = np.random.default_rng(0), []
    for job in jobs:
        count = 10
        flags = np.arange(count) < 7
        results.append(
            Outcomes(
                job.arguments["tasks"], job.arguments["noise"], job.arguments["case"], flags, ~flags,
                50.0 * np.arange(float(count)), np.full(count, 3.0), np.where(flags, 5.0, np.nan),
                np.full(count, 2e-3), np.full(count, 0.25), np.full(count, -0.1), flags, flags,
                random.uniform(0.1, 100.0, 21),
            )
        )  # fmt: skip
    report = Estimators().report(jobs, results, quick=True)
    for table in report.tables:
        robots = 3 if "Random" in table.title else 1
        row = dict(zip(table.columns, table.rows[0], strict=True))
        assert row["runs"] == 10 * robots and row["converged [%]"] == pytest.approx(70.0)
        assert row["diverged"] == 3 * robots and row["worst growth [px]"] == 450.0
        assert row["steps to 1 px"] == 5.0 and row["3D error [mm]"] == 2.0
        assert row["Jacobian off by [%]"] == 25.0
    assert len(report.data["estimators"].rows) == len(jobs)
    wanted = {check.what: check.met for check in report.checks}
    assert [met for what, met in wanted.items() if "diverges" in what] == [False] * (len(TASKS) - 1)
    assert wanted["left the joint limits, all methods and robots [runs]"]
    assert set(report.figures) == {"methods", "convergence"}


def test_methods_are_told_the_same_noise_that_they_assume() -> None:
    """The comparison would be of settings otherwise."""
    assert len({case.method.sigma_px for case in cases()}) == 1
    assert Method("x").sigma_px == case_of("default").method.sigma_px
