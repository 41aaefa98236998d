"""The documents' experiments: their world is right, their runs are repeatable, their reports are true."""

from __future__ import annotations

import csv
import io
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trial_jobs
from hypothesis import given, settings
from hypothesis import strategies as st
from trial_jobs import Interrupted, Squares, TooLarge, broken, squares, vanish

from vita import cli
from vita.errors import BadInput, MissingDependency
from vita.experiments import scene
from vita.experiments.all import MODULES
from vita.experiments.arms import ARMS, PUMA560
from vita.experiments.base import EXPERIMENTS, Check, Job, Report, Table
from vita.experiments.baseline_turns import Turn, turn
from vita.experiments.camera_baseline import CameraBaseline, best_angle_deg
from vita.experiments.camera_rotation import CameraRotation
from vita.experiments.cameras import READINGS, Cameras, Reading, facing, look_at
from vita.experiments.progress import JobProgress
from vita.experiments.report import cell, markdown, write
from vita.experiments.rotation_cells import Cell, joined, sweep
from vita.experiments.runner import Request, run_one
from vita.experiments.spread import results_of
from vita.experiments.thesis_rotation import PLACEMENTS, PRINTED
from vita.experiments.trial import JUMP_PX, Method, Runs, World, explore, run
from vita.servo.estimators import Tuning
from vita.types import Array

RANDOM = np.random.default_rng(5)
ANGLES = tuple(range(5, 360, 40))
PLAIN = Method("plain", "thesis", "fixed", Tuning(alpha=0.0))

# The world ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ARMS)
def test_a_batch_of_poses_is_the_chain_of_links_of_each(name: str) -> None:
    arm = ARMS[name]
    q = RANDOM.uniform(-3, 3, (5, arm.n))
    expected = [arm.chain.link_frames(each)[-1] @ arm.tool for each in q]
    np.testing.assert_allclose(arm.pose(q), expected, atol=1e-12)


def test_the_puma_is_where_its_table_says() -> None:
    """Corke's standard parameters at [0, pi/4, pi, 0, pi/4, 0], without a tool."""
    flange = PUMA560.link_frames([0, np.pi / 4, np.pi, 0, np.pi / 4, 0])[-1]
    np.testing.assert_allclose(flange[:3, 3], [0.5963, -0.1501, -0.0144], atol=5e-5)


