"""What one pair of pictures says of a marker's pose, and the Kalman correction by it, all in 6 by 6.

Corners measure the pose alone, with noise alike in all directions, so that H' H / sigma^2 and H' (z - h) /
sigma^2 hold everything that the filter needs of up to sixteen numbers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.types import Array

_EYE6 = np.eye(6)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Linearised measurements of the pose error (dp, dr), in units of their noise."""

    N: Array
    """(6, 6) H' H / sigma^2."""
    g: Array
    """(6,) H' (z - h) / sigma^2."""
    e: float
    """|z - h|^2 / sigma^2."""
    count: int
    """Numbers measured."""

    @staticmethod
    def of(off: Array, H: Array, sigma: float) -> Evidence:
        """From the innovation z - h (k,) and the slope H (k, 6) [px]."""
        scale = 1.0 / sigma**2
        return Evidence(scale * (H.T @ H), scale * (off @ H), scale * float(off @ off), len(off))

    def __add__(self, other: Evidence) -> Evidence:
        """Both together: their noises are independent."""
        total = self.e + other.e
        return Evidence(self.N + other.N, self.g + other.g, total, self.count + other.count)

    def scaled(self, factor: float) -> Evidence:
        """The same with the noise's variance divided by `factor`."""
        return Evidence(factor * self.N, factor * self.g, factor * self.e, self.count)

    def surprise(self, P: Array) -> tuple[Array, Array]:
        """Squared Mahalanobis distance of the innovation, and log det S up to what does not depend on P, for
        each prior covariance of the pose in `P` (..., 6, 6)."""
        A = _EYE6 + P @ self.N
        solved = np.linalg.solve(A, (P @ self.g)[..., None])[..., 0]
        return self.e - solved @ self.g, np.linalg.slogdet(A)[1]

    def distance2(self, P: Array) -> float:
        """The first of `surprise` alone, for one prior covariance (6, 6)."""
        return self.e - float(self.g @ np.linalg.solve(_EYE6 + P @ self.N, P @ self.g))

    def unexplained(self) -> tuple[float, int]:
        """Squared distance that no pose at all explains, and its degrees of freedom: pure pixel noise."""
        freedom = self.count - 6
        if freedom <= 0:
            return 0.0, 0
        return max(0.0, self.e - float(self.g @ np.linalg.solve(self.N, self.g))), freedom


def corrected(cov: Array, evidence: Evidence, taken: Array) -> tuple[Array, Array]:
    """The error (12,) and its covariance (12, 12) after the measurement.

    cov: (12, 12) before it. taken: (6,) where the evidence was linearised, relative to the prediction.
    """
    right = np.column_stack([evidence.N @ cov[:6], evidence.g + evidence.N @ taken])
    half = np.linalg.solve(_EYE6 + evidence.N @ cov[:6, :6], right)
    after = cov - cov[:, :6] @ half[:, :12]
    return cov[:, :6] @ half[:, 12], 0.5 * (after + after.T)
