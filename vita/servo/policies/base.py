"""What a step policy is: from an error and an estimate of the Jacobian to a joint step.

As with the estimators, all arrays may have leading axes `...`, one entry for each of many runs.
A policy keeps what it needs between steps and hears of every measurement, so that it can compare
what it predicted with what happened. Speed and position limits are not its business: whoever
carries the step out scales it as a whole, so that its direction stays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from vita.errors import UnknownName
from vita.servo.estimators.base import Estimate
from vita.types import Array

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Situation:
    """One measurement and what is known when the next step is chosen.

    Only rows that are seen are in it, and they are multiplied by their weights, Jacobian and error
    alike.
    """

    q: Array
    """(..., n) joints [rad]."""
    e: Array
    """(..., m) error [px], finite."""
    estimate: Estimate
    free: Mask
    """(..., n) joints that may move; the step is exactly zero in the others."""
    gain: float | Array = 0.3
    """lambda: share of the error that a step tries to remove; for some policies only the first one."""
    damping: float = 0.02
    """Damping relative to the largest singular value, for the policies that use it."""


@dataclass(frozen=True)
class Proposal:
    """A step, and what is expected of it."""

    dq: Array
    """(..., n) joint motion [rad]."""
    rank: NDArray[np.int_]
    """(...,) how many directions of motion the step was chosen from."""
    near: Mask
    """(...,) whether the goal is so near that noise matters more than the Jacobian's errors."""


class StepPolicy(ABC):
    """Chooses joint steps."""

    kind: ClassVar[str]
    title: ClassVar[str]
    doc: ClassVar[str]
    """One sentence for the page and the docs: what it does and when to choose it."""

    @abstractmethod
    def step(self, now: Situation) -> Proposal:
        """The step from here. Called once a control period with every measurement while servoing."""

    def restart(self) -> None:  # noqa: B027 - a policy without memory has nothing to forget
        """Forget earlier measurements: a new run begins, or the rows have changed."""


POLICIES: dict[str, type[StepPolicy]] = {}
"""Kind to policy."""


def register(policy: type[StepPolicy]) -> type[StepPolicy]:
    """Add a kind. Raises `ValueError` on a name that is taken."""
    if policy.kind in POLICIES:
        raise ValueError(f"step policy {policy.kind!r} is registered twice")
    POLICIES[policy.kind] = policy
    return policy


def policy_of(kind: str, path: str = "") -> type[StepPolicy]:
    """The policy of a kind; raises `UnknownName` with the choices."""
    try:
        return POLICIES[kind]
    except KeyError:
        raise UnknownName("step policy", kind, POLICIES, path) from None


def masked(jacobian: Array, free: Mask) -> Array:
    """The (..., m, n) Jacobian with zeros in the columns of joints that may not move."""
    return np.where(free[..., None, :], jacobian, 0.0)