@given(
    st.tuples(*[st.floats(-2, 2)] * 3), st.floats(0.3, 3), st.floats(-3.1, 3.1),
    st.floats(-0.2, 0.2), st.floats(-0.2, 0.2),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_a_pinhole_divides_by_depth(
    eye: tuple[float, float, float], depth: float, angle: float, right: float, down: float
) -> None:
    """A point that lies so far ahead, to the right and down has the pixel f x / z, f y / z."""
    ahead = np.array([np.cos(angle), np.sin(angle), 0.0])
    sideways = np.array([np.sin(angle), -np.cos(angle), 0.0])
    point = np.array(eye) + depth * ahead + right * sideways + down * np.array([0, 0, -1.0])
    camera = Cameras(facing(np.array([eye]), ahead), 700.0)
    np.testing.assert_allclose(camera.depth(point[None]), [[depth]], atol=1e-9)
    expected = [[[700.0 * right / depth, 700.0 * down / depth]]]
    np.testing.assert_allclose(camera.project(point[None]), expected, atol=1e-6)


def test_a_camera_sees_what_it_looks_at_in_its_middle() -> None:
    eyes, target = RANDOM.uniform(-2, 2, (6, 3)), np.array([0.1, 3.0, 0.4])
    np.testing.assert_allclose(Cameras(look_at(eyes, target), 900.0).project(target[None]), 0.0, atol=1e-9)


def test_the_rigs_stand_as_the_thesis_says() -> None:
    """Both cameras 1.0 m behind the target and 0.30 m apart; the goal 0.32 m, or 0.70 m, away."""
    centre = scene.target("near")
    pose = scene.stereo_rigs(np.radians([0.0, 77.0]), centre).T_camera_world
    eyes = np.linalg.inv(pose)[..., :3, 3]
    np.testing.assert_allclose(np.linalg.norm(eyes[:, 0] - eyes[:, 1], axis=-1), 0.30)
    np.testing.assert_allclose((pose @ [*centre, 1.0])[..., 2], 1.0)
    start = scene.ARM.pose(scene.START)[:3, 3]
    assert np.linalg.norm(start - centre) == pytest.approx(0.32, abs=0.001)
    assert np.linalg.norm(start - scene.target("far")) == pytest.approx(0.70, abs=0.005)


def test_readings_are_as_wrong_as_they_say() -> None:
    true = RANDOM.uniform(-300, 300, 20_000)
    off = {kind: reading.of(true, np.random.default_rng(1)) - true for kind, reading in READINGS.items()}
    assert not off["perfect"].any()
    assert np.abs(off["integer"]).max() <= 0.5 and off["integer"].std() == pytest.approx(12**-0.5, rel=0.03)
    assert off["gaussian"].std() == pytest.approx(0.2, rel=0.03) and abs(off["gaussian"].mean()) < 0.01
    wild = Reading("impulsive").of(true, np.random.default_rng(1)) - true
    assert np.mean(np.abs(wild) > 1.0) == pytest.approx(0.03 * 0.92, rel=0.2)


def placements(*angles: float, goal: str = "near", reading: Reading = READINGS["perfect"]) -> World:
    return scene.world(scene.stereo_rigs(np.radians(angles), scene.target(goal)), goal, reading)


def test_the_task_is_met_at_the_goal_and_exploring_finds_the_jacobian() -> None:
    world = placements(0, 120, 240)
    assert not world.measure(world.goal, RANDOM).any() and not world.distance(world.goal).any()
    np.testing.assert_allclose(
        explore(world, 1e-6, RANDOM), world.true_jacobian(world.q0), rtol=1e-4, atol=0.05
    )


# Runs -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", [PLAIN, Method("default", sigma_px=0.05)], ids=["plain", "default"])
def test_a_batch_of_runs_is_each_run_alone(method: Method) -> None:
    """Without noise. Each has its own cameras, exploration size and gain; one of the plain ones diverges."""
    angles, gain, delta = (20.0, 190.0, 300.0), np.array([0.3, 1.0, 1.0]), np.radians([2.0, 6.0, 10.0])
    together = run(placements(*angles), method, gain=gain, delta=delta, steps=25, seed=0)
    for i, angle in enumerate(angles):
        alone = run(placements(angle), method, gain=gain[i], delta=delta[i], steps=25, seed=0)
        np.testing.assert_allclose(alone.error[0], together.error[i], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(alone.q[0], together.q[i], rtol=0, atol=1e-8)
        np.testing.assert_allclose(alone.condition, together.condition[i], rtol=1e-9)
    assert together.diverged.tolist() == [False, method is PLAIN, False]


def test_a_run_that_has_diverged_stands_still() -> None:
    runs = run(placements(190.0), PLAIN, gain=1.0, delta=np.radians(6.0), steps=50, seed=0)
    grew = int(np.argmax(np.diff(runs.error[0]) > JUMP_PX))
    assert runs.diverged[0] and grew < 45
    assert np.unique(runs.error[0, grew + 1 :]).size == 1


def test_the_rule_of_divergence_and_the_counts_of_steps() -> None:
    error = np.array([[500.0, 90, 9, 5], [500, 599, 9, 9], [500, 601, 9, 9], [500, 400, 300, np.inf]])
    runs = Runs(error, error, np.ones(4), np.zeros((4, 6)))
    assert runs.diverged.tolist() == [False, False, True, True]
    np.testing.assert_array_equal(runs.steps_to(10.0), [2, 2, 2, np.nan])
    np.testing.assert_array_equal(runs.steps_to(0.2 * error[:, 0]), [1, 2, 2, np.nan])


def test_limits_hold_where_they_are_wanted() -> None:
    """The goal lies beyond a limit of the arm: with limits no run passes them, without they do."""
    free = placements(0, 90, 180)
    ends = [
        run(World(**{**vars(free), "limited": limited}), PLAIN, gain=0.5, delta=0.1, steps=15, seed=0).q
        for limited in (True, False)
    ]
    low, high = free.arm.limits.T
    beyond = free.q0[0] > high  # The thesis' start is itself outside for one joint: it may not go on.
    assert (ends[0] >= low - 1e-9).all() and (ends[0] <= np.where(beyond, free.q0, high) + 1e-9).all()
    assert ((ends[1] < low) | (ends[1] > high)).any()


# The experiments' findings, on a thinner sweep --------------------------------------------------------


@pytest.fixture(scope="module")
def cells() -> dict:
    goals = [("near", method, tracker) for method in scene.METHODS for tracker in ("gaussian", "integer")]
    goals += [("far", "default", "gaussian"), ("far", "plain", "gaussian")]
    return joined(cell for setting in goals for cell in sweep(*setting, ANGLES, 0))


def lost(cells: dict, goal: str, method: str, gain: float | None = None) -> int:
    chosen = [c for c in cells.values() if (c.goal, c.method) == (goal, method) and gain in (None, c.gain)]
    assert chosen
    return sum(int(c.diverged.sum()) for c in chosen)


def test_the_default_never_diverges_and_always_arrives(cells: dict) -> None:
    assert lost(cells, "near", "default") == lost(cells, "far", "default") == 0
    for c in cells.values():
        if c.method == "default" and c.goal == "near":
            assert c.reached.all() and c.mean_steps <= 9.5, c.key
    far = [c.reached for c in cells.values() if (c.goal, c.method) == ("far", "default")]
    assert np.mean(far) >= 0.99


def test_the_plain_algorithm_diverges_at_gain_one_and_far_away(cells: dict) -> None:
    """Thesis 5.2.1, 'as lambda is increased ... the arm will move away and diverge'."""
    one = lost(cells, "near", "plain", 1.0)
    assert one >= 10 > 5 * lost(cells, "near", "plain", 0.25) and one >= 5 * lost(cells, "near", "plain", 0.5)
    assert lost(cells, "far", "plain") > 0.5 * 20 * len(ANGLES)


def test_the_default_is_sooner_and_nearer_than_the_plain_algorithm(cells: dict) -> None:
    for key, ours in cells.items():
        if key[:2] == ("near", "default"):
            plain = cells[key[0], "plain", *key[2:]]
            assert ours.mean_steps < plain.mean_steps and ours.mean_distance_mm < plain.mean_distance_mm, key


def test_both_methods_explore_with_the_same_noise(cells: dict) -> None:
    for key, ours in cells.items():
        if key[:3] == ("near", "default", "gaussian"):
            plain = cells["near", "plain", *key[2:]]
            np.testing.assert_array_equal(ours.condition, plain.condition)


def test_parts_of_a_sweep_come_together_in_order() -> None:
    parts = [sweep("near", "plain", "perfect", part, 0) for part in ((180.0, 270.0), (0.0, 90.0))]
    whole = joined(c for part in parts for c in part)
    at_once = joined(sweep("near", "plain", "perfect", (0.0, 90.0, 180.0, 270.0), 0))
    assert whole.keys() == at_once.keys() and len(whole) == 20
    for key, c in whole.items():
        assert c.angle_deg.tolist() == [0, 90, 180, 270]
        np.testing.assert_allclose(c.image_px, at_once[key].image_px, rtol=1e-6, atol=1e-9)


def test_the_thesis_numbers_are_all_there() -> None:
    """688 of its 21,600 runs diverged; a few entries by eye."""
    assert len(PRINTED) == 60 and sum(row.diverged for row in PRINTED.values()) == 688
    assert PRINTED["integer", 6, 0.75].distance_m == 0.002811 and PRINTED["perfect", 8, 1.0].diverged == 57
    assert PRINTED["gaussian", 10, 0.25].image_px == 8.266994 and PRINTED["perfect", 2, 0.5].steps == 4.738889


@pytest.fixture(scope="module")
def turns() -> dict[tuple[str, str], Turn]:
    angles = tuple(range(0, 360, 15))
    made = [turn(method, tracker, angles, 0) for method in scene.METHODS for tracker in READINGS]
    return {(t.method, t.tracker): t for t in made}


def test_cameras_at_right_angles_are_conditioned_best(turns: dict) -> None:
    assert best_angle_deg(turns, "view_condition") == 90
    assert 75 <= best_angle_deg(turns, "goal_condition") <= 105


def test_the_condition_of_the_views_is_that_of_their_geometry() -> None:
    """Two cameras an angle a apart see a shift straight up twice, and those along and across their
    bisector sin(a/2) and cos(a/2) times as well: condition 1 / sin(m/2), with m the lesser of a and
    pi - a. That is of one point; the three of the tool, 0.1 m apart, change it by a few per cent."""
    t = turn("plain", "perfect", (30, 60, 90, 120), 0)
    for j, angle in enumerate(np.radians(t.angle_deg)):
        expected = 1.0 / np.sin(min(angle, np.pi - angle) / 2)
        np.testing.assert_allclose(t.view_condition[:, j], expected, rtol=0.15)


def test_one_point_of_view_makes_the_plain_algorithm_diverge_and_not_the_default(turns: dict) -> None:
    for tracker in READINGS:
        assert turns["plain", tracker].at("diverged", 0).mean() >= 0.5
        beside = turns["plain", tracker].at("diverged", 90, 15)  # 75 to 105 degrees, on both sides
        assert beside.size == 6 * 6 and not beside.any()
        assert not turns["default", tracker].diverged.any()


# Reports ----------------------------------------------------------------------------------------------


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def table_rows(text: str, title: str) -> list[list[str]]:
    """The cells of the markdown table below a title."""
    lines = text[text.index(f"**{title}**") :].splitlines()[4:]
    return [
        [part.strip() for part in line.strip("|").split("|")]
        for line in lines[: next((i for i, line in enumerate(lines) if not line.startswith("|")), len(lines))]
    ]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, cells: dict) -> Path:
    """The rotation's report of the thinner sweep, the trackers that it lacks filled up."""
    every = dict(cells)
    for (goal, method, tracker, *rest), c in cells.items():
        for other in ("integer", "perfect"):
            if (goal, method, other, *rest) not in every and tracker == "gaussian":
                every[goal, method, other, *rest] = Cell(**{**vars(c), "tracker": other})
    folder = tmp_path_factory.mktemp("rotation")
    write(CameraRotation(), CameraRotation().report([], [list(every.values())], True), folder)
    return folder


def test_a_report_is_markdown_csv_and_pictures(written: Path) -> None:
    names = sorted(path.name for path in written.iterdir())
    assert names == [
        "figure_5_8.png", "figure_5_9.png", "overview.png", "placements.csv", "report.md", "settings.csv",
    ]  # fmt: skip
    for name in names:
        if name.endswith(".png"):
            assert (written / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
            assert f"]({name})" in (written / "report.md").read_text()


def test_the_report_says_what_the_csv_says(written: Path, cells: dict) -> None:
    """Table 5.3 of the report, the file's rows and the runs themselves agree."""
    table = table_rows((written / "report.md").read_text(), "Table 5.3: gaussian tracker")
    filed = {
        (row["algorithm"], int(row["delta_deg"]), float(row["gain"])): row
        for row in rows_of(written / "settings.csv")
        if (row["goal"], row["tracker"]) == ("near", "gaussian")
    }
    assert len(table) == 20
    for line in table:
        delta, gain = int(line[0]), float(line[1])
        plain, ours = filed["plain", delta, gain], filed["default", delta, gain]
        c = cells["near", "default", "gaussian", delta, gain]
        assert float(ours["distance_mm"]) == c.mean_distance_mm and int(ours["diverged"]) == c.diverged.sum()
        assert line[5] == cell(1e3 * PRINTED["gaussian", delta, gain].distance_m)
        columns = {
            3: plain["image_px"], 4: ours["image_px"], 6: plain["distance_mm"], 7: ours["distance_mm"],
            9: plain["steps_to_tenth"], 11: plain["steps_to_10_px"], 12: ours["steps_to_10_px"],
        }  # fmt: skip
        for i, text in columns.items():
            assert line[i] == cell(float(text)), (delta, gain, i)
        assert (line[14], line[15]) == (plain["diverged"], ours["diverged"])


def test_the_baseline_reports_every_run(tmp_path: Path, turns: dict) -> None:
    report = CameraBaseline().report([], list(turns.values()), True)
    write(CameraBaseline(), report, tmp_path)
    rows = rows_of(tmp_path / "runs.csv")
    assert len(rows) == 6 * 6 * 24 and (tmp_path / "figure_5_10.png").stat().st_size > 10_000
    alone = [
        float(row["diverged"]) for row in rows if row["angle_deg"] == "0.0" and row["algorithm"] == "plain"
    ]
    assert report.checks[2].ours == np.mean(alone)
    assert all(check.met for check in report.checks)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"), (math.nan, "–"), (3, "3"), (np.int64(7), "7"), (True, "yes"), (0.0, "0"), (2.0, "2"),
        (1234.567, "1235"), (12.3456, "12.35"), (0.04567, "0.0457"), (4.5e-7, "4.5e-07"), (math.inf, "inf"),
        (120.0, "120"), (np.float64(9.999), "9.999"), ("a|b", "a\\|b"),
    ],
)  # fmt: skip
def test_cells_have_four_digits_and_dashes(value: object, text: str) -> None:
    assert cell(value) == text


