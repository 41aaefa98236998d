"""The objects of the scene: where they stand, who carries them, and how the script moves them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vita.errors import UnknownName
from vita.poses import pose_matrix, rpy_matrix
from vita.scenario.schema import ObjectSpec, Vector3
from vita.sim.motions import Carry, Motion
from vita.types import Array


class Props:
    """Every object's placement at a time. They are seen, not touched: the arm passes through."""

    def __init__(self, specs: tuple[ObjectSpec, ...]) -> None:
        self._specs = {spec.name: spec for spec in specs}
        self._motions: dict[str, Motion | Carry] = {}
        self.restore()

    def restore(self) -> None:
        """Everything back to where the scenario puts it."""
        for name, spec in self._specs.items():
            pose = pose_matrix(spec.xyz, spec.rpy_deg)
            self._motions[name] = Motion(pose, pose, 0.0, 0.0)

    def move(
        self, name: str, xyz: Vector3 | None, rpy_deg: Vector3 | None, over_s: float, now: float
    ) -> None:
        """Move an object to a new placement (in the frame of its mount if it has one), over a time."""
        start = self._placement(name, now)
        end = start.copy()
        if rpy_deg is not None:
            end[:3, :3] = rpy_matrix(rpy_deg)
        if xyz is not None:
            end[:3, 3] = xyz
        self._motions[name] = Motion(start, end, now, over_s)

    def carry(self, name: str, now: float, **way: Any) -> None:
        """Carry an object along a `way` (see `Carry`) that belongs to where it is now."""
        self._motions[name] = Carry(start=self._placement(name, now), begin_s=now, **way)

    def _placement(self, name: str, now: float) -> Array:
        """(4, 4) in the frame of its mount, if it has one."""
        if name not in self._motions:
            raise UnknownName("object", name, self._motions)
        return self._motions[name].at(now)

    def standing(self, now: float) -> dict[str, Array]:
        """Object name to (4, 4) T_world_object of those that nobody carries."""
        free = [name for name, spec in self._specs.items() if spec.mount is None]
        return {name: self._motions[name].at(now) for name in free}

    def poses(self, carriers: Mapping[str, Array], now: float) -> dict[str, Array]:
        """Object name to (4, 4) T_world_object; `carriers` are the robot's links."""
        found = {}
        for name, motion in self._motions.items():
            T = motion.at(now)
            mount = self._specs[name].mount
            if mount is not None:
                if mount not in carriers:
                    raise UnknownName("mount", mount, carriers, path=f"object {name!r}")
                T = carriers[mount] @ T
            found[name] = T
        return found
