"""Keeps an arm off what is near: the rule by which distances bound the speed with which they shrink.

Whoever measures distances (`vita.sim.proximity` does in the simulation; on a real arm it may be a model of
the cell) hands over each one with its gradient: d distance / d joints. To a velocity v of the joints that
is a half-space, -gradient . v <= allowed(distance), the same rule as for the joint limits but for any
direction of the joint space. Nothing here knows arms, tables or people.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vita.types import Array

NEAR_M, CLOSEST_M, TOUCH_M = 0.05, 0.01, 0.005
"""Slow at the first distance, at rest at the second; nearer than the third counts as contact [m]."""
SLOPE = 10.0
"""How fast the allowed closing speed grows with the distance beyond `CLOSEST_M`: 0.4 m/s at 5 cm [1/s]."""
OLD_S = 0.1
"""Distances older than this count as zero [s]."""
NEARER_M = 0.001
"""A contact that was acknowledged counts again once it is by so much nearer [m]."""


class Pair(NamedTuple):
    """Two bodies, as people call them: the first is part of the arm."""

    first: str
    second: str

    @property
    def touches(self) -> str:
        return f"{self.first[:1].upper()}{self.first[1:]} touches {self.second}"


@dataclass(frozen=True, eq=False)
class Nearness:
    """How near the arm is to what it must not touch, at one instant."""

    stamp: float
    """When [s]."""
    q: Array
    """(n,) joint positions at that instant [rad]."""
    distances: Array
    """(c,) between surfaces; negative where they overlap [m]."""
    gradients: Array
    """(c, n) d distance / d joints [m/rad]."""
    pairs: tuple[Pair, ...]
    """(c,) what is near to what."""


def allowed_share(fastest: float, acceleration: float, dt: float) -> float:
    """Allowed closing speed over the distance that is left, while the fastest joint moves at `fastest`
    [rad/s]; [1/s].

    Braking with the direction kept takes all joints to rest together and the fastest one as hard as it may.
    With v_t = a (1/k - dt/2) a closing speed of k times the distance can be kept to by that while v <= v_t.
    A faster arm needs more room: (v^2 + a dt v + v_t^2) / (2 a v) seconds of its closing speed, the path of
    a hard braking down to v_t and of the slow rest after it. From a velocity that keeps this bound, the
    braking keeps it for ever, cycle by cycle.
    """
    turn = acceleration * (1.0 / SLOPE - 0.5 * dt)
    v = max(fastest, turn)
    return 2.0 * acceleration * v / (v * v + acceleration * dt * v + turn * turn)


class KeepOff:
    """Holds a velocity back where distances would shrink too fast."""

    def __init__(self, joints: int) -> None:
        self._n = joints
        self._near: Nearness | None = None
        self._accepted: dict[Pair, float] = {}
        self.holding: Pair | None = None
        """Which pair held the arm back in the last cycle."""

    def take(self, near: Nearness) -> bool:
        """Put new distances in force; False, and the old ones go on ageing, when they are malformed."""
        try:
            q, d, g = (np.array(x, dtype=float) for x in (near.q, near.distances, near.gradients))
            shapes = q.shape == (self._n,) and d.ndim == 1 and g.shape == (d.size, self._n)
            good = shapes and len(near.pairs) == d.size and np.isfinite(float(near.stamp))
            if not (good and all(np.isfinite(x).all() for x in (q, d, g))):
                return False
        except (TypeError, ValueError, OverflowError):
            return False
        self._near = Nearness(float(near.stamp), q, d, g, tuple(near.pairs))
        for pair in [p for p in self._accepted if self._closest(p) > CLOSEST_M]:
            del self._accepted[pair]
        return True

    def _closest(self, pair: Pair) -> float:
        assert self._near is not None
        found = [d for p, d in zip(self._near.pairs, self._near.distances, strict=True) if p == pair]
        return min(found, default=np.inf)

    def contact(self) -> Pair | None:
        """The closest pair that touches and was not acknowledged at that distance."""
        if self._near is None:
            return None
        for i in np.argsort(self._near.distances):
            pair, distance = self._near.pairs[i], float(self._near.distances[i])
            if distance >= TOUCH_M:
                return None
            if distance < self._accepted.get(pair, np.inf) - NEARER_M:
                return pair
        return None

    def accept(self) -> None:
        """What touches now is known to people; only its coming nearer is news."""
        if self._near is not None:
            touching = np.flatnonzero(self._near.distances < TOUCH_M)
            self._accepted = {self._near.pairs[i]: self._closest(self._near.pairs[i]) for i in touching}

    def forget(self) -> None:
        """The arm was put elsewhere: distances from before tell nothing."""
        self._near = self.holding = None
        self._accepted.clear()

    def fresh(self, now: float) -> bool:
        """Whether there are distances, and they are not too old."""
        return self._near is not None and now - self._near.stamp <= OLD_S + 1e-9

    def distances(self, q: Array, now: float) -> Array:
        """(c,) the distances with the arm at q (n,), extrapolated from when they were taken [m]."""
        near = self._near
        if near is None:
            return np.zeros(0)
        if not self.fresh(now):
            return np.zeros(near.distances.size)
        return near.distances + near.gradients @ (q - near.q)

    def share(self, wanted: Array, brake: Array, q: Array, now: float, a: float, dt: float) -> float:
        """How much of the way from the velocity `brake` to the velocity `wanted` (n,) the distances allow, 0
        to 1, with the arm at q (n,) and the acceleration `a`."""
        self.holding = None
        near = self._near
        if near is None:
            return 0.0
        left = np.maximum(self.distances(q, now) - CLOSEST_M, 0.0)
        fastest = max(float(np.abs(wanted).max()), float(np.abs(brake).max()))
        allowed = allowed_share(fastest, a, dt) * left
        share, row = least_share(-(near.gradients @ wanted), -(near.gradients @ brake), allowed)
        if row >= 0:
            self.holding = near.pairs[row]
        return share


def least_share(wanted: Array, brake: Array, allowed: Array) -> tuple[float, int]:
    """How much of the way from `brake` to `wanted`, 0 to 1, leaves every row of what lies between them within
    `allowed`; and which row says so, -1 for none. All are (c,) closing speeds."""
    over = wanted - allowed
    if not over.size or over.max() <= 0.0:
        return 1.0, -1
    rows = np.flatnonzero(over > 0.0)
    least = brake[rows]
    shares = np.maximum(allowed[rows] - least, 0.0) / np.maximum(wanted[rows] - least, 1e-300)
    row = int(shares.argmin())
    return min(float(shares[row]), 1.0), int(rows[row])
