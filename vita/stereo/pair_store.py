"""The pairs that an on-line calibration rests on: few, recent, and spread as widely as the arm has been."""

from __future__ import annotations

import numpy as np

from vita.types import Array

NEW_SHARE = 0.25
"""Share that a new pair has, at least, in the mean of those at its place: the latest seven or so count."""
FIT_CHI2 = 30.0
"""A pair that differs from its place's by more (squared, in standard deviations) takes its place instead."""


class PairStore:
    """At most `most` pairs, no two nearer than `spacing_m` in the base frame.

    A pair near to one that is kept is averaged with it. The mean of two pairs is as good a pair as they are,
    whatever rigid motion ties them, because it is the same mean at both ends.
    """

    def __init__(self, spacing_m: float, most: int, arm_sd_m: float) -> None:
        self._spacing, self._most, self._arm = spacing_m, most, arm_sd_m**2 * np.eye(3)
        self._base, self._left = np.zeros((most, 3)), np.zeros((most, 3))
        self._covariances, self._whiteners = np.zeros((most, 3, 3)), np.zeros((most, 3, 3))
        self._stamps, self._counts = np.zeros(most), np.zeros(most)
        # Squared distances between all kept pairs, so that the two nearest are found without computing all.
        self._gaps = np.full((most, most), np.inf)
        self.clear()

    def clear(self) -> None:
        """Forget all pairs."""
        self._size = 0
        self._gaps[:] = np.inf

    def __len__(self) -> int:
        return self._size

    @property
    def base(self) -> Array:
        """(k, 3) by the joints [m]."""
        return self._base[: self._size]

    @property
    def left(self) -> Array:
        """(k, 3) by the cameras [m]."""
        return self._left[: self._size]

    @property
    def whiteners(self) -> Array:
        """(k, 3, 3) W with W' W the inverse covariance of the camera's point: they make its noise white."""
        return self._whiteners[: self._size]

    def add(self, stamp: float, x_base: Array, x_left: Array, covariance: Array) -> None:
        """Keep a pair: averaged with its neighbour, in the place of the older of the two nearest, or anew."""
        squares = self._squares(x_base)
        place, count = self._size, 1.0
        if len(squares) and squares.min() < self._spacing**2:
            place = int(np.argmin(squares))
            if self._alike(place, x_left, covariance):
                count = min(self._counts[place] + 1.0, 1.0 / NEW_SHARE)
                share = 1.0 / count
                x_base = (1 - share) * self._base[place] + share * x_base
                x_left = (1 - share) * self._left[place] + share * x_left
                covariance = (1 - share) ** 2 * self._covariances[place] + share**2 * covariance
        elif self._size == self._most:
            # Dropping the oldest would in time leave only where the arm is now; this keeps the spread.
            i, j = np.unravel_index(int(np.argmin(self._gaps)), self._gaps.shape)
            place = int(i if self._stamps[i] < self._stamps[j] else j)
        else:
            self._size += 1
        # What the joints get wrong is the same at the next visit and is not averaged away.
        self._whiteners[place] = np.linalg.inv(np.linalg.cholesky(covariance + self._arm))
        self._base[place], self._left[place], self._covariances[place] = x_base, x_left, covariance
        self._stamps[place], self._counts[place] = stamp, count
        squares = self._squares(x_base)
        squares[place] = np.inf
        self._gaps[place, : self._size] = self._gaps[: self._size, place] = squares

    def _squares(self, x_base: Array) -> Array:
        away = self.base - x_base
        return np.einsum("ij,ij->i", away, away)

    def _alike(self, place: int, x_left: Array, covariance: Array) -> bool:
        """Whether a point so near to a kept one in the base frame is as near to it in the camera's."""
        away = x_left - self._left[place]
        slack = self._spacing**2 * np.eye(3) + self._arm
        return bool(away @ np.linalg.solve(self._covariances[place] + covariance + slack, away) < FIT_CHI2)
