"""What the virtual mass is asked for and what comes of it, in figures and in words."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from vita.impedance.inverse import held_by
from vita.impedance.mass import Aim, Mass, Pull
from vita.impedance.spring import length
from vita.impedance.turning import between
from vita.types import Array

FAR_M, FAR_RAD = 0.01, 0.05
"""A mass that is farther than this from its goal says what keeps it."""
HELD = {
    "singularity": "out of reach",
    "table": "held off by the table",
    "base": "held off by the base",
    "people": "held off by people or obstacles",
}


@dataclass(frozen=True, eq=False)
class Goal:
    """Where the tool is to be and how that moves, in the base frame."""

    T_base_tool: Array
    """(4, 4) wanted pose of the tool now."""
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) [m/s]."""
    turn_rate: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) [rad/s]."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Where the arm is to be after an advance."""

    q: Array
    """(n,) joints that put the tool where the mass is [rad]."""
    T_base_mass: Array
    """(4, 4)."""
    velocity: Array
    """(3,) of the mass [m/s]."""
    forces: dict[str, Array]
    """`target`, `table`, `base`, `singularity`, `people` to (3,) [N]; only those that act."""
    distances: dict[str, float]
    """`table`, `base`, `people` to metres, `singularity` to degrees: how far each is. That of people counts
    what an approaching one will have come nearer shortly."""
    energy_j: float
    """Kinetic and potential energy [J]."""
    limited: str
    """What keeps the mass from its way: "joint 4 at its limit", "out of reach", "held off by the table";
    empty where nothing does."""


def limited(
    mass: Mass, aim: Aim | None, pull: Pull, forces: dict[str, Array], locked: tuple[int, ...]
) -> str:
    """What keeps the mass from its goal, for people; empty where nothing does."""
    if aim is None or not _behind(mass, aim, pull):
        return ""
    return held_by(locked) or _held_off(forces)


def _behind(mass: Mass, aim: Aim, pull: Pull) -> bool:
    """Whether the mass is so far from its goal that people want to know why."""
    far = math.dist(aim.x, mass.x) > FAR_M
    return far or pull.turn and length(*between(aim.turn, mass.turn)) > FAR_RAD


def _held_off(forces: dict[str, Array]) -> str:
    """The strongest push, in words, where it is a good part of the pull."""
    pull = float(np.linalg.norm(forces["target"]))
    sizes = {name: float(np.linalg.norm(f)) for name, f in forces.items() if name != "target"}
    strongest = max(sizes, key=sizes.__getitem__, default="")
    return HELD[strongest] if strongest and sizes[strongest] > 0.3 * pull else ""
