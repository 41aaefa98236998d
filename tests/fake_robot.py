"""The whole of what a user writes to servo a robot of her own, here without any robot."""

from __future__ import annotations

import numpy as np

from vita.servo import Joint


class FakeRobot:
    """A kinematic arm that carries out every motion exactly."""

    def __init__(self, q0: list[float], limit: float = 3.0, max_speed: float = 3.0) -> None:
        self.joints = [Joint(f"j{i}", -limit, limit, max_speed) for i in range(len(q0))]
        self.q = np.array(q0, float)

    def position(self) -> np.ndarray:
        return self.q.copy()

    def move_by(self, dq: np.ndarray) -> None:
        self.q = self.q + dq


def planar_arm_pixels(q: np.ndarray) -> np.ndarray:
    """(4,) pixels of two points of a planar arm's hand, seen by a pinhole camera."""
    angles = np.cumsum(q)
    wrist = np.array([np.cos(angles[:2]).sum(), np.sin(angles[:2]).sum()])
    hand = wrist + 0.5 * np.array([np.cos(angles[-1]), np.sin(angles[-1])])
    depth = 4.0 + 0.2 * np.array([wrist[0], hand[0]])
    points = np.stack([wrist, hand])
    return (600.0 * points / depth[:, None]).ravel()


class FakeVelocityRobot:
    """A kinematic arm that is told speeds and reaches them with a first-order lag.

    Time passes in `wait`, one control period at a time, as with a camera that is waited for.
    """

    def __init__(
        self, q0: list[float], lag_s: float = 0.0, period_s: float = 1 / 30, limit: float = 3.0
    ) -> None:
        self.joints = [Joint(f"j{i}", -limit, limit, 3.0) for i in range(len(q0))]
        self.q, self.wanted, self.speed = np.array(q0, float), np.zeros(len(q0)), np.zeros(len(q0))
        self.lag_s, self.period_s, self.time = lag_s, period_s, 0.0

    def position(self) -> np.ndarray:
        return self.q.copy()

    def move_at(self, velocity: np.ndarray) -> None:
        self.wanted = velocity.copy()

    def wait(self) -> None:
        """One period of speed' = (wanted - speed) / lag, solved exactly."""
        left = np.exp(-self.period_s / self.lag_s) if self.lag_s else 0.0
        slower = self.speed - self.wanted
        self.q = self.q + self.wanted * self.period_s + slower * self.lag_s * (1 - left)
        self.speed = self.wanted + slower * left
        self.time += self.period_s
