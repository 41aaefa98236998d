"""Arms of the experiments: kinematics only, thousands of them at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vita.errors import UnknownName
from vita.sim.dh import DHChain
from vita.sim.puma import PUMA
from vita.sim.wam import LIMITS as WAM_LIMITS
from vita.sim.wam import WAMS
from vita.types import Array, frozen


@dataclass(frozen=True, eq=False)
class Arm:
    """A serial arm without mass: it is where its joints say."""

    name: str
    chain: DHChain
    limits: Array
    """(n, 2) lowest and highest joint position [rad]."""
    tool: Array
    """(4, 4) tool frame in the last frame of the chain."""

    @property
    def n(self) -> int:
        return self.chain.n

    def pose(self, q: Array) -> Array:
        """(..., 4, 4) T_base_tool at joints `q` (..., n) [rad]."""
        frame = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
        for i in range(self.n):
            turn = np.zeros((*q.shape[:-1], 4, 4))
            angle = q[..., i] + self.chain.offset[i]
            turn[..., 0, 0] = turn[..., 1, 1] = np.cos(angle)
            turn[..., 1, 0] = np.sin(angle)
            turn[..., 0, 1] = -turn[..., 1, 0]
            turn[..., 2, 2] = turn[..., 3, 3] = 1.0
            frame = frame @ (turn @ self.chain.fixed(i))
        return frame @ self.tool

    def points(self, q: Array, local: Array) -> Array:
        """(..., k, 3) tool points `local` (k, 3) [m] in the base frame."""
        pose = self.pose(q)
        return local @ pose[..., :3, :3].swapaxes(-1, -2) + pose[..., None, :3, 3]


def _tool(reach: float) -> Array:
    tool = np.eye(4)
    tool[2, 3] = reach
    return frozen(tool)


PUMA560 = PUMA.chain
"""The thesis starts at joint 3 = 180 degrees, which lies outside the Puma's limits, and says nothing of
limits: its experiments run without."""

ARMS: Mapping[str, Arm] = {
    "puma560": Arm("puma560", PUMA560, frozen(PUMA.limits), _tool(0.1)),
    "wam4": Arm("wam4", WAMS["wam4"].chain, frozen(WAM_LIMITS[:4]), _tool(0.35)),
    "wam7": Arm("wam7", WAMS["wam7"].chain, frozen(WAM_LIMITS), _tool(0.1)),
}


def arm_of(name: str) -> Arm:
    """Raises `UnknownName` with the choices."""
    try:
        return ARMS[name]
    except KeyError:
        raise UnknownName("arm", name, ARMS) from None
