"""The force that keeps things apart (TUM eq. 18 to 21): one law for table, base, singularity and people.

Within the onset a thing at distance d pushes with

    f(d) = K (exp(alpha (onset - d)) - 1),   U(d) = K/alpha (exp(alpha (onset - d)) - 1) - K (onset - d),

and not at all beyond it. At contact, or from `MOST` times the attraction on, f stays as it is, so that
several things at once, or a person who reaches into the arm, cannot throw it. Damping on velocity is counted
once, in the mass, and not in each of these forces as the report has it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vita.errors import BadInput
from vita.impedance.config import ImpedanceConfig
from vita.types import Array

MOST = 60.0
"""No single push is stronger than this many times the attraction."""
OUTWEIGH = 5.0
"""A repulsion must reach this many times the attraction at contact, or it could not hold."""


class Wall(NamedTuple):
    """One thing that pushes, at one pose of the arm; its distance is linear in the pose from there on. Plain
    numbers, for the inner loop goes over a handful of these a thousand times a second."""

    kind: str
    """Which force of TUM eq. 15 it is: `table`, `base`, `singularity`, `people`."""
    distance: float
    """[m]; of a singularity [rad]."""
    slope: tuple[float, ...]
    """(6,) or (3,) d distance / d tool pose."""
    gain: float
    """K [N]; of a singularity [N m]."""
    steepness: float
    """alpha, one over the distance's unit."""
    onset: float
    """Distance at which the push begins."""
    stop: float
    """Nearer than this only motion away is allowed."""
    top: float
    """alpha (onset - distance) from which on the push grows no more."""
    spare: Array
    """(n,) d distance / d joint, for joints that the tool's pose leaves free."""

    def push(self, distance: float) -> tuple[float, float]:
        """The push and its stiffness -df/dd at a distance."""
        raw = self.steepness * (self.onset - distance)
        if raw <= 0.0:
            return 0.0, 0.0
        if raw >= self.top:
            return self.gain * math.expm1(self.top), 0.0
        grown = self.gain * math.exp(raw)
        return grown - self.gain, self.steepness * grown

    def stiffest(self, nearest: float, distance: float) -> float:
        """The largest -df/dd between two distances, the nearer one first."""
        most = self.steepness * (self.onset - nearest)
        if most <= 0.0 or self.steepness * (self.onset - distance) >= self.top:
            return 0.0
        return self.steepness * self.gain * math.exp(min(most, self.top))

    def energy(self, distance: float) -> float:
        """Potential energy at a distance [J]."""
        raw = max(self.steepness * (self.onset - distance), 0.0)
        curved = min(raw, self.top)
        bent = math.expm1(curved) - curved
        straight = math.expm1(self.top) * (raw - curved)
        return self.gain * (bent + straight) / self.steepness


def cap(gain: float, steepness: float, onset: float, pull_n: float, lever: float = 1.0) -> float:
    """`Wall.top` of a repulsion: reached at contact, or at `MOST` times the attraction."""
    return min(steepness * onset, math.log1p(MOST * pull_n * lever / gain))


def contact_push(gain: float, steepness: float, onset: float) -> float:
    """The push at distance 0, were it not held back [N]."""
    return float(gain * np.expm1(min(steepness * onset, 500.0)))


def check_balance(config: ImpedanceConfig) -> None:
    """Refuse settings with which something that is to be kept away could be touched: every repulsion that is
    on must reach five times the largest attraction at contact. An onset of 0 turns one off."""
    angle = float(np.deg2rad(config.singular_deg))
    for name, gain, steepness, onset, knobs in (
        ("table_m", config.push_n, config.steepness, config.table_m, "push_n, steepness or table_m"),
        ("base_m", config.push_n, config.steepness, config.base_m, "push_n, steepness or base_m"),
        ("people_m", config.push_n, config.steepness, config.people_m, "push_n, steepness or people_m"),
        (
            "singular_deg", config.singular_n, config.singular_steepness, angle,
            "singular_n, singular_steepness or singular_deg",
        ),
    ):
        if onset == 0.0:
            continue
        reached, wanted = contact_push(gain, steepness, onset), OUTWEIGH * config.pull_n
        if reached < wanted:
            raise BadInput(
                f"at contact this repulsion reaches {reached:.3g} N, less than {OUTWEIGH:g} times the "
                f"largest pull of {config.pull_n:g} N; raise {knobs}, or lower pull_n",
                f"impedance.{name}",
            )
