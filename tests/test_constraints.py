"""Laws of the geometric constraints."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vita.constraints import CONSTRAINTS, Constraint, Term, constraint_of, register, signed_distance, stack
from vita.errors import BadInput, UnknownName
from vita.types import Feature, frozen

KINDS = sorted(CONSTRAINTS)
ROWS = {"point_to_point": 2, "point_to_line": 1, "line_to_line": 2, "parallel_lines": 1}


def random_points(rng: np.random.Generator, kind: str) -> np.ndarray:
    """Points of a 640x480 view whose lines are not too short."""
    constraint = CONSTRAINTS[kind]
    while True:
        points = rng.uniform([0, 0], [640, 480], size=(constraint.arity, 2))
        if all(np.linalg.norm(points[a] - points[b]) > 10 for a, b in constraint.lines()):
            return points


def satisfied(rng: np.random.Generator, kind: str) -> np.ndarray:
    """Points that fulfil the geometric predicate exactly."""
    points = random_points(rng, kind)
    if kind == "point_to_point":
        points[0] = points[1]
    elif kind == "point_to_line":
        points[0] = points[1] + rng.uniform(-2, 2) * (points[2] - points[1])
    elif kind == "line_to_line":
        along = points[3] - points[2]
        points[0], points[1] = points[2] + rng.uniform(-2, 0) * along, points[2] + rng.uniform(0.5, 2) * along
    elif kind == "parallel_lines":
        points[1] = points[0] + rng.choice([-1, 1]) * rng.uniform(0.5, 2) * (points[3] - points[2])
    return points


@pytest.mark.parametrize("kind", KINDS)
def test_the_residual_is_zero_where_the_predicate_holds(kind: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(1000):
        assert np.abs(CONSTRAINTS[kind].residual(satisfied(rng, kind))).max() < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_the_residual_is_not_zero_where_the_predicate_fails(kind: str) -> None:
    rng = np.random.default_rng(2)
    for _ in range(1000):
        points = satisfied(rng, kind)
        direction = rng.normal(size=2)
        if CONSTRAINTS[kind].lines():
            a, b = CONSTRAINTS[kind].lines()[-1]
            along = points[b] - points[a]
            direction = np.array([-along[1], along[0]])  # Sliding along the line would change nothing.
        points[0] += 5.0 * direction / np.linalg.norm(direction)
        assert np.abs(CONSTRAINTS[kind].residual(points)).max() > 0.5


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_gives_one_named_row_per_component(kind: str) -> None:
    points = random_points(np.random.default_rng(3), kind)
    constraint = CONSTRAINTS[kind]
    assert constraint.residual(points).shape == (ROWS[kind],) == (len(constraint.components),)


@pytest.mark.parametrize("kind", KINDS)
def test_residuals_do_not_depend_on_where_the_image_origin_is(kind: str) -> None:
    rng = np.random.default_rng(4)
    for _ in range(200):
        points = random_points(rng, kind)
        moved = CONSTRAINTS[kind].residual(points + rng.uniform(-500, 500, 2))
        np.testing.assert_allclose(moved, CONSTRAINTS[kind].residual(points), atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_residuals_are_pixels_so_they_scale_with_the_image(kind: str) -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        points = random_points(rng, kind)
        np.testing.assert_allclose(
            CONSTRAINTS[kind].residual(2.0 * points), 2.0 * CONSTRAINTS[kind].residual(points), atol=1e-9
        )


def homogeneous(point: np.ndarray) -> np.ndarray:
    return np.array([point[0], point[1], 1.0])


def test_unit_normal_rows_agree_in_sign_with_the_raw_product_and_equal_the_pixel_distance() -> None:
    """Thesis eq. 3.4, l . p with l = f1 x f2, against our signed pixel distance."""
    rng = np.random.default_rng(6)
    for _ in range(1000):
        p, a, b = random_points(rng, "point_to_line")
        raw = float(np.cross(homogeneous(a), homogeneous(b)) @ homogeneous(p))
        ours = signed_distance(p, a, b)
        assert np.sign(raw) == np.sign(ours)
        foot = a + ((p - a) @ (b - a)) / ((b - a) @ (b - a)) * (b - a)
        assert abs(abs(ours) - np.linalg.norm(p - foot)) < 1e-9


def test_parallel_rows_agree_with_the_raw_product() -> None:
    """The third component of (f1 x f2) x (f3 x f4), divided by the goal's length."""
    rng = np.random.default_rng(7)
    for _ in range(1000):
        points = random_points(rng, "parallel_lines")
        f = [homogeneous(p) for p in points]
        raw = np.cross(np.cross(f[0], f[1]), np.cross(f[2], f[3]))[2]
        ours = CONSTRAINTS["parallel_lines"].residual(points)[0]
        assert ours == pytest.approx(raw / np.linalg.norm(points[3] - points[2]), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_a_lost_point_makes_the_residual_nan(kind: str) -> None:
    for index in range(CONSTRAINTS[kind].arity):
        points = random_points(np.random.default_rng(8), kind)
        points[index] = np.nan
        assert np.isnan(CONSTRAINTS[kind].residual(points)).any()


@pytest.mark.parametrize("kind", ["point_to_line", "line_to_line", "parallel_lines"])
def test_a_line_too_short_is_refused_when_drawn_and_nan_in_motion(kind: str) -> None:
    constraint = CONSTRAINTS[kind]
    points = random_points(np.random.default_rng(9), kind)
    a, b = constraint.lines()[-1]
    points[b] = points[a] + [1.0, 0.5]
    with pytest.raises(BadInput, match="1.1 px apart"):
        constraint.check(points)
    assert np.isnan(constraint.residual(points)).all()


def test_a_duplicate_kind_is_refused() -> None:
    with pytest.raises(ValueError, match="registered twice"):
        register(CONSTRAINTS["point_to_point"])


def test_an_unknown_kind_names_the_closest_and_all_choices() -> None:
    with pytest.raises(UnknownName, match=r"point_to_pint.*point_to_point.*parallel_lines|parallel_lines"):
        constraint_of("point_to_pint")


def test_every_kind_is_complete_for_people() -> None:
    colors = {c.color for c in CONSTRAINTS.values()}
    assert len(colors) == len(CONSTRAINTS), "two kinds share a colour"
    for constraint in CONSTRAINTS.values():
        assert isinstance(constraint, Constraint) and constraint.title
        assert 0 < constraint.moving < constraint.arity


def test_the_stack_labels_every_row_and_keeps_weights_beside_the_values() -> None:
    features = {n: Feature(frozen([10.0 * i, 5.0 * i**2])) for i, n in enumerate("abcd")}
    terms = [
        Term("p", "point_to_point", ("a", "b"), "left", 2.0),
        Term("l", "line_to_line", ("a", "b", "c", "d"), "right"),
    ]
    error = stack(terms, features)
    assert [(x.constraint, x.camera, x.component) for x in error.labels] == [
        ("p", "left", "u"),
        ("p", "left", "v"),
        ("l", "right", "distance 1"),
        ("l", "right", "distance 2"),
    ]
    np.testing.assert_array_equal(error.weights, [2, 2, 1, 1])
    np.testing.assert_allclose(error.of("p"), [-10, -5])
    assert error.largest == np.abs(error.values).max()


@given(st.sampled_from("abcd"))
def test_only_the_rows_of_a_lost_tracker_drop_out(lost: str) -> None:
    features = {n: Feature(frozen([50.0 * i, 5.0 * i**2])) for i, n in enumerate("abcd")}
    features[lost] = Feature(features[lost].uv, "lost", 0.0)
    error = stack(
        [Term("x", "point_to_point", ("a", "b"), "l"), Term("y", "point_to_point", ("c", "d"), "l")], features
    )
    gone = {
        label.constraint for label, value in zip(error.labels, error.values, strict=True) if np.isnan(value)
    }
    assert gone == {"x" if lost in "ab" else "y"}


def test_the_stack_is_frozen() -> None:
    error = stack([Term("p", "point_to_point", ("a", "b"), "l")], {n: Feature(frozen([1, 2])) for n in "ab"})
    with pytest.raises(ValueError, match="read-only"):
        error.values[0] = 1.0


def test_an_empty_task_has_no_rows_and_no_size() -> None:
    error = stack([], {})
    assert error.values.size == 0 and np.isnan(error.largest)
