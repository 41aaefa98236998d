"""Notices that somebody has moved the cameras: the tool is no longer seen where the joints say it is.

Two tests. The coarse one: the distance is over a threshold in so many pictures running. The fine one looks at
the *mean* offset of the last second, which noise leaves small and a moved tripod does not, against its own
covariance; it sees moves far below the coarse threshold, at the price of a second.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from vita.errors import BadInput
from vita.stereo.rigid_fit import rotations_of
from vita.types import Array

WINDOW = 33
"""Pictures that the fine test looks at: a second's."""
CORRELATED = 3.0
"""Pictures whose errors are alike: tracked corners err in the same way while little moves."""
FINE_CHI2 = 33.0
"""Squared Mahalanobis distance of the mean offset that counts as moved; chance alone: 3e-7."""
DOUBT_CHI2 = 16.0
"""The same that makes the pairs suspect, so that none is learned from."""
BIAS_M = 6e-4
"""Steady error of healthy cameras, per coordinate: lens, marker and joints are not perfect [m]."""
CLIP_M = 0.012
"""The fine test counts no single offset as longer than this: the coarse one sees those [m]."""
STANDS_S = 0.5
"""The cameras stand when the pairs of so long agree with one rigid motion [s]."""
STANDS_PAIRS = 8
"""Pairs that this takes at least."""
STANDS_M = 0.002
"""As well as this, root mean square, beside their noise [m]."""


class MovedRig:
    """Fed with every picture by `update`, and by `watch` to tell whether the cameras stand again."""

    def __init__(self, threshold_m: float, frames: int) -> None:
        if not (math.isfinite(threshold_m) and threshold_m > 0):
            raise BadInput(f"must be above 0 m, got {threshold_m!r}", "threshold_m")
        if frames < 1:
            raise BadInput(f"at least one picture is needed, got {frames!r}", "frames")
        self._threshold, self._frames = threshold_m, frames
        self._pairs: deque[tuple[float, Array, Array, float]] = deque()
        self.restart()

    def restart(self) -> None:
        """The cameras are calibrated anew. What `settled` looks at is kept: it needs no calibration."""
        self._far = self._count = 0
        self._offsets, self._spreads = np.zeros((WINDOW, 3)), np.zeros((WINDOW, 3, 3))
        self.distance2 = 0.0
        """Squared Mahalanobis distance of the mean offset of the fine test."""

    def update(
        self, residual: float | Array | None, covariance: Array | None = None, known: Array | None = None
    ) -> bool:
        """Take in one picture; True when the cameras have been moved.

        residual: T x_cam - x_fk [m], as a vector (3,) or its length; None where the tool was not seen or no
        calibration is known. covariance: (3, 3) of the vector by the picture's noise; the fine test needs
        both. known: (3, 3) of the vector by what the calibration itself does not know.
        """
        if residual is None:
            # A picture without the tool says nothing, but the run of far ones is broken.
            self._far = 0
            return False
        vector = np.asarray(residual, dtype=float)
        length = float(np.linalg.norm(vector))
        if not math.isfinite(length):
            raise BadInput(f"expected finite numbers, got {residual!r}", "residual")
        self._far = self._far + 1 if length > self._threshold else 0
        fine = False
        if vector.shape == (3,) and covariance is not None:
            place = self._count % WINDOW
            # One picture whose corners are wild must not shift the mean by more than the cameras' noise does.
            self._offsets[place] = vector * min(1.0, CLIP_M / max(length, CLIP_M))
            self._spreads[place] = covariance
            self._count += 1
            fine = self._fine(known)
        return self._far >= self._frames or fine

    @property
    def suspicious(self) -> bool:
        """Whether pairs are better not learned from until this has cleared."""
        return self._far > 0 or self.distance2 > DOUBT_CHI2

    def _fine(self, known: Array | None) -> bool:
        count = min(self._count, WINDOW)
        mean = self._offsets[:count].mean(axis=0)
        S = min(1.0, CORRELATED / count) * self._spreads[:count].mean(axis=0) + BIAS_M**2 * np.eye(3)
        if known is not None:
            S = S + known
        self.distance2 = float(mean @ np.linalg.solve(S, mean))
        return count == WINDOW and self.distance2 > FINE_CHI2

    # ---- still being moved, or standing again --------------------------------------------------------

    def watch(self, stamp: float, x_base: Array, x_left: Array, covariance: Array | None = None) -> None:
        """Take in a pair of the same point (3,) by the joints and by the cameras [m]; (3, 3) covariance of
        the latter [m^2]."""
        noise = 0.0 if covariance is None else float(np.trace(covariance))
        self._pairs.append((stamp, np.array(x_base, dtype=float), np.array(x_left, dtype=float), noise))
        # Where pictures are rare, as many as tell something are kept however old they are.
        while len(self._pairs) > STANDS_PAIRS and self._pairs[0][0] < stamp - STANDS_S - 1e-9:
            self._pairs.popleft()

    @property
    def settled(self) -> bool:
        """Whether the pairs of the last half second agree with one rigid motion: nobody moves the cameras.

        An arm at rest settles it best: then the cameras must see the tool at one place. While it moves along
        a line, a turn of the cameras about that line goes unnoticed.
        """
        if len(self._pairs) < STANDS_PAIRS or self._pairs[-1][0] - self._pairs[0][0] < 0.8 * STANDS_S:
            return False
        base, left = (np.array([pair[i] for pair in self._pairs]) for i in (1, 2))
        db, dl = base - base.mean(axis=0), left - left.mean(axis=0)
        rest = db - dl @ rotations_of(dl.T @ db).T
        square = float(np.einsum("ij,ij->", rest, rest)) / len(rest)
        # A window's rms strays from the noise's own by a tenth or so; half as much again is no chance.
        return square < STANDS_M**2 + 2.25 * sum(pair[3] for pair in self._pairs) / len(rest)
