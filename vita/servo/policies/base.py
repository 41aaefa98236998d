"""What a step policy is: from an error and an estimate of the Jacobian to a joint step.

As with the estimators, all arrays may have leading axes `...`, one entry for each of many runs.
A policy keeps what it needs between steps and hears of every measurement, so that it can compare
what it predicted with what happened. Speed and position limits are not its business: whoever
carries the step out scales it as a whole, so that its direction stays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from vita.errors import UnknownName
from vita.servo.estimators.base import Estimate
from vita.servo.small import all_of, some
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
    lower: Array | float = -np.inf
    """(n,) joint positions at and below which a joint may only move up [rad]."""
    upper: Array | float = np.inf
    """(n,) the same at the other end [rad]."""


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

    def step(self, now: Situation) -> Proposal:
        """The step from here. Called once a control period with every measurement while servoing.

        A joint at its limit that the step would push outward is left out, and the others are asked
        again: cutting it off would change the direction, and scaling to it would stop the arm.
        """
        self._hear(now)
        while True:
            proposal = self._choose(now)
            dq = proposal.dq
            outward = ((now.q >= now.upper) & (dq > 0)) | ((now.q <= now.lower) & (dq < 0))
            if not some(outward):
                return proposal
            now = replace(now, free=now.free & ~outward)

    def restart(self) -> None:  # noqa: B027 - a policy without memory has nothing to forget
        """Forget earlier measurements: a new run begins, or the rows have changed."""

    def _hear(self, now: Situation) -> None:  # noqa: B027 - nor has it anything to hear
        """Take the measurement, and how the last step turned out."""

    @abstractmethod
    def _choose(self, now: Situation) -> Proposal:
        """The step over the joints that are free; may be asked several times in one period."""


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
    return jacobian if all_of(free) else np.where(free[..., None, :], jacobian, 0.0)
