"""What the servo knows of its own Jacobian, in numbers and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vita.servo.estimators.base import Estimate
from vita.types import Array, Joint, RowLabel, frozen

Level = Literal["good", "info", "warning", "bad"]


@dataclass(frozen=True)
class Finding:
    """One thing that people should know, in a sentence."""

    level: Level
    code: str
    """Short and stable, for tests and scripts, e.g. `free_motion`, `redundant`, `conflict`."""
    text: str
    """Names the culprit (constraint, joint, camera) and the next step."""


@dataclass(frozen=True)
class Insight:
    """Figures of the present estimate over the joints in use and the rows that are seen."""

    singular_values: Array
    """(k,) of the weighted Jacobian, largest first [px/rad]."""
    held: int
    """How many directions of joint motion the task holds."""
    joints: int
    """How many joints are in use."""
    condition: float
    """Largest over smallest singular value among the held directions."""
    weakest: float
    """Smallest singular value among them [px/rad]."""
    uncertainty: float
    """Standard deviation of the Jacobian relative to its size, 0 to 1 and more."""
    predicted: Array
    """(m,) change of the error that the Jacobian predicted for the last motion that was learned from [px]."""
    observed: Array
    """(m,) the change that was seen [px]; NaN in rows that were not."""
    weak_joint: str
    """The joint that moves most in the weakest held direction."""
    weak_constraint: str
    """The constraint whose rows disagree most with what was predicted, or empty."""
    next_dq: Array
    """(n,) the step that would be taken next, without the limits [rad]."""
    near: bool = False
    """Whether noise matters more than the Jacobian's errors by now."""
    weak_direction: Array = field(default_factory=lambda: frozen([]))
    """(joints,) unit joint motion of the weakest held direction."""

    @property
    def agreement(self) -> float:
        """1 when the last motion did what was predicted, 0 when it did something else altogether."""
        seen: NDArray[np.bool_] = np.isfinite(self.observed)
        size = float(np.linalg.norm(self.observed[seen]))
        if size == 0.0:
            return float("nan")
        return max(0.0, 1.0 - float(np.linalg.norm((self.observed - self.predicted)[seen])) / size)


POOR_CONDITION = 100.0
GOOD_CONDITION = 30.0
"""A step's error in the weakest direction is the condition number times the Jacobian's relative error
(perturbation theory of least squares). An explored Jacobian is known to 1 to 2 %: below 30 that leaves
the sign of every direction certain, above 100 it leaves the weakest one to chance."""
GOOD_AGREEMENT, POOR_AGREEMENT = 0.7, 0.3
"""Of 1: shares of the last motion that came as predicted."""
KNOWN_WELL, KNOWN_BADLY = 0.1, 0.4
"""Deviation of the Jacobian relative to its size: a step's outcome is off by about that share."""
SURPRISE_SIGMAS = 5.0
"""A constraint is blamed for a surprise that is so many times the tracker noise."""
NONE = frozen([])


def insight(
    estimate: Estimate,
    labels: Sequence[RowLabel],
    joints: Sequence[Joint],
    used: Sequence[int],
    predicted: Array | None = None,
    observed: Array | None = None,
    next_dq: Array | None = None,
    near: bool = False,
) -> Insight:
    """The figures of `estimate`, (m, n) over all joints, of which `used` are in use.

    Its m rows are those that are seen, multiplied by their weights, and `labels` are theirs; so are
    the rows of `predicted` and `observed` (m,) [px], the last secant that was learned from (None
    before there is one). Cheap enough for every control period; `words` are made only when asked for.
    """
    columns = list(used)
    jacobian = estimate.jacobian[:, columns]
    m, n = jacobian.shape
    predicted = np.zeros(m) if predicted is None else predicted
    observed = np.full(m, np.nan) if observed is None else observed
    step = np.zeros(len(joints)) if next_dq is None else next_dq
    held = int(min(int(estimate.rank), m, n))
    if m == 0 or n == 0:
        values, axes = NONE, np.zeros((0, n))
    else:
        _, values, axes = np.linalg.svd(jacobian, full_matrices=False)
    weakest = float(values[held - 1]) if held else 0.0
    direction = axes[held - 1] if held else np.zeros(n)
    variance = m * float(estimate.covariance.diagonal()[columns].sum())
    size = float(np.sqrt(values @ values))  # Of the whole Jacobian: Frobenius' norm.
    return Insight(
        singular_values=frozen(values),
        held=held,
        joints=n,
        condition=float(values[0] / weakest) if weakest > 0.0 else float("inf"),
        weakest=weakest,
        uncertainty=float(np.sqrt(variance)) / size if size > 0.0 else float("inf"),
        predicted=frozen(predicted),
        observed=frozen(observed),
        weak_joint=joints[columns[int(np.argmax(np.abs(direction)))]].name if held else "",
        weak_constraint=_surprising(labels, predicted, observed, estimate.sigma),
        next_dq=frozen(step),
        near=bool(near),
        weak_direction=frozen(direction),
    )


