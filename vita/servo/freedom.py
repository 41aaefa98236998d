"""What a task leaves to chance, told right after learning and before the arm sets out.

A task may hold fewer motions than the joints can make: a point on a line, the card's cross over a ball. The
arm then takes the smallest motion, which is what most people want, so that it is a setting whether that is
allowed. Two cameras that look from one place are another matter: people drew the second view to pin the
depth down, both pictures will say done, and the tool may be anywhere along the line of sight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from vita.servo.doctor import diagnose
from vita.servo.estimators.base import RIGID_RANK, Estimate
from vita.servo.insight import combination
from vita.types import Array, ErrorVector, RowLabel


@dataclass(frozen=True)
class FreeMotions:
    """What becomes of joint motion that the task does not hold."""

    title: str
    doc: str


FREE_MOTIONS = {
    "allow": FreeMotions("go on", "Take the smallest joint motion that meets the task."),
    "hold": FreeMotions("hold", "Stop after learning when the task leaves a motion free, and say which."),
}
"""Choices of the setting `free_motions`."""
SAME_VIEW = 0.06
"""Two views show the same when one is the other, turned and scaled, but for this share of its motion. Six
degrees apart they differ by 0.08 or more, which is enough to converge on."""
SCALED_EVENLY = 0.7
"""Seen from one place a picture is turned and scaled alike in all directions, from another one squeezed."""
BLIND = 1000.0
"""Condition number above which the weakest motion is not seen."""
NOISE_TIMES = 4.0
"""A motion that shows less than so many times the noise is not seen."""


def under_constrained(
    estimate: Estimate, error: ErrorVector, names: Sequence[str]
) -> tuple[int, int, str] | None:
    """How many motions are held, how many there are, and the free ones in words; None when all are held.

    `estimate` is weighted, over the joints in use, whose `names` are given.
    """
    found = diagnose(
        estimate.jacobian, estimate.covariance, error.labels, error.weights * error.values, names,
        estimate.sigma, int(estimate.rank),
    )  # fmt: skip
    if found.held >= min(len(names), RIGID_RANK):
        return None
    return found.held, len(names), f"{'; '.join(found.free)} {'is' if len(found.free) == 1 else 'are'} free"


def one_viewpoint(estimate: Estimate, labels: Sequence[RowLabel], names: Sequence[str]) -> str:
    """The two cameras that look from one place, and the motion that neither shows, in words; empty when
    there are none. Judged by motion alone: nobody knows where the cameras are.

    Views that agree by nature do not count: every motion that the joints can make must not be seen.
    """
    jacobian = estimate.jacobian
    noise = float(np.sqrt(np.trace(estimate.covariance) / max(jacobian.shape[1], 1) * max(len(labels), 1)))
    alive = np.linalg.norm(jacobian, axis=0) > NOISE_TIMES * noise
    most = min(int(np.count_nonzero(alive)), RIGID_RANK)
    views = np.array([label.camera for label in labels])
    for one, other in combinations(dict.fromkeys(views.tolist()), 2):
        pair = jacobian[(views == one) | (views == other)]
        values = np.linalg.svd(pair, compute_uv=False)
        limit = max(NOISE_TIMES * noise, values[0] / BLIND)
        seen = int(np.count_nonzero(values > limit))
        if seen >= most or not _same(_points(jacobian, labels, one), _points(jacobian, labels, other)):
            continue
        weakest = np.linalg.svd(pair[:, alive])[2][seen]
        alive_names = [name for name, there in zip(names, alive.tolist(), strict=True) if there]
        return f"{combination(weakest, alive_names)}, since {one!r} and {other!r} look from the same place"
    return ""


def _points(jacobian: Array, labels: Sequence[RowLabel], camera: str) -> Array:
    """(k, 2, n) the rows of the point constraints of one view."""
    rows = [i for i, label in enumerate(labels) if label.camera == camera and label.component in ("u", "v")]
    return jacobian[rows].reshape(-1, 2, jacobian.shape[1])


def _same(one: Array, other: Array) -> bool:
    """Whether one map of the picture, turned and scaled, makes the points' motions (k, 2, n) of one view
    those of the other."""
    if not one.size or one.shape != other.shape:
        return False
    x, y = (motion.transpose(1, 0, 2).reshape(2, -1) for motion in (one, other))
    turn = y @ np.linalg.pinv(x)
    scales = np.linalg.svd(turn, compute_uv=False)
    even = scales[1] > SCALED_EVENLY * scales[0] and np.linalg.det(turn) > 0.0
    return bool(even) and float(np.linalg.norm(y - turn @ x)) < SAME_VIEW * float(np.linalg.norm(y))
