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