@given(st.lists(st.tuples(st.floats(allow_nan=True), st.integers(), st.text("ab| ")), max_size=5))
def test_every_line_of_a_markdown_table_is_as_wide(rows: list[tuple[float, int, str]]) -> None:
    lines = markdown(Table("t", ("one", "two", "three"), rows)).splitlines()[2:]
    assert len(lines) == len(rows) + 2 and len({len(line) for line in lines}) == 1


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_csv_keeps_every_digit(tmp_path_factory: pytest.TempPathFactory, number: float) -> None:
    folder = tmp_path_factory.mktemp("csv")
    table = Table("t", ("a", "b", "c"), [(np.float64(number), None, np.bool_(True))])
    write(Squares(), Report("", [], {"data": table}), folder)
    (row,) = rows_of(folder / "data.csv")
    assert float(row["a"]) == number and row["b"] == "" and row["c"] == "1"


def test_a_check_is_met_inside_its_bounds_only() -> None:
    assert Check("", 9.5, most=9.5).met and not Check("", 9.51, most=9.5).met
    assert Check("", 90, 75, 105).met and not Check("", 70, 75, 105).met
    assert not Check("", math.nan, most=1.0).met


# Where the work is done ---------------------------------------------------------------------------------


def thin_rotation() -> list[Job]:
    setting = {"goal": "near", "tracker": "gaussian", "angles_deg": (0.0, 200.0), "seed": 3}
    return [Job(method, sweep, {**setting, "method": method}) for method in ("plain", "default", "plain")]


