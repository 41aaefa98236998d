"""The map of where to put the second camera tells the truth about the accuracy of servo runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vita.errors import UnknownName
from vita.experiments.cameras import Cameras, Reading
from vita.experiments.estimators_exact import image_jacobian
from vita.experiments.placement import Placement
from vita.experiments.placement_map import (
    Task,
    blocked,
    eye_of,
    figures_of,
    grid,
    learned_pairs,
    map_of,
    pair,
    placement_map,
    rank_correlation,
    second_cameras,
)
from vita.experiments.placement_tasks import SETTINGS, make_maps, run_sample, setting_of
from vita.experiments.scene import POINTS
from vita.experiments.starts import direction

RANDOM = np.random.default_rng(3)
KEYS = [setting.key for setting in SETTINGS]


@pytest.fixture(params=KEYS)
def task(request: pytest.FixtureRequest) -> Task:
    return setting_of(request.param).task()


# The prediction -------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [4, 6])
def test_the_predicted_accuracy_is_that_of_least_squares_with_noise(n: int) -> None:
    """Many noisy errors, the joints that fit them best, and how far the points are then off."""
    jacobian = RANDOM.normal(0, 100, (12, n))
    moves = RANDOM.normal(0, 0.5, (3, 3, n))
    accuracy, condition, joints = figures_of(jacobian, moves)
    q = np.linalg.lstsq(jacobian, RANDOM.normal(0, 1, (12, 40000)), rcond=None)[0]
    off = np.einsum("kxn,nt->tkx", moves, q)
    assert accuracy == pytest.approx(np.sqrt(np.mean(np.sum(off**2, axis=-1))), rel=0.02)
    assert joints == pytest.approx(np.sqrt(np.mean(np.sum(q**2, axis=0))), rel=0.02)
    assert condition == pytest.approx(np.linalg.cond(jacobian))


def test_motion_that_moves_no_point_does_not_count() -> None:
    """A seventh joint that only repeats what six do makes neither the accuracy nor the condition bad."""
    jacobian = RANDOM.normal(0, 100, (12, 6)) @ RANDOM.normal(0, 1, (6, 7))
    moves = RANDOM.normal(0, 1, (3, 3, 7))
    accuracy, condition, _ = figures_of(jacobian, moves)
    assert np.isfinite(accuracy) and accuracy < 1.0
    values = np.linalg.svd(jacobian, compute_uv=False)
    assert condition == pytest.approx(values[0] / values[5])


def test_a_second_camera_never_makes_the_prediction_worse(task: Task) -> None:
    alone = image_jacobian(Cameras(task.first[None], task.focal_px), task.points, task.moves)
    worst, *_ = figures_of(alone, task.moves)
    assert (placement_map(task, *grid(15.0)).accuracy_mm < 1e3 * worst).all()


def test_rolling_a_camera_about_its_axis_changes_nothing(task: Task) -> None:
    second = second_cameras(task, np.array(60.0), np.array(20.0))
    c, s = np.cos(0.7), np.sin(0.7)
    roll = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    before, after = (
        figures_of(image_jacobian(pair(task, one), task.points, task.moves), task.moves)
        for one in (second, roll @ second)
    )
    np.testing.assert_allclose(before, after, rtol=1e-9)


# The map --------------------------------------------------------------------------------------------


def test_cameras_are_where_the_map_says_and_look_at_the_points(task: Task) -> None:
    azimuth, elevation = np.meshgrid(*grid(15.0))
    second = second_cameras(task, azimuth, elevation)
    away = eye_of(second) - task.centre
    expected = task.distance_m * direction(np.radians(azimuth), np.radians(elevation))
    np.testing.assert_allclose(away, expected, atol=1e-9)
    cameras = Cameras(second[..., None, :, :], task.focal_px)
    np.testing.assert_allclose(cameras.project(task.centre[None]), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.det(second[..., :3, :3]), 1.0)


def test_the_condition_is_worst_when_the_cameras_coincide(task: Task) -> None:
    found = placement_map(task, *grid(5.0))
    row, column = np.unravel_index(found.condition.argmax(), found.condition.shape)
    assert found.apart_deg[row, column] < 10.5  # The grid is one of 5 degrees.
    assert found.condition.max() > 2.5 * np.median(found.condition)


def test_the_best_second_camera_looks_across_the_first(task: Task) -> None:
    found = placement_map(task, *grid(5.0))
    assert 60.0 < found.apart_deg[found.best()] < 120.0
    assert min(found.apart_deg[found.worst()], 180.0 - found.apart_deg[found.worst()]) < 20.0
    assert found.usable[found.best()] and found.usable[found.worst()]
    inside = found.accuracy_mm[found.usable]
    assert found.accuracy_mm[found.best()] == inside.min()
    assert found.accuracy_mm[found.worst()] == inside.max()


def test_a_place_behind_the_arm_is_not_recommended() -> None:
    task = setting_of("wam7").task()
    elbow = task.links[3] - task.centre
    elbow = elbow / np.linalg.norm(elbow)
    azimuth, elevation = np.degrees([np.arctan2(elbow[1], elbow[0]), np.arcsin(elbow[2])])
    assert blocked(task, second_cameras(task, azimuth, elevation))
    assert not blocked(task, second_cameras(task, azimuth + 180.0, np.array(10.0)))
    # An arm that is somewhere else hides nothing.
    away = replace(task, links=task.links + np.array([0.0, 0.0, 50.0]))
    assert not blocked(away, second_cameras(task, *np.meshgrid(*grid(30.0)))).any()


def test_points_outside_the_image_make_a_place_unusable(task: Task) -> None:
    near = replace(task, distance_m=0.12)
    assert not placement_map(near, *grid(30.0)).usable.any()


# What can be learned --------------------------------------------------------------------------------


def test_perfect_exploration_by_little_learns_the_true_map(task: Task) -> None:
    setting = next(one for one in SETTINGS if one.title == task.title)
    azimuth, elevation = grid(30.0)
    rigs = pair(task, second_cameras(task, *np.meshgrid(azimuth, elevation)))
    goal, delta = np.radians(setting.goal_deg), 1e-6
    moved = setting.arm.points(goal + delta * np.eye(setting.arm.n), POINTS)
    pixels = rigs.project(task.points).reshape(*rigs.T_camera_world.shape[:2], -1)
    pixels_moved = np.stack([rigs.project(one).reshape(pixels.shape) for one in moved], axis=-2)
    learned = learned_pairs(pixels, pixels_moved, delta, Reading(), np.random.default_rng(0))
    known, found = placement_map(task, azimuth, elevation), map_of(task, learned, azimuth, elevation)
    np.testing.assert_allclose(found.accuracy_mm, known.accuracy_mm, rtol=1e-2)
    np.testing.assert_allclose(found.condition, known.condition, rtol=1e-2)


@pytest.mark.parametrize("key", KEYS)
def test_two_cameras_that_explored_alone_advise_like_the_truth(key: str) -> None:
    maps = make_maps(key, 10.0, 0)
    usable = maps.true.usable
    assert rank_correlation(maps.true.accuracy_mm[usable], maps.learned.joints_deg[usable]) > 0.8
    assert rank_correlation(maps.true.condition[usable], maps.learned.condition[usable]) > 0.9
    # Following the advice costs little of the accuracy.
    row, column = np.unravel_index(
        np.where(usable, maps.learned.joints_deg, np.inf).argmin(), usable.shape
    )
    assert maps.true.accuracy_mm[row, column] < 1.25 * maps.true.accuracy_mm[maps.true.best()]


# Servo runs -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", KEYS)
def test_servo_runs_rank_the_places_as_predicted(key: str) -> None:
    found = run_sample(key, 24, 8, 0)
    assert found.agreement("default_mm") > 0.6
    # Its averaging beats a single look nearly everywhere.
    assert np.nanmedian(found.default_mm / found.predicted_mm) < 0.5
    assert found.lost.mean() < 0.05


def test_the_plain_law_ends_at_the_predicted_accuracy() -> None:
    """With gain l a wrong look is forgotten by (1 - l) a step: l / (2 - l) of the variance stays."""
    found = run_sample("wam7", 24, 8, 1)
    wide = (found.apart_deg > 40.0) & (found.apart_deg < 140.0)
    assert np.median(found.plain_mm[wide] / found.predicted_mm[wide]) == pytest.approx(
        np.sqrt(0.5 / 1.5), rel=0.15
    )


def test_samples_are_spread_evenly_over_the_angle_between_the_cameras() -> None:
    apart = run_sample("wam7", 60, 1, 2).apart_deg
    assert (apart < 45.0).sum() > 8 and (apart > 120.0).sum() > 4
    task, setting = setting_of("wam7").task(), setting_of("wam7")
    sight = eye_of(task.first) - task.centre
    np.testing.assert_allclose(
        sight / np.linalg.norm(sight), direction(*np.radians(setting.first_deg)), atol=1e-9
    )


def test_the_same_seed_gives_the_same_numbers_and_another_one_does_not() -> None:
    one, same, other = (run_sample("puma560", 4, 2, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.default_mm, same.default_mm)
    assert not np.array_equal(one.default_mm, other.default_mm)
    first, second, third = (make_maps("puma560", 45.0, seed).learned.condition for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, third)


def test_rank_correlation_leaves_out_what_is_missing() -> None:
    one, other = np.array([1.0, 2.0, np.nan, 3.0, 4.0]), np.array([1.0, 8.0, 0.0, np.nan, 9.0])
    assert rank_correlation(one, other) == pytest.approx(1.0)
    assert rank_correlation(one, -other) == pytest.approx(-1.0)


def test_the_report_names_the_best_place_and_holds_every_direction() -> None:
    experiment = Placement()
    results = []
    for job in experiment.jobs(quick=True, seed=0):
        small = {"step_deg": 15.0} if "step_deg" in job.arguments else {"placements": 6, "repeats": 2}
        results.append(job.work(**{**job.arguments, **small}))
    report = experiment.report(experiment.jobs(True, 0), results, True)
    assert len(report.data["maps"].rows) == len(SETTINGS) * 25 * 8
    assert len(report.data["runs"].rows) == len(SETTINGS) * 6
    places = report.tables[0]
    best = dict(zip(places.columns, places.rows[0], strict=True))
    true = results[0].true
    assert best["3D error [mm/px]"] == true.accuracy_mm[true.best()]
    assert set(report.figures) == {*(f"map_{key}" for key in KEYS), "check"}
    assert len(report.checks) == len(SETTINGS)
    with pytest.raises(UnknownName, match="wam7"):
        setting_of("wam")
