"""What one of the arms that ship is: its published figures and the drawings of its links."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from vita.errors import BadInput
from vita.sim.dh import DHChain
from vita.sim.shapes import Solid

Part = tuple[str, Solid]
"""A colour's name and what has that colour."""
Drawing = Callable[[], list[Part]]


@dataclass(frozen=True)
class Cylinder:
    """A collision cylinder in a link's frame; its mass is spread over it evenly."""

    radius: float
    length: float
    xyz: tuple[float, float, float]
    axis: str = "z"


@dataclass(frozen=True)
class ArmSpec:
    """An arm in figures. Link i turns with joint i and has its origin on that joint's axis, where frame
    i - 1 of the Denavit-Hartenberg chain is; the base's frame is frame 0."""

    name: str
    folder: str
    """Below `assets/robots`; arms may share one, and then their meshes."""
    chain: DHChain
    base_height: float
    """Frame 0 above the mounting plane [m]."""
    tool_reach: float
    """Tool frame beyond the last frame of the chain, along its z [m]."""
    limits: tuple[tuple[float, float], ...]
    """Lowest and highest position of each joint [rad]."""
    speeds: tuple[float, ...]
    """Highest speed of each joint [rad/s]."""
    torques: tuple[float, ...]
    """Highest torque of each joint [Nm]."""
    masses: tuple[float, ...]
    """Mass of the base and of each link [kg]."""
    hulls: tuple[Cylinder, ...]
    """Collision shape of the base and of each link."""
    meshes: tuple[str, ...]
    """Which of `drawings` the base and each link look like."""
    ready: tuple[float, ...]
    """A start pose: elbow bent, hand pointing down in front of the arm [rad]."""
    landmarks: tuple[int, int, int]
    """Shoulder, elbow and wrist; see `ArmModel.landmarks`."""
    colors: Mapping[str, tuple[float, float, float]] = field(repr=False)
    drawings: Mapping[str, Drawing] = field(repr=False)

    def __post_init__(self) -> None:
        n = self.chain.n
        for name, count in (
            ("limits", n), ("speeds", n), ("torques", n), ("ready", n),
            ("masses", n + 1), ("hulls", n + 1), ("meshes", n + 1),
        ):  # fmt: skip
            given = len(getattr(self, name))
            if given != count:
                raise BadInput(f"needs {count} entries, has {given}", f"{self.name}.{name}")