def numbers(results: list[list[Cell]]) -> Array:
    return np.array([[[c.image_px, c.distance_m, c.condition] for c in cells] for cells in results])


def test_results_do_not_depend_on_the_number_of_workers() -> None:
    jobs = thin_rotation()
    np.testing.assert_array_equal(numbers(results_of(jobs, 2)), numbers(results_of(jobs, 1)))


def test_jobs_are_spread_and_come_back_in_order() -> None:
    heard: list[tuple[int, str]] = []
    results = results_of(squares(8), 2, done=lambda count, job: heard.append((count, job.label)))
    assert [square for square, _ in results] == [i**2 for i in range(8)]
    assert os.getpid() not in {process for _, process in results}
    assert [count for count, _ in heard] == list(range(1, 9))
    assert {label for _, label in heard} == {f"square of {i}" for i in range(8)}


def test_results_are_in_the_order_of_the_jobs_whoever_is_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "vita.experiments.spread._in_processes",
        lambda jobs, workers: ((i, jobs[i].arguments["number"]) for i in (2, 0, 3, 1)),
    )
    assert results_of(squares(4), 2) == [0, 1, 2, 3]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_broken_job_is_a_mistake_that_shows(workers: int) -> None:
    with pytest.raises(ValueError, match="this job is broken"):
        results_of([*squares(2), Job("broken", broken, {})], workers)


