"""Figures and words of what the servo knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vita.servo.estimators import first_estimate
from vita.servo.insight import combination, insight, words
from vita.types import Joint, RowLabel

JOINTS = tuple(Joint(f"joint{i + 1}", -2.0, 2.0, 1.0) for i in range(3))
LABELS = (RowLabel("one", "left", "u"), RowLabel("one", "left", "v"), RowLabel("two", "left", "u"),
          RowLabel("two", "left", "v"))  # fmt: skip


def jacobian(*values: float) -> np.ndarray:
    """(4, 3) with these singular values; joint k + 1 is the k-th axis."""
    left = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0][:, :3]
    return left @ np.diag(values)


def told(
    J: np.ndarray, predicted: np.ndarray | None = None, observed: np.ndarray | None = None
) -> dict[str, tuple[str, str]]:
    known = insight(first_estimate(J, 0.07, 0.1), LABELS, JOINTS, range(3), predicted, observed)
    return {f.code: (f.level, f.text) for f in words(known, JOINTS, range(3))}


def test_the_figures_are_those_of_the_singular_values() -> None:
    known = insight(first_estimate(jacobian(900, 300, 90), 0.07, 0.1), LABELS, JOINTS, range(3))
    np.testing.assert_allclose(known.singular_values, [900, 300, 90])
    assert known.held == known.joints == 3
    assert known.condition == pytest.approx(10.0) and known.weakest == pytest.approx(90.0)
    assert known.weak_joint == "joint3" and np.isnan(known.agreement)


def test_joints_out_of_use_count_for_nothing() -> None:
    known = insight(first_estimate(jacobian(900, 300, 9), 0.07, 0.1), LABELS, JOINTS, (0, 1))
    assert known.joints == 2 and known.condition == pytest.approx(3.0) and known.weak_joint == "joint2"


def test_uncertainty_is_the_deviation_over_the_size() -> None:
    """Against its definition: the root mean square entry of many draws of the error."""
    estimate = first_estimate(jacobian(900, 300, 90), 0.07, 0.5)
    known = insight(estimate, LABELS, JOINTS, range(3))
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(3), estimate.covariance, (4000, 4))
    off = np.sqrt(np.mean(np.sum(draws**2, axis=(1, 2)))) / np.linalg.norm(estimate.jacobian)
    assert known.uncertainty == pytest.approx(off, rel=0.05)


@pytest.mark.parametrize(("condition", "level"), [(29, "good"), (31, "info"), (101, "warning")])
def test_the_condition_number_has_words_and_a_culprit(condition: float, level: str) -> None:
    estimate = first_estimate(jacobian(900, 300, 900 / condition), 0.07, 1e-3)
    sure = replace(estimate, covariance=1e-6 * np.eye(3), rank=np.array(3))
    said = words(insight(sure, LABELS, JOINTS, range(3)), JOINTS, range(3))
    found = [f for f in said if f.code == "condition"]
    assert found[0].level == level and ("joint3" in found[0].text) == (level != "good")


def test_the_constraint_that_was_off_by_most_is_named() -> None:
    J = jacobian(900, 300, 90)
    predicted = np.array([10.0, 5.0, -4.0, 3.0])
    observed = predicted + np.array([0.0, 0.1, 12.0, 0.0])
    known = insight(first_estimate(J, 0.07, 0.1), LABELS, JOINTS, range(3), predicted, observed)
    assert known.weak_constraint == "two"
    level, text = told(J, predicted, observed)["agreement"]
    assert level != "good" and "'two'" in text
    assert told(J, predicted, predicted)["agreement"][0] == "good"


def test_a_surprise_inside_the_noise_is_nobodys_fault() -> None:
    predicted = np.array([10.0, 5.0, -4.0, 3.0])
    known = insight(first_estimate(jacobian(900, 300, 90), 0.07, 0.1), LABELS, JOINTS, range(3), predicted,
                    predicted + 0.2)  # fmt: skip
    assert known.weak_constraint == ""


def test_rows_that_were_not_seen_are_not_compared() -> None:
    predicted = np.array([10.0, 5.0, -4.0, 3.0])
    observed = np.array([10.0, 5.0, np.nan, np.nan])
    estimate = first_estimate(jacobian(900, 300, 90), 0.07, 0.1)
    known = insight(estimate, LABELS, JOINTS, range(3), predicted, observed)
    assert known.agreement == pytest.approx(1.0) and known.weak_constraint == ""


def test_a_task_that_moves_nothing_is_said_aloud() -> None:
    found = told(np.zeros((4, 3)))
    assert found["nothing_held"][0] == "bad" and "condition" not in found


def test_a_motion_in_words() -> None:
    names = ["a", "b", "c"]
    assert combination(np.array([0.0, 1.0, 0.0]), names) == "b"
    assert combination(np.array([0.7, 0.7, 0.0]), names) == "a and b"
    assert combination(np.array([-0.7, 0.7, 0.1]), names) == "a against b"
    # The sign of the whole means nothing.
    assert combination(np.array([0.7, -0.7, -0.1]), names) == "a against b"
    assert combination(np.zeros(3), names) == "no joint"
