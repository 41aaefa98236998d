"""A Kalman filter for trackers that jump: impulsive noise."""

from __future__ import annotations

import numpy as np

from vita.servo.estimators.base import CURVATURE, Estimate, Mask, Samples, Tuning, register
from vita.servo.estimators.kalman import Kalman
from vita.types import Array

WHOLE, CUT, NONE = 2.0, 3.0, 6.0
"""Corners of Hampel's psi, in scales: a surprise is believed whole up to the first, cut to that up to the
second, and believed less and less up to the third. Of normal noise it touches 5 %, and little of that."""
REMEMBERED = 7
"""Surprises of each row that its scale is the median of."""
TO_DEVIATION = 1.4826
"""Median of absolute values to standard deviation, for normal noise."""
ENOUGH_ROWS = 3
"""Rows of which the median says something about each of them."""


@register
class Robust(Kalman):
    """An M-estimator with Hampel's psi around the Kalman filter.

    Each row's surprise, what it did less what was expected, is compared with its scale. That is the
    deviation that the filter itself expects, or more, when the rows are surprised together (the arm
    has bent the Jacobian more than usual) or this row again and again (its Jacobian is wrong): a
    fixed width would then refuse to learn.

    A wild reading would spoil two secants, the one that ends with it and the one that begins with
    it. What is not believed is therefore taken from the reading before it becomes the beginning of
    the next secant. If the next reading is off to the same side it was no wild reading: the feature
    or its goal has jumped. That is no effect of the joints either, and is taken from where the
    present secant began.
    """

    kind = "robust"
    title = "Robust Kalman filter"
    doc = "Kalman filter that leaves out wild readings. Choose it when trackers jump now and then."

    def __init__(self, start: Estimate, history: Samples | None = None, tuning: Tuning | None = None) -> None:
        super().__init__(start, history, tuning)
        rows = start.jacobian.shape[:-1]
        self._recent = np.zeros((REMEMBERED, *rows))
        """Each row's last surprises, in expected deviations."""
        self._side = np.zeros(rows)
        """(..., m) to which side the last reading was wild, 0 for not at all."""
        self._believed = np.full(rows, np.nan)

    def believed(self, e: Array) -> Array:
        """A policy that steps by this instead of the raw error does not follow wild readings."""
        return np.where(np.isfinite(e), self._believed, e)

    def restart(self) -> None:
        super().restart()
        self._side = np.zeros_like(self._side)

    def observe(self, q: Array, e: Array) -> Mask:
        if self._q is None or self._e is None:
            self._believed = e.copy()
            return super().observe(q, e)
        dq = q - self._q
        surprise = e - self._e - np.einsum("...ij,...j->...i", self._estimate.jacobian, dq)
        ratio = np.abs(surprise) / np.sqrt(self._variance(dq))[..., None]
        excess = np.where(np.isfinite(surprise), surprise * (1.0 - hampel(ratio / self._scale(ratio))), 0.0)
        jumped = np.sign(excess) * self._side > 0.0
        self._side = np.where(jumped, 0.0, np.sign(excess))
        self._e = self._e + np.where(jumped, excess, 0.0)
        self._believed = e - np.where(jumped, 0.0, excess)
        learned = super().observe(q, self._believed)
        newest = np.where(np.isfinite(ratio), ratio, 0.0)
        shifted = np.concatenate([self._recent[1:], newest[None]])
        self._recent = np.where(learned[..., None], shifted, self._recent)
        return learned

    def _variance(self, dq: Array) -> Array:
        """(...,) of a row's surprise [px^2], as the Kalman filter expects it."""
        now = self._estimate
        length2 = np.einsum("...i,...i->...", dq, dq)
        known = np.einsum("...i,...ij,...j->...", dq, now.covariance, dq)
        drift = 0.5 * CURVATURE**2 * now.scale2 * length2**2
        return np.maximum(known + drift + 2.0 * now.sigma**2, 1e-300)

    def _scale(self, ratio: Array) -> Array:
        """(..., m) how many times its expected deviation each row's surprise usually is, at least 1."""
        own = np.sort(self._recent, axis=0)[len(self._recent) // 2]
        scale = np.maximum(1.0, TO_DEVIATION * own)
        ordered = np.sort(ratio, axis=-1)  # NaN, of rows that are not seen, comes last.
        count = np.count_nonzero(np.isfinite(ratio), axis=-1)
        # Of four rows two may belong to one tracker that has jumped: the lower median is of the others.
        middle = np.maximum(count - 1, 0)[..., None] // 2
        together = TO_DEVIATION * np.take_along_axis(ordered, middle, axis=-1)
        return np.where((count >= ENOUGH_ROWS)[..., None], np.maximum(scale, together), scale)


def hampel(ratio: Array) -> Array:
    """psi(r) / r of `ratio` r >= 0, any shape: the share of a surprise of r scales that is believed."""
    cut = np.minimum(1.0, WHOLE / np.maximum(ratio, WHOLE))
    return cut * np.clip((NONE - ratio) / (NONE - CUT), 0.0, 1.0)