@pytest.mark.skipif(os.name != "posix", reason="kills a process by a signal")
def test_a_worker_that_dies_is_told_in_a_sentence() -> None:
    with pytest.raises(MissingDependency, match="fewer --workers"):
        results_of([Job("vanish", vanish, {})] * 2, 2)


def test_no_workers_are_refused() -> None:
    with pytest.raises(BadInput, match="workers"):
        results_of(squares(1), 0)


def test_a_cluster_gives_the_same_results() -> None:
    """On a Dask cluster of this machine, over TCP as a real one would be reached."""
    distributed = pytest.importorskip("distributed", reason="needs vita[dask]")
    jobs = thin_rotation()
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    )
    try:
        spread = results_of(jobs, scheduler=cluster.scheduler_address)
    finally:
        cluster.close()
    np.testing.assert_array_equal(numbers(spread), numbers(results_of(jobs)))


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="needs vita[dask]")
    monkeypatch.setattr("vita.experiments.spread.ANSWER_S", 1)
    with pytest.raises(MissingDependency, match="no Dask scheduler answers at 'tcp://127.0.0.1:1'"):
        results_of(squares(1), scheduler="tcp://127.0.0.1:1")


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingDependency, match=r"vita\[dask\]") as caught:
        results_of(squares(1), scheduler="tcp://127.0.0.1:8786")
    assert caught.value.exit_code == 3


