"""What the servo knows of its own Jacobian, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vita.types import Array

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

    @property
    def agreement(self) -> float:
        """1 when the last motion did what was predicted, 0 when it did something else altogether."""
        seen: NDArray[np.bool_] = np.isfinite(self.observed)
        size = float(np.linalg.norm(self.observed[seen]))
        if size == 0.0:
            return float("nan")
        return max(0.0, 1.0 - float(np.linalg.norm((self.observed - self.predicted)[seen])) / size)