def _surprising(labels: Sequence[RowLabel], predicted: Array, observed: Array, sigma: float) -> str:
    """The constraint that was off the prediction by most, or empty when the noise explains it all."""
    off = np.where(np.isfinite(observed), observed - predicted, 0.0)
    if off.size == 0 or np.abs(off).max() <= SURPRISE_SIGMAS * sigma:
        return ""
    sums: dict[str, float] = {}
    for label, value in zip(labels, off.tolist(), strict=True):
        sums[label.constraint] = sums.get(label.constraint, 0.0) + value * value
    return max(sums, key=lambda name: sums[name])


def words(insight: Insight, joints: Sequence[Joint], used: Sequence[int]) -> tuple[Finding, ...]:
    """What the figures mean, for people: each sentence names who is behind it and what to do."""
    names = [joints[j].name for j in used]
    return tuple(
        finding
        for finding in (
            _held(insight),
            _condition(insight, names),
            _known(insight),
            _agreement(insight),
            _near(insight),
        )
        if finding is not None
    )


def _held(now: Insight) -> Finding:
    text = f"The task is known to hold {now.held} of {now.joints} joint motions."
    if now.held == 0:
        return Finding(
            "bad",
            "nothing_held",
            f"{text} Learn again with larger exploratory motions, or check the trackers.",
        )
    if now.held < now.joints:
        text += " Along the others the arm moves as little as it can."
    return Finding("good" if now.held >= min(now.joints, 6) else "info", "held", text)


def _condition(now: Insight, names: Sequence[str]) -> Finding | None:
    if not now.held:
        return None
    behind = combination(now.weak_direction, names)
    text = f"Condition number {now.condition:.0f}"
    if now.condition <= GOOD_CONDITION:
        return Finding("good", "condition", f"{text}: every motion that the task holds is seen clearly.")
    if now.condition <= POOR_CONDITION:
        return Finding("info", "condition", f"{text}: fair. The images show least of {behind}.")
    return Finding(
        "warning", "condition",
        f"{text}: poor. The images hardly show {behind}; put points farther apart, or add a side view.",
    )  # fmt: skip


def _known(now: Insight) -> Finding:
    text = f"The Jacobian is known to about {_percent(now.uncertainty)}"
    if now.uncertainty <= KNOWN_WELL:
        return Finding("good", "known", f"{text}.")
    if now.uncertainty <= KNOWN_BADLY:
        return Finding("info", "known", f"{text}: steps are short until motion has told more.")
    return Finding("warning", "known", f"{text}: it is mostly a guess. Stop and learn again.")


def _agreement(now: Insight) -> Finding | None:
    share = now.agreement
    if not np.isfinite(share):
        return None
    culprit = f" '{now.weak_constraint}' was off by most." if now.weak_constraint else ""
    text = f"The last motion changed the error as predicted to {_percent(share)}"
    if share >= GOOD_AGREEMENT or not culprit:
        return Finding("good", "agreement", f"{text}.")
    if share >= POOR_AGREEMENT:
        return Finding("info", "agreement", f"{text}.{culprit}")
    return Finding(
        "warning",
        "agreement",
        f"{text}.{culprit} See whether its trackers are on their features; then learn again.",
    )


def _near(now: Insight) -> Finding | None:
    if not now.near:
        return None
    return Finding(
        "info", "near", "At the goal to within the trackers' noise: measurements are being averaged."
    )


def combination(direction: Array, names: Sequence[str], least: float = 0.35) -> str:
    """Joint names of a motion (n,), those that move at least `least` of the most, with their senses.

    The sign of the whole is of no meaning, so that one joint alone has none.
    """
    size = np.abs(direction)
    if not size.size or size.max() <= 0.0:
        return "no joint"
    # Down to a millionth two joints count as equally large: then the first one leads, on every machine.
    order = np.argsort(-np.round(size / size.max(), 6), kind="stable")
    chosen = [int(i) for i in order if size[i] >= least * size.max()][:4]
    lead = np.sign(direction[chosen[0]])
    with_it = [names[i] for i in chosen if np.sign(direction[i]) == lead]
    against = [names[i] for i in chosen if np.sign(direction[i]) != lead]
    text = _listed(with_it)
    return f"{text} against {_listed(against)}" if against else text


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _percent(share: float) -> str:
    return f"{100.0 * min(share, 9.99):.0f} %"