# The command ----------------------------------------------------------------------------------------------


@pytest.fixture
def own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the tests' small experiments are registered."""
    import vita.experiments.all  # noqa: F401 - so that it does not register later

    monkeypatch.setattr("vita.experiments.base.EXPERIMENTS", (mine := {}))
    monkeypatch.setattr("vita.experiments.runner.EXPERIMENTS", mine)
    for kind in (Squares, TooLarge, Interrupted):
        mine[kind.name] = kind()


def command(*arguments: str) -> int:
    return cli.main(["experiment", *arguments])


def test_an_unknown_experiment_names_the_choices(capsys: pytest.CaptureFixture[str]) -> None:
    assert command("camera-rotatoin", "--quick") == 2
    said = capsys.readouterr().err
    assert "Did you mean 'camera-rotation'?" in said and "camera-baseline" in said


def test_no_name_is_bad_usage_and_the_list_has_them_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert command() == 2
    assert "camera-rotation" in capsys.readouterr().err
    assert command("--list") == 0
    listed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in listed] == list(EXPERIMENTS) and len(listed) >= 2
    assert [name.replace("-", "_") for name in EXPERIMENTS] == list(MODULES)


@pytest.mark.parametrize("bad", [("--workers", "0"), ("--workers", "two"), ("--seed", "-1")])
def test_bad_numbers_are_bad_usage(own: None, tmp_path: Path, bad: tuple[str, str]) -> None:
    assert command("squares", "--out", str(tmp_path), *bad) == 2


