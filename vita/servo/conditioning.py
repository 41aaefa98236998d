"""Does the image still show every motion that it showed when the arm learned?

Near a singular pose one motion of the arm no longer moves the image. Its singular value goes to zero,
and the step that a control law asks for along it grows beyond bounds.
"""

from __future__ import annotations

import numpy as np

from vita.servo.estimators.base import RIGID_RANK
from vita.servo.insight import combination
from vita.types import Array

WEAKER, GONE = 0.3, 0.1
"""Shares of the weakest motion's first strength at which the arm slows down, and at which it stops."""
NEGLIGIBLE = 0.05
"""Singular values below this share of the largest belong to motions that the task hardly holds: those come
and go as the Jacobian is learned, and mean nothing."""
FAR_RAD = 0.15
"""An arm that has gone less far since it learned cannot have come to a singular pose: then the Jacobian is
wrong for another reason, such as a goal that moves by itself [rad]."""
FAR_TOLERANCES = 10.0
"""Nearer to the goal than so many tolerances steps are small, and a weak motion does no harm."""


class Conditioning:
    """Compares the weighted Jacobian of the joints in use with what it was after learning."""

    def __init__(self, jacobian: Array, rank: int, q: Array) -> None:
        """`jacobian` (m, k) [px/rad] as learned at the joints `q` (n,) [rad]; `rank` says how many motions
        the servo takes to be held."""
        self._home = q.copy()
        values = _values(jacobian)
        clear = int(np.count_nonzero(values > NEGLIGIBLE * values.max(initial=0.0)))
        self._held = min(clear, rank, RIGID_RANK)
        self._first = float(values[self._held - 1]) if self._held else 0.0
        self.ratio = 1.0
        """What is left of the weakest motion's strength."""
        self.motion: Array = np.zeros(jacobian.shape[1])
        """(k,) the motion that is weakest now."""

    @property
    def weaker(self) -> bool:
        return self.ratio < WEAKER

    @property
    def gone(self) -> bool:
        return self.ratio < GONE

    def update(self, jacobian: Array, q: Array, tolerances: float) -> None:
        """Take the weighted Jacobian (m, k) of now [px/rad], the joints `q` (n,) [rad], and how many
        tolerances the error is large."""
        if not self._held:
            return
        if np.abs(q - self._home).max() < FAR_RAD or tolerances < FAR_TOLERANCES:
            self.ratio = 1.0
            return
        _, values, axes = np.linalg.svd(jacobian, full_matrices=False)
        self.ratio = float(values[self._held - 1]) / self._first
        self.motion = axes[self._held - 1]

    def culprit(self, names: list[str]) -> str:
        """The joint motion that is weakest now, by the names of the joints in use."""
        return f"the images hardly show {combination(self.motion, names)}"


def _values(jacobian: Array) -> Array:
    values = np.linalg.svd(jacobian, compute_uv=False) if jacobian.size else np.zeros(0)
    return np.asarray(values, float)
