"""Passivity: the energy of mass, springs and walls never grows unless the goal or an obstacle moves.

Each step of the mass is passive by itself (`mass.py`) as long as distances are linear in the pose. They are
not quite, and the arm may not follow the mass exactly, so after every few steps the true energy is compared
with what it was, plus what the goal's motion has put in. What is too much is taken from the motion; if the
motion has not that much, the arm goes back to where it was and starts from rest, which is passive by
construction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from vita.impedance.mass import Aim, Mass, Pull, aim_energy, kinetic
from vita.impedance.repulsion import Wall

ROUNDING = 1e-12
"""Energy that rounding errors may make [J]."""


def total(mass: Mass, aim: Aim | None, pull: Pull, walls: Sequence[Wall]) -> float:
    """Kinetic and potential energy [J], with the walls as measured at the mass's pose."""
    stored = sum(wall.energy(wall.distance) for wall in walls)
    return kinetic(mass, pull) + aim_energy(mass, aim, pull) + stored


def take_out(mass: Mass, excess: float, pull: Pull) -> bool:
    """Slow the mass down by `excess` joules; false where it does not move that much."""
    if excess <= ROUNDING:
        return True
    has = kinetic(mass, pull)
    if has < excess:
        return False
    share = math.sqrt((has - excess) / has)
    mass.motion = [share * v for v in mass.motion]
    return True