def test_the_command_writes_and_prints_the_report(
    own: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("squares", "--workers", "1", "--out", str(tmp_path)) == 0
    said = capsys.readouterr().out
    assert said.startswith("# Squares\n") and "| largest square | at most 1000 |   25 | yes" in said
    report = (tmp_path / "squares" / "report.md").read_text()
    assert "How large do squares get?" in report and table_rows(report, "Squares")[-1] == ["5", "25"]
    assert [row["square"] for row in rows_of(tmp_path / "squares" / "squares.csv")] == "0 1 4 9 16 25".split()


def test_a_figure_that_is_missed_is_the_verdict_of_the_command(own: None, tmp_path: Path) -> None:
    assert command("too-large", "squares", "--workers", "1", "--out", str(tmp_path)) == 1
    assert command("too-large", "--quick", "--workers", "1", "--out", str(tmp_path)) == 1
    assert (tmp_path / "squares" / "report.md").exists()  # The others run all the same.


def test_all_means_every_one_once(own: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("squares", "all", "--quick", "--workers", "1", "--out", str(tmp_path)) == 130
    out, err = capsys.readouterr()
    assert out.count("# Squares") == 2  # The second one has the same title; the third is interrupted.
    assert "done and written: squares, too-large" in err


def test_a_folder_that_cannot_be_is_bad_usage(own: None, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert command("squares", "--workers", "1", "--out", str(tmp_path / "file")) == 2


def test_the_quick_sweep_is_the_same_thing_thinner() -> None:
    for kind in (CameraRotation(), CameraBaseline()):
        quick, full = kind.jobs(True, 0), kind.jobs(False, 0)
        for job in quick:
            same = [
                set(other.arguments["angles_deg"])
                for other in full
                if all(other.arguments[k] == v for k, v in job.arguments.items() if k != "angles_deg")
            ]
            assert set(job.arguments["angles_deg"]) < set().union(*same)
    angles = [a for job in CameraRotation().jobs(False, 0)[:6] for a in job.arguments["angles_deg"]]
    assert sorted(angles) == list(range(PLACEMENTS))


INTERRUPTED = """
import sys
sys.path.insert(0, {tests!r})
from trial_jobs import Sleepers
from vita.experiments.base import register
if __name__ == "__main__":
    import vita.experiments.all
    register(Sleepers)
    from vita.cli import main
    sys.exit(main(["experiment", "sleepers", "--workers", "2", "--out", {out!r}]))
"""


@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C is a signal here")
def test_ctrl_c_ends_at_once_and_leaves_no_process(tmp_path: Path) -> None:
    """The jobs would sleep for a minute. The command's output closes when its last process has gone."""
    script = tmp_path / "interrupted.py"
    script.write_text(INTERRUPTED.format(tests=str(Path(__file__).parent), out=str(tmp_path)))
    process = subprocess.Popen(
        [sys.executable, str(script)],
        stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parent.parent)},
    )  # fmt: skip
    assert process.stderr is not None
    assert "sleepers: 0 of 2" in process.stderr.readline()
    time.sleep(1.5)  # The workers are starting, or asleep.
    os.killpg(process.pid, signal.SIGINT)
    rest = process.communicate(timeout=40)[1]
    assert process.returncode == 130
    assert "stopped; nothing was finished" in rest and "Traceback" not in rest


# Progress ---------------------------------------------------------------------------------------------------


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_gets_a_bar_and_a_file_gets_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(np.arange(0.0, 1000.0, 11.0))
    monkeypatch.setattr("vita.experiments.progress.time.monotonic", lambda: float(next(clock)))
    terminal, file = Terminal(), io.StringIO()
    for stream in (terminal, file):
        progress = JobProgress("squares", 4, stream)
        progress.update(2, "a half")
        progress.close()
    assert "[############------------] squares: 2 of 4" in terminal.getvalue()
    assert terminal.getvalue().endswith("\r\x1b[K")
    assert file.getvalue().splitlines()[0] == "squares: 0 of 4" and "\x1b" not in file.getvalue()
    assert "squares: 2 of 4" in file.getvalue() and "(a half)" in file.getvalue()


def test_without_a_stream_nothing_is_written(capsys: pytest.CaptureFixture[str]) -> None:
    report = run_one(Squares(), Request(("squares",), quick=True, workers=1))
    assert report.data["squares"].rows[-1] == (2, 4)
    assert capsys.readouterr() == ("", "")


def test_the_tests_experiments_are_not_registered() -> None:
    assert trial_jobs.Squares.name not in EXPERIMENTS
