"""How noisy the trackers are, and how far a joint must move to be measured through that noise.

The thesis asks for both at the end of 5.2.1: measure the noise of the trackers under the conditions of
the task, then choose the exploratory motions so that the relative error stays within bounds.
"""

from __future__ import annotations

import numpy as np

from vita.errors import BadInput
from vita.servo.estimators.base import CURVATURE
from vita.types import Array

ROUNDING_PX = float(np.sqrt(2.0 / 12.0))
"""Rounding is wrong by up to half a pixel, evenly: variance 1/12. An error row is the difference of two
readings, the feature's and its goal's [px]."""
LEAST_PX = 0.02
"""No tracker is taken to be better; an arm that stands still shows nothing of its systematic errors."""
OUTLIER = 4.5
"""Readings that are so many robust deviations off are left out."""
TO_DEVIATION = 1.4826
"""Median of absolute values to standard deviation, for normal noise."""
EXPLORE_RAD = (np.radians(1.0), np.radians(10.0))
"""Smallest and largest exploratory motion: below, friction and backlash rule; above, the features
leave the image."""
TYPICAL_PX_PER_RAD = 400.0
"""What a joint does to an error row when nothing is known yet (rms over rows and joints)."""


def measured_sigma(samples: Array, floor: float = LEAST_PX) -> float:
    """Standard deviation of one error row [px], from `samples` (t, m) of the error while the arm stands
    still, NaN where a row was not seen.

    Each row is compared with its own median, wild readings are left out and the rest is pooled over
    all rows. Trackers that report whole pixels show no noise at rest, yet they are wrong by their
    rounding. Never below `floor` [px]. Raises `BadInput` when no row was read twice.
    """
    samples = np.asarray(samples, float)
    seen = np.isfinite(samples)
    twice = np.count_nonzero(seen, axis=0) >= 2 if samples.ndim == 2 else np.zeros(0, bool)
    if not twice.any():
        raise BadInput("the noise needs at least two readings (t, m) of a row while the arm stands still")
    values = samples[:, twice]
    off = np.abs(values - np.nanmedian(values, axis=0))
    pooled = TO_DEVIATION * np.nanmedian(off)
    own = TO_DEVIATION * np.nanmedian(off, axis=0)
    good = off <= OUTLIER * np.maximum(np.maximum(own, pooled), floor)
    count = np.count_nonzero(good, axis=0)
    kept = np.where(good, values, 0.0)
    off_mean = np.where(good, values - kept.sum(axis=0) / np.maximum(count, 1), 0.0)
    sigma = float(np.sqrt(np.sum(off_mean**2) / max(int(np.sum(count - 1)), 1)))
    whole = bool(np.all(samples[seen] == np.rint(samples[seen])))
    return max(sigma, ROUNDING_PX if whole else floor)


def explore_size(
    sigma: float,
    px_per_rad: Array | float | None = None,
    smallest: float = EXPLORE_RAD[0],
    largest: float = EXPLORE_RAD[1],
) -> Array:
    """The joint step delta [rad] that makes a finite difference least wrong (thesis eq. 2.17).

    A difference quotient over delta is wrong by the noise of two measurements and by half of what the
    Jacobian changes on the way, with s its rms entry `px_per_rad` [px/rad] and kappa = `CURVATURE`:

        variance(delta) = 2 sigma^2 / delta^2 + (kappa delta / 2)^2 s^2,

    which is least at delta^4 = 8 sigma^2 / (kappa s)^2. The result has the shape of `px_per_rad`: one
    number, or one for each joint or run. It is clipped to `smallest` ... `largest` [rad].
    """
    if not sigma > 0.0:
        raise BadInput(f"the noise must be above zero, got {sigma} px", "sigma")
    scale = np.asarray(TYPICAL_PX_PER_RAD if px_per_rad is None else px_per_rad, float)
    best = (8.0 * sigma**2 / (CURVATURE * np.maximum(np.abs(scale), 1e-9)) ** 2) ** 0.25
    return np.clip(best, smallest, largest)
