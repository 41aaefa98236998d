"""An arm without mass before ideal cameras, stepped by hand: what the servo sees, and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vita.experiments.arms import arm_of
from vita.experiments.cameras import Cameras, look_at
from vita.servo import Controller, Joint, ServoConfig
from vita.types import Array, ErrorVector, RowLabel, Status, frozen

ARM = arm_of("wam7")
HOME = np.radians([0.0, 40.0, 0.0, 90.0, 0.0, 45.0, 0.0])
TARGET = np.array([0.62, 0.0, 0.42])
EYES = ((1.6, -0.8, 0.8), (1.6, 0.8, 0.8))
POINTS = ((0.0, 0.0, 0.02), (0.05, 0.0, -0.04), (0.0, 0.05, -0.04))
SPEED, ACCELERATION = 0.6, 8.0
PERIOD_S = 1.0 / 30.0


class Kinematic:
    """Points of the tool are driven to where they are at `goal_q`, in each of the cameras at `eyes`."""

    def __init__(
        self,
        *,
        joints: Sequence[int] = (0, 1, 2, 3),
        points: Sequence[Sequence[float]] = POINTS,
        eyes: Sequence[Sequence[float]] = EYES,
        goal_deg: Sequence[float] = (14.0, 10.0, 0.0, -14.0, 0.0, 0.0, 0.0),
        start: Array = HOME,
        sigma: float = 0.2,
        seed: int = 0,
        config: ServoConfig | None = None,
    ) -> None:
        self.random, self.sigma = np.random.default_rng(seed), sigma
        names = ("left", "right")[: len(eyes)]
        turned = np.stack([look_at(np.array(eye, float), TARGET) for eye in eyes])
        self._cameras, self._points = Cameras(turned, 700.0), np.array(points, float)
        self.q = np.array(start, float)
        self.goals = ARM.points(self.q + np.radians(goal_deg), self._points)
        self._labels = tuple(
            RowLabel(f"meet {i} {name}", name, part)
            for name in names
            for i in range(len(self._points))
            for part in ("u", "v")
        )
        self.joints = tuple(
            Joint(f"joint {i + 1}", float(lower), float(upper), SPEED)
            for i, (lower, upper) in enumerate(ARM.limits)
        )
        default = ServoConfig(joints=tuple(joints), tolerance_px=1.0)
        self.controller = Controller(self.joints, config or default)
        self.bend: Callable[[Array], Array] = lambda dq: dq
        """What becomes of a command on its way to the arm."""
        self.shift = np.zeros(len(self._labels))
        """Added to the error [px]."""
        self._moved, self._time = np.zeros(len(self.joints)), 0.0
        self.asked: Array | None = None
        """(n,) the last command [rad]; None at rest."""

    @property
    def status(self) -> Status:
        return self.controller.status

    def error(self) -> ErrorVector:
        tips = self._cameras.project(ARM.points(self.q, self._points))
        goals = self._cameras.project(self.goals)
        noise = self.random.normal(0.0, self.sigma, len(self._labels)) if self.sigma else 0.0
        values = (tips - goals).reshape(-1) + noise + self.shift
        return ErrorVector(frozen(values), self._labels, frozen(np.ones(len(self._labels))))

    def step(self, count: int = 1) -> Status:
        """So many control periods, or until the arm rests."""
        for _ in range(count):
            self._time += PERIOD_S
            decision = self.controller.tick(self._time, self.q.copy(), self.error())
            self.asked = None if decision is None else decision.dq
            if decision is None:
                break
            dq = self.bend(decision.dq)
            top = SPEED * PERIOD_S * decision.speed_scale
            dq = dq / max(1.0, float(np.abs(dq).max()) / top)
            most = ACCELERATION * PERIOD_S**2
            self._moved = self._moved + np.clip(dq - self._moved, -most, most)
            self.q = self.q + self._moved
        return self.status

    def start(self, servoing: int = 3) -> Status:
        """Start, learn, and servo for a few periods."""
        self.controller.start()
        for _ in range(400):
            if self.step().state != "learning":
                break
        return self.step(servoing)

    def until_rest(self, most: int = 600) -> int:
        """How many periods until the arm is told to rest."""
        for count in range(1, most + 1):
            self.step()
            if not self.controller.moving:
                return count
        raise AssertionError(f"still moving after {most} periods: {self.status}")
