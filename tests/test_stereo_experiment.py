"""The stereo-impedance experiment: its parts against closed forms, its figures against runs made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from vita.experiments.stereo_cases import CASES, MOVED_DEG, MOVED_M, MOVED_OVER_S, MOVED_S, robot
from vita.experiments.stereo_found import back_s, noticed_s
from vita.experiments.stereo_parts import filtered, fits, triangulations
from vita.experiments.stereo_runs import StereoRun, run_crossings
from vita.scenario.truth_log import between_segments


def made(off_mm: np.ndarray, phase: tuple[str, ...]) -> StereoRun:
    """A run of one tick a second whose tool is off by so much, and whose recovered tool is right."""
    n = off_mm.size
    zero, line = np.zeros((n, 3)), np.zeros(n)
    gap = zero.copy()
    gap[:, 0] = 1e-3 * off_mm
    where, how = (zero, zero, zero, zero, gap), (line, line, line, line, line)
    return StereoRun("tripod", "tx90", np.arange(float(n)), *where, *how, phase)


def test_the_time_to_come_back_ends_with_the_last_tick_that_was_off() -> None:
    off = np.full(20, 2.0)
    off[10:14] = 50.0
    off[16] = 11.0
    run = made(off, ("following",) * 11 + ("looking",) * 3 + ("following",) * 6)
    assert back_s(run) == pytest.approx(16.0 - MOVED_S - MOVED_OVER_S)
    assert noticed_s(run) == pytest.approx(11.0 - MOVED_S)
    off[-1] = 11.0
    assert back_s(made(off, run.phase)) == np.inf


def test_the_tripod_moves_by_twenty_centimetres_and_thirty_degrees() -> None:
    truth = CASES["tripod"].truth(*robot("tx90"))
    before, after = truth.left(0.0), truth.left(MOVED_S + MOVED_OVER_S)
    turn = np.degrees(np.arccos((np.trace(before[:3, :3].T @ after[:3, :3]) - 1) / 2))
    assert np.linalg.norm(after[:3, 3] - before[:3, 3]) == pytest.approx(MOVED_M)
    assert turn == pytest.approx(MOVED_DEG, abs=0.2)


def test_triangulation_is_exact_without_noise_and_as_uncertain_as_it_says_with_it() -> None:
    found = triangulations(300, 1)
    assert found["exact_m"] < 1e-9 and 2.5 < found["mahalanobis"] < 3.6


def test_twenty_pairs_tell_the_rotation_and_the_printed_equation_does_not() -> None:
    found = fits(20, 60, 3)
    assert np.percentile(found[:, 0], 90) < 0.5 and np.percentile(found[:, 1], 95) < 3.0
    assert np.median(found[:, 2]) > 30.0


def test_the_filter_halves_the_error_of_holding_the_last_measurement() -> None:
    ours, holding = filtered(0.10, 20.0, 2)
    assert ours <= 0.5 * holding


def test_a_sphere_that_crosses_is_kept_off_and_the_tool_comes_back() -> None:
    (crossing,) = run_crossings("tx90", (3,))
    assert crossing.nearest_m > 0.0 and crossing.after_mm < 5.0


def test_the_distance_of_segments_is_that_of_their_nearest_points() -> None:
    random = np.random.default_rng(0)
    share = np.linspace(0.0, 1.0, 60)
    for _ in range(60):
        a, b, c, d = random.uniform(-1, 1, (4, 3))
        one, other = a + share[:, None] * (b - a), c + share[:, None] * (d - c)
        dense = np.linalg.norm(one[:, None] - other[None], axis=2).min()
        exact = between_segments(a, b, c, d)
        assert exact <= dense + 1e-12 and dense - exact < 0.03
    assert between_segments(np.zeros(3), np.zeros(3), np.ones(3), np.ones(3)) == pytest.approx(np.sqrt(3))
