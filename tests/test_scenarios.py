"""Contracts over every scenario that ships: on rendered pixels, with real trackers."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from kept_off import KeptOff, listening

import vita
from vita.constraints import CONSTRAINTS
from vita.scenario.checkup import degrees_of_freedom
from vita.scenario.headless import run_scenario
from vita.scenario.library import shipped, welcome
from vita.scenario.record import RunRecord
from vita.scenario.toml_io import dumps, loads

NAMES = sorted(shipped())
pytestmark = pytest.mark.timeout(300)
KEPT_OFF: dict[str, KeptOff] = {}


@cache
def record_of(name: str) -> RunRecord:
    with listening() as KEPT_OFF[name]:
        return run_scenario(vita.load(name), name=name)


@pytest.mark.parametrize("name", NAMES)
def test_it_is_the_same_after_saving_and_loading(name: str) -> None:
    scenario = vita.load(name)
    assert loads(dumps(scenario)) == scenario


@pytest.mark.parametrize("name", NAMES)
def test_it_meets_its_expectations(name: str) -> None:
    record = record_of(name)
    assert record.expect, f"{name} expects nothing"
    assert record.passed, f"{record.expect} {record.outcome}/{record.reason}: {record.message}"


ALIKE = (
    "line_to_line", "parallel_lines", "point_to_line", "point_to_point", "wrench_fixed", "wrench_flip",
    "follow_target", "keep_clear", "move_to_see", "move_tripod", "eye_in_hand", "half_hidden", "lost_tracker",
    "moving_edge", "wrench",
)  # fmt: skip
"""Tasks that are made of the same parts as others: running each of them twice would tell nothing more."""


@pytest.mark.parametrize("name", [name for name in NAMES if name not in ALIKE])
def test_two_runs_are_identical_to_the_bit(name: str) -> None:
    first, second = record_of(name), run_scenario(vita.load(name), name=name)
    for key in ("stamp", "q", "error", "command", "uv", "seen", "jacobian"):
        np.testing.assert_array_equal(getattr(first, key), getattr(second, key), err_msg=key)
    assert first.summary() == second.summary()


@pytest.mark.parametrize("name", NAMES)
def test_all_that_moves_the_arm_is_finite_and_inside_the_limits(name: str) -> None:
    record = record_of(name)
    assert np.isfinite(record.q).all() and np.isfinite(record.command).all()
    speed = np.abs(np.diff(record.q, axis=0)) / np.diff(record.stamp)[:, None]
    assert speed.max() <= record.scenario.limits.speed_rad_s * 1.001


@pytest.mark.parametrize("name", NAMES)
def test_nothing_that_the_arm_is_near_slows_it(name: str) -> None:
    """The monitor of distances never gets in the way of a task that ships."""
    record_of(name)
    kept_off = KEPT_OFF[name]
    assert kept_off.slowed == 0, kept_off.by
    assert 0.02 < kept_off.smallest < 0.5


@pytest.mark.parametrize("name", NAMES)
def test_it_runs_on_pictures(name: str) -> None:
    """With image trackers or, in the second mode, markers that are found in the pictures."""
    scenario = vita.load(name)
    kinds = {t.kind for t in scenario.tracker}
    assert "projected" not in kinds and ("auto" in kinds or scenario.mode == "impedance")


def test_every_kind_of_constraint_and_every_way_to_hold_a_camera_ships() -> None:
    scenarios = [vita.load(name) for name in NAMES]
    assert {c.kind for s in scenarios for c in s.constraint} >= set(CONSTRAINTS)
    assert {s.scene.robot for s in scenarios} >= {"wam4", "wam7", "tx90"}
    assert {s.mode for s in scenarios} == {"uvs", "impedance"}
    assert any(c.mount for s in scenarios for c in s.camera), "no eye-in-hand scenario"
    assert any(len(s.constraint) >= 8 for s in scenarios), "no stack of several constraints"
    assert any(s.expect and s.expect.reason == "tracker_lost" for s in scenarios)
    assert len(NAMES) >= 8


def test_a_task_with_rows_to_spare_goes_on_while_a_tracker_is_covered() -> None:
    record = record_of("half_hidden")
    hidden = np.asarray(~record.seen.all(axis=1))
    assert hidden.sum() > 10 and record.command[hidden].any(axis=1).all()
    steps = np.abs(np.diff(record.q, axis=0))[hidden[:-1]]
    # The first steps of the loss still brake from full speed.
    assert steps[6:].max() <= 0.5 * record.scenario.limits.speed_rad_s / 30 * 1.01
    assert not hidden[-1]


def test_the_lost_tracker_stops_the_arm_within_its_braking_distance() -> None:
    """No step is commanded from the tick of the loss on, and the arm stays where it came to rest."""
    record = record_of("lost_tracker")
    loss = int(np.flatnonzero(~record.seen.all(axis=1))[0])
    assert not record.command[loss:].any()
    braking_rad = 0.6**2 / (2 * 8.0) + 0.6 / 30
    assert np.abs(record.q[loss + 1 :] - record.q[loss]).max() <= braking_rad
    np.testing.assert_allclose(record.q[-1], record.q[-5], atol=1e-9)


def test_dead_band_is_off_unless_asked_for() -> None:
    assert vita.load("point_to_point").scene.dead_band_deg == 0.0
    assert record_of("dead_band").outcome == "limited"


def test_the_check_counts_the_joint_motions_that_a_task_holds() -> None:
    text = degrees_of_freedom(vita.load("point_to_point_wam4"))
    assert "4 error rows hold 3 of 4 joint motions" in text, text


@pytest.mark.parametrize("robot", ["wam4", "wam7"])
def test_the_first_scene_of_the_app_is_a_shipped_one_with_nothing_drawn(robot: str) -> None:
    scenario = welcome(robot)
    assert scenario.scene.robot == robot and not scenario.tracker and not scenario.constraint
