"""Going on without the rows of a lost tracker, when the rest holds the arm well enough.

The thesis stops whenever a tracker is lost (3.1). A task that is specified with rows to spare need
not: measured over point tasks in two views, losing one or two of six points leaves the error as it
was, while losing a whole camera does not. Hence the three conditions of `why_not`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vita.servo.estimators.base import RIGID_RANK
from vita.servo.reasons import status_for
from vita.types import Array, ErrorVector, RowLabel, Status

SPARE_ROWS = 2
"""So many more rows than joints must be left."""
KEPT_STRENGTH = 0.5
"""Least share of the smallest singular value that must be left: else some motion is hardly seen."""
HALF_SPEED = 0.5
RECOVERED_PERIODS = 10
"""Periods on end with every row seen before the arm is fast again."""
_NEGLIGIBLE = 0.02
"""Singular values below this share of the largest are noise, not motions that the task holds."""

_UNKNOWN = "learning needs to see every constraint"
Mask = NDArray[np.bool_]


def why_not(jacobian: Array, seen: Mask, labels: Sequence[RowLabel]) -> str:
    """Why the servo cannot go on with the rows of the (m,) mask `seen`; empty when it can.

    `jacobian` (m, n) over the joints in use, weighted [px/rad].
    """
    n, left = jacobian.shape[1], int(seen.sum())
    if left < n + SPARE_ROWS:
        return f"{left} error rows are left and {n} joints need {n + SPARE_ROWS}"
    blind = {label.camera for label in labels} - {
        label.camera for label, here in zip(labels, seen, strict=True) if here
    }
    if blind:
        return f"nothing is seen in the {', '.join(sorted(blind))} view"
    whole = np.linalg.svd(jacobian, compute_uv=False)[:RIGID_RANK]
    part = np.linalg.svd(jacobian[seen], compute_uv=False)[:RIGID_RANK]
    held = int(np.count_nonzero(whole > _NEGLIGIBLE * whole[0]))
    if held == 0 or part[held - 1] < KEPT_STRENGTH * whole[held - 1]:
        return "what is left hardly tells some of the arm's motions apart"
    return ""


class RowWatch:
    """Which rows were seen lately, and whether the arm may go on with them."""

    def __init__(self) -> None:
        self._seen: Mask | None = None
        self._whole_for = RECOVERED_PERIODS
        self.changed = False
        """Whether the rows of the last period were not those of the one before."""

    @property
    def degraded(self) -> bool:
        """Whether rows are missing, or have come back only just now."""
        return self._whole_for < RECOVERED_PERIODS

    def update(self, error: ErrorVector, jacobian: Array | None) -> str:
        """Take the error of this period; why the arm cannot move on it, empty when it can.

        `jacobian` (m, n) as in `why_not`; None before it is learned.
        """
        seen = np.isfinite(error.values)
        new = self._seen is None or not np.array_equal(seen, self._seen)
        why = ""
        if not seen.any():
            why = "nothing is seen any more"
        elif not seen.all():
            if jacobian is None:
                why = _UNKNOWN
            elif new:  # Judged on a Jacobian that knows all rows: later that of the lost is out of date.
                why = why_not(jacobian, seen, error.labels)
        self.changed = self._seen is not None and new
        self._seen = seen
        self._whole_for = self._whole_for + 1 if seen.all() else 0
        return why

    def status(self, culprit: str) -> Status:
        """What to tell people while `degraded`."""
        if self._seen is None or self._seen.all():
            return replace(status_for("rows_back"), degraded=True)
        left, rows = int(self._seen.sum()), self._seen.size
        return replace(status_for("rows_lost", culprit=culprit, left=left, rows=rows), degraded=True)
