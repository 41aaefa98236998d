"""The objects of the scene: where they stand, who carries them, and how the script moves them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vita.errors import UnknownName
from vita.scenario.schema import ObjectSpec, Vector3
from vita.sim.camera import pose_matrix
from vita.types import Array


@dataclass(frozen=True)
class Motion:
    """A smooth way from one placement to another: at rest at both ends."""

    start: Array
    """(6,) position [m] and roll, pitch, yaw [deg]."""
    end: Array
    begin_s: float
    over_s: float

    def at(self, now: float) -> Array:
        """(6,) placement at `now` [s] along a minimum-jerk profile."""
        x = 1.0 if self.over_s <= 0 else float(np.clip((now - self.begin_s) / self.over_s, 0.0, 1.0))
        if x >= 1.0:
            return self.end
        return self.start + (self.end - self.start) * (x**3 * (10 - 15 * x + 6 * x * x))


class Props:
    """Every object's placement at a time. They are seen, not touched: the arm passes through."""

    def __init__(self, specs: tuple[ObjectSpec, ...]) -> None:
        self._specs = {spec.name: spec for spec in specs}
        self._motions: dict[str, Motion] = {}
        self.restore()

    def restore(self) -> None:
        """Everything back to where the scenario puts it."""
        for name, spec in self._specs.items():
            placement = np.array([*spec.xyz, *spec.rpy_deg], dtype=float)
            self._motions[name] = Motion(placement, placement, 0.0, 0.0)

    def move(
        self, name: str, xyz: Vector3 | None, rpy_deg: Vector3 | None, over_s: float, now: float
    ) -> None:
        """Move an object to a new placement (in the frame of its mount if it has one), over a time."""
        if name not in self._motions:
            raise UnknownName("object", name, self._motions)
        start = self._motions[name].at(now)
        end = np.array([*(xyz or start[:3]), *(rpy_deg or start[3:])], dtype=float)
        self._motions[name] = Motion(start, end, now, over_s)

    def poses(self, carriers: Mapping[str, Array], now: float) -> dict[str, Array]:
        """Object name to (4, 4) T_world_object; `carriers` are the robot's links."""
        found = {}
        for name, motion in self._motions.items():
            placement = motion.at(now)
            T = pose_matrix(placement[:3], placement[3:])
            mount = self._specs[name].mount
            if mount is not None:
                if mount not in carriers:
                    raise UnknownName("mount", mount, carriers, path=f"object {name!r}")
                T = carriers[mount] @ T
            found[name] = T
        return found
