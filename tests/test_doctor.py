"""The constraint doctor: laws of linear algebra on true Jacobians of the simulated arm."""

from __future__ import annotations

import numpy as np
import pytest

from vita.constraints import Term
from vita.experiments.arms import arm_of
from vita.experiments.cameras import Cameras, look_at
from vita.servo.doctor import diagnose, readable
from vita.servo.task_check import examine_task
from vita.types import Feature, RowLabel, frozen

NAMES = [f"joint{i + 1}" for i in range(7)]
ARM = arm_of("wam7")
VIEWS = Cameras(look_at(np.array([[1.4, -0.9, 0.5], [1.4, 0.9, 0.5]]), np.array([0.5, 0.0, 0.1])), 600.0)
NOISE = 1e-4
"""Variance of the exact Jacobian's entries, for rounding [px^2/rad^2]."""


def poses(count: int) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    middle = np.array([0.0, 0.7, 0.0, 1.9, 0.0, 0.5, 0.0])
    return [middle + rng.uniform(-0.4, 0.4, 7) for _ in range(count)]


def pixels(q: np.ndarray, local: np.ndarray) -> np.ndarray:
    return VIEWS.project(ARM.points(q, local)).reshape(*q.shape[:-1], -1)


def true_jacobian(q: np.ndarray, local: np.ndarray) -> np.ndarray:
    """(4 k, 7) of `local` (k, 3) in two views, by central differences."""
    step = 1e-6 * np.eye(7)
    return ((pixels(q + step, local) - pixels(q - step, local)) / 2e-6).T


def labels(count: int) -> list[RowLabel]:
    """Point by point in each view, as `pixels` has them."""
    views = [(view, k) for view in ("left", "right") for k in range(count)]
    return [RowLabel(f"point {k} in {view}", view, part) for view, k in views for part in "uv"]


def cloud(count: int) -> np.ndarray:
    return np.random.default_rng(count).uniform(-0.1, 0.1, (count, 3))


@pytest.mark.parametrize(("points", "held"), [(1, 3), (2, 5), (3, 6), (4, 6)])
def test_points_in_two_views_hold_three_five_and_six_motions(points: int, held: int) -> None:
    for q in poses(6):
        J = true_jacobian(q, cloud(points))
        found = diagnose(J, NOISE, labels(points), np.zeros(len(J)), NAMES, 0.1)
        assert found.held == held and len(found.free) == 7 - held
        # A free motion moves no row, and what is held is orthogonal to none of them.
        assert np.abs(J @ found.free_motions.T).max(initial=0.0) < 1e-3


def test_a_copy_is_redundant_and_its_original_too() -> None:
    for q in poses(6):
        J = true_jacobian(q, cloud(1))
        double = np.concatenate([J, J[:2]])
        names = [*labels(1), RowLabel("copy", "left", "u"), RowLabel("copy", "left", "v")]
        found = diagnose(double, NOISE, names, np.zeros(6), NAMES, 0.1)
        assert set(found.redundant) == {"copy", "point 0 in left"} and found.needed == ("point 0 in right",)
        assert diagnose(double, NOISE, names, np.zeros(6), NAMES, 0.1, rank=3).redundant == found.redundant


def test_needed_means_that_the_rank_falls_without_it() -> None:
    for q in poses(6):
        J, rows = true_jacobian(q, cloud(3)), labels(3)
        found = diagnose(J, NOISE, rows, np.zeros(12), NAMES, 0.1)
        for name in {row.constraint for row in rows}:
            keep = [i for i, row in enumerate(rows) if row.constraint != name]
            rank = np.linalg.matrix_rank(J[keep], tol=1.0)
            assert (name in found.needed) == (rank < found.held), name
    alone = diagnose(true_jacobian(poses(1)[0], cloud(1)), NOISE, labels(1), np.zeros(4), NAMES, 0.1)
    assert alone.needed == ("point 0 in left", "point 0 in right") and not alone.redundant


def test_a_contradictory_pair_is_named_and_nobody_else() -> None:
    """In one view a point is sent to two places 30 px apart; a third constraint has nothing to do with it."""
    for q in poses(6):
        J = true_jacobian(q, cloud(1))[:2]
        rows = [*labels(1)[:2], RowLabel("elsewhere", "left", "u"), RowLabel("elsewhere", "left", "v")]
        rows.append(RowLabel("wrist", "", "angle"))
        both = np.concatenate([J, J, [[0, 0, 0, 0, 0, 0, 300.0]]])
        error = both @ np.random.default_rng(1).normal(0, 0.02, 7) + [0, 0, 30.0, 0, 0]
        found = diagnose(both, NOISE, rows, error, NAMES, 0.1)
        assert set(found.conflicting) == {"point 0 in left", "elsewhere"}
        # Least squares meets them half way: 15 px off at either.
        assert found.conflict_px == pytest.approx(30.0 / np.sqrt(2.0), rel=1e-3)
        assert any(f.code == "conflict" and "'elsewhere'" in f.text for f in found.findings)
        assert not diagnose(both, NOISE, rows, error - [0, 0, 30.0, 0, 0], NAMES, 0.1).conflicting


