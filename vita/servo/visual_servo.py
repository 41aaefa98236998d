"""The public servo: any robot, any error vector, no calibration (thesis 4.2, listing 1)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from vita.errors import BadInput
from vita.servo.coasting import Coasting
from vita.servo.config import ServoConfig
from vita.servo.controller import Controller, Decision
from vita.servo.reasons import outcome_of
from vita.servo.units import Units
from vita.types import Array, ErrorVector, Joint, RowLabel, Status, frozen

PERIOD_S = 1.0 / 30.0
"""The control period that turns a speed limit into a step limit (thesis eq. 5.1)."""
GO_ON = ("converged", "dead_band", "stalled")
"""Ends of a run after which `follow` goes on: a goal that has stopped may move again."""


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


class VelocityRobot(Protocol):
    """The same for a robot that takes joint speeds instead of motions (thesis eq. 5.1)."""

    @property
    def joints(self) -> Sequence[Joint]: ...

    def position(self) -> ArrayLike:
        """(n,) joint positions [rad]."""
        ...

    def move_at(self, velocity: Array) -> None:
        """Move at `velocity` (n,) [rad/s] from now on; returns at once. Zero is rest."""
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
    """(n,) motion that was asked for after it [rad]."""
    jacobian: Array
    """(m, n) estimate [px/rad]."""
    stamp: float = 0.0
    """Time of the measurement by the servo's clock [s]."""

    @property
    def moving(self) -> bool:
        return self.status.state in ("learning", "servoing")


