"""The three arms of the second mode as bare kinematics, from their published Denavit-Hartenberg figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vita.impedance.arm_model import ArmModel
from vita.sim.dh import DHChain
from vita.types import Array, Joint

H = np.pi / 2
WAM_LIMITS = (
    (-2.6, 2.6), (-2.0, 2.0), (-2.8, 2.8), (-0.9, 3.1), (-4.76, 1.24), (-1.6, 1.6), (-3.0, 3.0),
)
TX_LIMITS = ((-3.14, 3.14), (-2.27, 2.57), (-2.53, 2.53), (-4.71, 4.71), (-2.01, 2.44), (-4.71, 4.71))
TX_SPEEDS = (4.36, 3.49, 5.24, 7.50, 6.11, 10.47)


def lifted(z: float) -> Array:
    T = np.eye(4)
    T[2, 3] = z
    return T


def turned_z(angle: float) -> Array:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return T


def from_chain(
    name: str, chain: DHChain, base: Array, tool: Array, limits: Sequence[tuple[float, float]],
    speeds: Sequence[float], landmarks: tuple[int, int, int],
) -> ArmModel:
    n = chain.n
    before = [base @ turned_z(chain.offset[0])]
    before += [chain.fixed(i - 1) @ turned_z(chain.offset[i]) for i in range(1, n)]
    joints = tuple(Joint(f"joint{i + 1}", *limits[i], speeds[i]) for i in range(n))
    axes = np.tile([0.0, 0.0, 1.0], (n, 1))
    return ArmModel(name, joints, np.array(before), axes, chain.fixed(n - 1) @ tool, landmarks)


def tx90(tool: float = 0.1) -> ArmModel:
    chain = DHChain(
        (0.05, 0.425, 0, 0, 0, 0), (0.478, 0.05, 0, 0.425, 0, 0.1), (-H, 0, H, -H, H, 0), (0, -H, H, 0, 0, 0)
    )
    return from_chain("tx90", chain, np.eye(4), lifted(tool), TX_LIMITS, TX_SPEEDS, (1, 2, 4))


def wam7() -> ArmModel:
    chain = DHChain(
        (0, 0, 0.045, -0.045, 0, 0, 0), (0, 0, 0.55, 0, 0.3, 0, 0.0609), (-H, H, -H, H, -H, H, 0), (0,) * 7
    )
    return from_chain("wam7", chain, lifted(0.346), np.eye(4), WAM_LIMITS, (2.0,) * 7, (1, 3, 5))


def wam4() -> ArmModel:
    chain = DHChain((0, 0, 0.045, -0.045), (0, 0, 0.55, 0), (-H, H, -H, H), (0,) * 4)
    return from_chain("wam4", chain, lifted(0.346), lifted(0.35), WAM_LIMITS[:4], (2.0,) * 4, (1, 3, 4))


ARMS = {"tx90": tx90(), "wam7": wam7(), "wam4": wam4()}
READY = {
    "tx90": np.array([0.0, 0.5, 1.6, 0.0, 1.0, 0.0]),
    "wam7": np.array([0.0, 0.72, 0.0, 2.1, 0.0, 0.1, 0.0]),
    "wam4": np.array([0.0, 0.75, 0.0, 2.0]),
}
"""Elbow bent, hand pointing down in front of the arm [rad]."""