def test_a_second_view_takes_sides() -> None:
    """What both views agree on is right; the constraint that contradicts it is named alone or with it."""
    for q in poses(6):
        J = true_jacobian(q, cloud(1))
        rows = [*labels(1), RowLabel("elsewhere", "left", "u"), RowLabel("elsewhere", "left", "v")]
        error = np.concatenate([J, J[:2]]) @ np.full(7, 0.01) + [*np.zeros(4), 30.0, 0.0]
        found = diagnose(np.concatenate([J, J[:2]]), NOISE, rows, error, NAMES, 0.1)
        assert "elsewhere" in found.conflicting and "point 0 in right" not in found.conflicting


def test_noise_and_distance_are_no_contradiction() -> None:
    """On the true geometry no error is impossible, however far away the arm starts."""
    rng = np.random.default_rng(5)
    for q in poses(20):
        local = cloud(3)
        goal = pixels(q + rng.normal(0, 0.15, 7), local)
        error = pixels(q, local) - goal + rng.normal(0, 0.2, 12)
        found = diagnose(true_jacobian(q, local), NOISE, labels(3), error, NAMES, 0.3)
        assert found.conflicting == (), (found.conflict_px, error)


def test_weights_and_units_leave_the_count_alone() -> None:
    J = true_jacobian(poses(1)[0], cloud(3))
    for scale in (1e-3, 1.0, 1e3):
        assert diagnose(scale * J, scale**2 * NOISE, labels(3), np.zeros(12), NAMES, 0.1).held == 6


def test_rows_that_are_not_seen_are_left_out() -> None:
    J, error = true_jacobian(poses(1)[0], cloud(1)), np.array([1.0, 2.0, np.nan, np.nan])
    found = diagnose(J, NOISE, labels(1), error, NAMES, 0.1)
    assert (found.held, found.rows) == (2, 2)


def test_a_joint_that_is_free_alone_is_named_alone() -> None:
    J = np.diag([10.0, 10.0, 10.0, 10.0, 10.0, 0.0, 0.0])
    J[0, 6] = J[0, 5] = 5.0  # Joints 6 and 7 do the same to row 0 as half of joint 1 does.
    found = diagnose(J, NOISE, labels(2)[:7], np.zeros(7), NAMES, 0.1)
    assert found.held == 5 and all("joint" in text for text in found.free)
    J[0, 6] = 0.0
    assert "joint7" in diagnose(J, NOISE, labels(2)[:7], np.zeros(7), NAMES, 0.1).free


def test_readable_motions_span_the_same_space() -> None:
    rng = np.random.default_rng(0)
    for k in (1, 2, 4):
        motions = np.linalg.qr(rng.normal(size=(7, k)))[0].T
        ours = readable(motions)
        np.testing.assert_allclose(ours @ motions.T @ motions, ours, atol=1e-9)
        assert np.linalg.matrix_rank(ours) == k


# What the drawing alone tells -----------------------------------------------------------------------


def feature(*uv: float) -> Feature:
    return Feature(frozen(uv))


PLACES = {
    "tip": feature(100, 100), "a": feature(200, 100), "b": feature(260, 100), "near_a": feature(201, 100),
    "l0": feature(0, 50), "l1": feature(300, 50), "m0": feature(0, 90), "m1": feature(300, 90),
    "x0": feature(50, 0), "x1": feature(50, 300),
}  # fmt: skip


def point(name: str, goal: str, camera: str = "left") -> Term:
    return Term(name, "point_to_point", ("tip", goal), camera)


def onto(name: str, *line: str) -> Term:
    return Term(name, "point_to_line", ("tip", *line), "left")


@pytest.mark.parametrize(
    ("terms", "code"),
    [
        ((point("one", "a"), point("two", "b")), "conflict"),
        ((point("one", "a"), point("two", "near_a")), "duplicate"),
        ((onto("one", "l0", "l1"), onto("two", "m0", "m1")), "conflict"),
        ((onto("one", "l0", "l1"), onto("two", "l1", "l0")), "duplicate"),
        ((onto("one", "l0", "l1"), point("two", "a")), "conflict"),
        ((point("one", "tip"),), "self"),
    ],
)
def test_the_drawing_alone_shows(terms: tuple[Term, ...], code: str) -> None:
    found = [f for f in examine_task(terms, PLACES) if f.code == code]
    assert len(found) == 1 and all(repr(term.name) in found[0].text for term in terms)


def test_lines_that_cross_and_two_views_are_no_contradiction() -> None:
    crossing = (onto("one", "l0", "l1"), onto("two", "x0", "x1"))
    views = (point("one", "a", "left"), point("two", "b", "right"))
    for terms in (crossing, views):
        assert not {"conflict", "duplicate"} & {f.code for f in examine_task(terms, PLACES)}


def test_fixed_pixels_alone_cannot_move_and_one_view_is_said() -> None:
    codes = {f.code for f in examine_task((point("one", "a"),), PLACES, fixed={"tip", "a"})}
    assert codes == {"immovable", "one_view"}
    assert examine_task((point("one", "a"), point("two", "b", "right")), PLACES) == ()


def test_without_pixels_names_are_compared() -> None:
    assert [f.code for f in examine_task((point("one", "a"), point("two", "b")))] == ["conflict", "one_view"]