class VisualServo:
    """Uncalibrated visual servoing of `robot` on the error that `measure()` returns.

    `measure()` gives (m,) values, NaN in rows that cannot be seen. Neither camera nor kinematics
    is known to it. Joint limits of `robot.joints` are kept: a step is scaled as a whole, so that
    its direction stays.

    - `labels` (m,) names the rows for people: texts, or `RowLabel`s with camera and priority;
      `weights` (m,) says how much each counts.
    - `tolerance` is for errors that are no pixels: what counts as done, one number or one for each row,
      in the error's own unit. All other sizes follow from it.
    - `joint_scale` is for joints that are no radians: how far, in the joint's own unit, a motion goes
      that counts like a radian, such as 57.3 for degrees or 1000 for millimetres.
    - `control` chooses `move_by` ("position") or `move_at` ("velocity") for a robot that offers both.
    - `observe` is called with the state after every control period, to record or to plot.
    """

    def __init__(
        self,
        robot: Robot | VelocityRobot,
        measure: Callable[[], ArrayLike],
        config: ServoConfig | None = None,
        *,
        labels: Sequence[str | RowLabel] | None = None,
        weights: ArrayLike | None = None,
        tolerance: ArrayLike | None = None,
        joint_scale: ArrayLike = 1.0,
        control: Literal["position", "velocity"] | None = None,
        observe: Callable[[ServoState], None] | None = None,
        period_s: float = PERIOD_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._robot, self._measure, self._observe = robot, measure, observe
        self._period_s, self._clock = period_s, clock
        self._control = _control(robot, control)
        self._labels, self._weights = labels, weights
        self._stop, self._coasting = False, Coasting()
        config = config or ServoConfig()
        self._units = Units.of(tolerance, config.tolerance_px, joint_scale, robot.joints)
        self.controller = Controller(self._units.joints(robot.joints), config)
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
        """(m, n) estimate [px/rad], or in the units of error and joints."""
        return frozen(self._units.jacobian(self.controller.jacobian))

    def learn(self, joints: Sequence[int] | None = None) -> Array:
        """Exploratory motions of `joints` (default: those of the configuration); the robot returns
        to where it was. Returns the (m, n) Jacobian [px/rad] (thesis eq. 2.17)."""
        if joints is not None:
            self.config = replace(self.config, joints=tuple(joints))
        self._stop = False
        self.controller.start(relearn=True, even_if_met=True)
        while self.controller.status.state == "learning":
            self._period(servo=False)
        return self.jacobian

    def step(self) -> ServoState:
        """One control period: measure, decide, move. Learns first where it must."""
        if not self.controller.moving:
            self._stop = False
            self.controller.start(relearn=False)
        return self._period()

    def converge(self, timeout_s: float | None = None, gain: float | None = None) -> Result:
        """Step until done, held or out of time."""
        changes = {"timeout_s": timeout_s, "gain": gain}
        self.config = replace(self.config, **{k: v for k, v in changes.items() if v is not None})
        self._stop = False
        self.controller.start(relearn=False)
        steps = 0
        while (state := self._period()).moving:
            steps += 1
        return self._result(state, steps)

    def follow(self, duration_s: float) -> Result:
        """Servo for `duration_s` whether the goal is met or not, as for a goal that moves. Ends early
        only when held or at fault. With `moving_goal=1` in the configuration the goal's own motion is
        learned and followed without lag."""
        self._stop = False
        self.controller.start(relearn=False, even_if_met=True)
        begin, steps = self._clock(), 0
        while True:
            state = self._period()
            if not state.moving and state.status.reason not in GO_ON:
                return self._result(state, steps)
            if state.stamp - begin >= duration_s:
                self.controller.halt("timeout", timeout=duration_s, error=np.abs(state.error).max())
                self._rest()
                return self._result(replace(state, status=self.controller.status), steps)
            steps += 1
            if not state.moving:
                self.controller.start(relearn=False, even_if_met=True)

    def stop(self) -> None:
        """Rest the robot in the next control period; may be called from any thread."""
        self._stop = True

    # ---- one control period ----------------------------------------------------------------------

    def _period(self, *, servo: bool = True) -> ServoState:
        try:
            state = self._move(servo)
        except BaseException:
            self._rest()  # A robot under velocity control would go on for ever.
            raise
        if self._observe is not None:
            self._observe(state)
        return state

    def _move(self, servo: bool) -> ServoState:
        error = self._labelled(self._measure())
        q = np.asarray(self._robot.position(), float)  # After `measure`, which may wait for an image.
        stamp = self._clock()
        if self._stop:
            self.controller.halt("stopped_by_user")
        decision = self.controller.tick(stamp, q * self._units.rad, error)
        if not servo and self.controller.status.state == "servoing":
            decision = None  # `learn` ends where servoing would begin.
        dq = np.zeros(len(q)) if decision is None else self._limited(q, decision)
        if decision is None:
            self._rest()
        elif self._control == "position":
            cast(Robot, self._robot).move_by(dq)
        else:
            self._move_at(q, dq)
        status = self.controller.status
        status = replace(status, message=self._units.words(status.message))
        return ServoState(
            status, frozen(q), frozen(error.values / self._units.px), frozen(dq), self.jacobian, stamp
        )

    def _move_at(self, q: Array, dq: Array) -> None:
        """Command the speed that carries the arm to q + dq, with what it will coast by itself."""
        motion = dq - self._coasting.remaining(q)
        fastest = np.array([joint.max_speed for joint in self._robot.joints]) * self._period_s
        motion = motion / max(1.0, float(np.max(np.abs(motion) / fastest)))
        self._coasting.command(motion)
        cast(VelocityRobot, self._robot).move_at(motion / self._period_s)

    def _rest(self) -> None:
        if self._control == "velocity":
            cast(VelocityRobot, self._robot).move_at(np.zeros(len(self._robot.joints)))
            self._coasting.restart()

    def _limited(self, q: Array, decision: Decision) -> Array:
        """The step scaled as a whole to the joints' speed and position limits."""
        dq, scale = decision.dq / self._units.rad, 1.0
        for position, motion, joint in zip(q, dq, self._robot.joints, strict=True):
            room = (joint.upper - position) if motion > 0 else (position - joint.lower)
            allowed = min(decision.speed_scale * joint.max_speed * self._period_s, max(room, 0.0))
            if abs(motion) > allowed:
                scale = min(scale, allowed / abs(motion))
        return scale * dq

    def _labelled(self, values: ArrayLike) -> ErrorVector:
        error = labelled(values, self._labels, self._weights)
        m, px = error.values.size, self._units.px
        if px.ndim and px.size != m:
            raise BadInput(f"there are {px.size} values for {m} error rows", "tolerance")
        return replace(error, values=frozen(error.values * px)) if self._units.own else error

    def _result(self, state: ServoState, steps: int) -> Result:
        status = state.status
        message = self._units.words(status.message)
        return Result(outcome_of(status), status.reason, steps, state.error, message)


def labelled(
    values: ArrayLike, labels: Sequence[str | RowLabel] | None = None, weights: ArrayLike | None = None
) -> ErrorVector:
    """An error vector for errors that a user measures in her own way; rows without labels are numbered."""
    array = np.atleast_1d(np.asarray(values, float))
    if array.ndim != 1:
        raise BadInput(f"measure() must return a vector, got shape {array.shape}")
    names = [f"row {i}" for i in range(array.size)] if labels is None else labels
    weight = np.ones(array.size) if weights is None else np.asarray(weights, float)
    for what, given in (("labels", len(names)), ("weights", weight.size)):
        if given != array.size:
            raise BadInput(f"there are {given} for {array.size} error rows", what)
    rows = tuple(RowLabel(x, "", "") if isinstance(x, str) else x for x in names)
    return ErrorVector(frozen(array), rows, frozen(weight))


def _control(robot: object, wanted: str | None) -> Literal["position", "velocity"]:
    """How `robot` is moved; raises `BadInput` when it cannot be."""
    offers = [c for c, call in (("position", "move_by"), ("velocity", "move_at")) if hasattr(robot, call)]
    kind = type(robot).__name__
    if not offers:
        raise BadInput(f"{kind} offers neither move_by(dq) nor move_at(velocity); write one of them", "robot")
    if wanted is not None and wanted not in offers:
        raise BadInput(f"{kind} offers no {wanted!r} control, only {', '.join(offers)}", "control")
    return cast(Literal["position", "velocity"], wanted or offers[0])
