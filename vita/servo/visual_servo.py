"""The public servo: any robot, any error vector, no calibration (thesis 4.2, listing 1)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from vita.errors import BadInput
from vita.servo.config import ServoConfig
from vita.servo.controller import Controller, Decision
from vita.servo.reasons import outcome_of
from vita.types import Array, ErrorVector, Joint, RowLabel, Status, frozen

PERIOD_S = 1.0 / 30.0
"""The control period that turns a speed limit into a step limit (thesis eq. 5.1)."""


class Robot(Protocol):
    """All that a user writes to servo a robot: the thesis' `delta_move` and the joint positions."""

    @property
    def joints(self) -> Sequence[Joint]: ...

    def position(self) -> ArrayLike:
        """(n,) joint positions [rad]."""
        ...

    def move_by(self, dq: Array) -> None:
        """Move by `dq` (n,) [rad], within the robot's accuracy, before the next measurement."""
        ...


@dataclass(frozen=True)
class Result:
    """How a run ended."""

    outcome: str
    """`converged`, `limited`, `held`, `fault` or `timeout`."""
    reason: str
    steps: int
    """Control periods used."""
    error: Array
    """(m,) error at the end [px]."""
    message: str = ""


@dataclass(frozen=True)
class ServoState:
    """The state after one control period."""

    status: Status
    q: Array
    """(n,) joints at the measurement [rad]."""
    error: Array
    """(m,) measured error [px]."""
    dq: Array
    """(n,) motion that was carried out after it [rad]."""
    jacobian: Array
    """(m, n) estimate [px/rad]."""

    @property
    def moving(self) -> bool:
        return self.status.state in ("learning", "servoing")


class VisualServo:
    """Uncalibrated visual servoing of `robot` on the error that `measure()` returns.

    `measure()` gives (m,) values, NaN in rows that cannot be seen. Neither camera nor kinematics
    is known to it. Joint limits of `robot.joints` are kept: a step is scaled as a whole, so that
    its direction stays.
    """

    def __init__(
        self,
        robot: Robot,
        measure: Callable[[], ArrayLike],
        config: ServoConfig | None = None,
        *,
        period_s: float = PERIOD_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._robot, self._measure = robot, measure
        self._period_s, self._clock = period_s, clock
        self.controller = Controller(robot.joints, config)
        if any(j >= len(robot.joints) for j in (self.config.joints or ())):
            raise BadInput(f"the robot has joints 0 to {len(robot.joints) - 1}", "servo.joints")

    @property
    def config(self) -> ServoConfig:
        return self.controller.config

    @config.setter
    def config(self, config: ServoConfig) -> None:
        """In force from the next control period on."""
        self.controller.config = config

    @property
    def jacobian(self) -> Array:
        """(m, n) estimate [px/rad]."""
        return self.controller.jacobian

    def learn(self, joints: Sequence[int] | None = None) -> Array:
        """Exploratory motions of `joints` (default: those of the configuration); the robot returns
        to where it was. Returns the (m, n) Jacobian [px/rad] (thesis eq. 2.17)."""
        if joints is not None:
            self.config = replace(self.config, joints=tuple(joints))
        self.controller.start(relearn=True, even_if_met=True)
        while self.controller.status.state == "learning":
            self._period(servo=False)
        return self.jacobian

    def step(self) -> ServoState:
        """One control period: measure, decide, move. Learns first where it must."""
        if not self.controller.moving:
            self.controller.start(relearn=False)
        return self._period()

    def converge(self, timeout_s: float | None = None, gain: float | None = None) -> Result:
        """Step until done, held or out of time."""
        changes = {"timeout_s": timeout_s, "gain": gain}
        self.config = replace(self.config, **{k: v for k, v in changes.items() if v is not None})
        self.controller.start(relearn=False)
        steps = 0
        while True:
            state = self._period()
            if not state.moving:
                break
            steps += 1
        status = state.status
        return Result(outcome_of(status), status.reason, steps, state.error, status.message)

    def _period(self, *, servo: bool = True) -> ServoState:
        q = np.asarray(self._robot.position(), float)
        error = labelled(self._measure())
        decision = self.controller.tick(self._clock(), q, error)
        if not servo and self.controller.status.state == "servoing":
            decision = None  # `learn` ends where servoing would begin.
        dq = np.zeros(len(q)) if decision is None else self._limited(q, decision)
        if decision is not None:
            self._robot.move_by(dq)
        return ServoState(self.controller.status, frozen(q), error.values, frozen(dq), self.jacobian)

    def _limited(self, q: Array, decision: Decision) -> Array:
        """The step scaled as a whole to the joints' speed and position limits."""
        dq, scale = decision.dq, 1.0
        for position, motion, joint in zip(q, dq, self._robot.joints, strict=True):
            room = (joint.upper - position) if motion > 0 else (position - joint.lower)
            allowed = min(decision.speed_scale * joint.max_speed * self._period_s, max(room, 0.0))
            if abs(motion) > allowed:
                scale = min(scale, allowed / abs(motion))
        return scale * dq


def labelled(values: ArrayLike) -> ErrorVector:
    """An error vector of anonymous rows, for errors that a user measures in her own way."""
    array = np.atleast_1d(np.asarray(values, float))
    if array.ndim != 1:
        raise BadInput(f"measure() must return a vector, got shape {array.shape}")
    rows = tuple(RowLabel(f"row {i}", "", "") for i in range(array.size))
    return ErrorVector(frozen(array), rows, frozen(np.ones(array.size)))
