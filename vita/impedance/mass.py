"""The virtual mass and one step of its motion (TUM eq. 13 with K = 0).

    m a = F_target + F_repulse - B v,    F_target = K_m (X_d - X) + B ff v_d, never above the largest pull.

The step is semi-implicit: damping acts on the new velocity, and the new velocity moves the mass. In
discrete time the energy of a mass m with springs of stiffness up to k then changes by at most

    -h B v^2 + h^2 k v^2 / 2 - m |v - v_old|^2 / 2,

so it falls wherever B >= h k / 2. Where walls are stiffer than that, damping is raised to h k: passive at any
gain. Feed-forward and a goal that moves do put in energy; `work` counts how much.

Plain floats throughout: a thousand steps a second over three or six numbers, where arrays only cost time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from vita.impedance.repulsion import Wall
from vita.impedance.spring import length, pull_energy, pull_share
from vita.impedance.turning import Quaternion, between, times, turned, unit

FASTEST_TURN = 2.0
"""The mass never turns faster than this [rad/s]."""


@dataclass(frozen=True)
class Pull:
    """The attraction's and the mass's numbers, for position and orientation."""

    mass: float
    stiffness: float
    damping: float
    most: float
    turn_stiffness: float
    turn_damping: float
    turn_most: float
    top_speed: float
    feed_forward: float
    turn: bool


@dataclass
class Mass:
    """Where the mass is and how it moves, in the base frame. It changes in place."""

    x: list[float]
    """(3) position of the tool frame [m]."""
    turn: Quaternion
    """Its orientation."""
    motion: list[float]
    """(6) velocity and turn rate; (3) where orientation is left free [m/s, rad/s]."""
    moved: list[float] = field(default_factory=list)
    """How far it has moved since the walls were measured, like `motion` [m, rad]."""
    work: float = 0.0
    """Energy that the goal's motion has put in since the walls were measured [J]."""


@dataclass
class Aim:
    """The goal, which moves on while the mass advances."""

    x: list[float]
    """(3) [m]."""
    turn: Quaternion
    velocity: list[float]
    """(3) [m/s]."""
    turn_rate: list[float]
    """(3) [rad/s]."""

    def move_on(self, h: float) -> None:
        """Follow its own motion for h seconds."""
        self.x = [x + h * v for x, v in zip(self.x, self.velocity, strict=True)]
        if any(self.turn_rate):
            a, b, c = self.turn_rate
            self.turn = unit(times(turned((h * a, h * b, h * c)), self.turn))


def aim_energy(mass: Mass, aim: Aim | None, pull: Pull) -> float:
    """Potential energy of the attraction [J]."""
    if aim is None:
        return 0.0
    off = [b - a for a, b in zip(mass.x, aim.x, strict=True)]
    energy = pull_energy(length(*off), pull.stiffness, pull.most)
    if pull.turn:
        angle = length(*between(aim.turn, mass.turn))
        energy += pull_energy(angle, pull.turn_stiffness, pull.turn_most)
    return energy


def attraction(mass: Mass, aim: Aim, pull: Pull) -> tuple[list[float], list[float]]:
    """(6) or (3) force and torque towards the goal, feed-forward included and never above the largest; and
    how much of it the springs alone give."""
    off = [b - a for a, b in zip(mass.x, aim.x, strict=True)]
    share = pull.feed_forward
    force, spring = _limited(off, aim.velocity, pull.stiffness, share * pull.damping, pull.most)
    if not pull.turn:
        return force, spring
    off = between(aim.turn, mass.turn)
    torque, twist = _limited(
        off, aim.turn_rate, pull.turn_stiffness, share * pull.turn_damping, pull.turn_most
    )
    return force + torque, spring + twist


def _limited(
    off: Sequence[float], rate: Sequence[float], stiffness: float, damping: float, most: float
) -> tuple[list[float], list[float]]:
    c = pull_share(length(*off), stiffness, most)
    spring = [c * e for e in off]
    force = [f + damping * v for f, v in zip(spring, rate, strict=True)]
    size = length(*force)
    return (force if size <= most else [f * most / size for f in force]), spring


def advance(mass: Mass, aim: Aim | None, pull: Pull, walls: Sequence[Wall], h: float) -> None:
    """Move the goal and then the mass on by h seconds."""
    old, size = mass.motion, len(mass.motion)
    push = extra = [0.0] * size
    if aim is not None:
        aim.move_on(h)
        push, spring = attraction(mass, aim, pull)
        extra = [f - s for f, s in zip(push, spring, strict=True)]
        # The potentials are convex, so this is no less than what the goal's motion stretched the springs by.
        goal_motion = aim.velocity + aim.turn_rate
        mass.work += h * sum(s * v for s, v in zip(spring, goal_motion, strict=False))
    stopped, stiff, hurry = [], 0.0, h * h * pull.most / pull.mass
    for wall in walls:
        slope = wall.slope
        d = wall.distance + sum(g * s for g, s in zip(slope, mass.moved, strict=True))
        f = wall.push(d)[0]
        if f > 0.0:
            push = [p + f * g for p, g in zip(push, slope, strict=True)]
        # Within the step the wall may get stiffer, or begin: as near as the mass may come counts.
        coming = h * sum(abs(g * v) for g, v in zip(slope, old, strict=True)) + hurry * length(*slope[:3])
        k = wall.stiffest(d - coming, d + coming)
        if k > 0.0:
            squares = [g * g for g in slope]
            stiff += k * (sum(squares[:3]) / pull.damping + sum(squares[3:]) / pull.turn_damping)
        if d < wall.stop:
            stopped.append(slope)
    more = max(1.0, h * stiff)
    m, b = pull.mass, h * more * pull.damping
    new = [(m * v + h * f) / (m + b) for v, f in zip(old[:3], push, strict=False)]
    if size == 6:
        b = h * more * pull.turn_damping
        new += [(w + h * t) / (1.0 + b) for w, t in zip(old[3:], push[3:], strict=True)]
    if stopped:
        new = outwards(new, stopped, m)
    speed = length(*new[:3])
    if speed > pull.top_speed:
        new[:3] = [v * pull.top_speed / speed for v in new[:3]]
    if size == 6:
        rate = length(*new[3:])
        if rate > FASTEST_TURN:
            new[3:] = [w * FASTEST_TURN / rate for w in new[3:]]
        mass.turn = unit(times(turned((h * new[3], h * new[4], h * new[5])), mass.turn))
    mass.work += h * sum(f * v for f, v in zip(extra, new, strict=True))
    mass.x = [x + h * v for x, v in zip(mass.x, new, strict=False)]
    mass.moved = [s + h * v for s, v in zip(mass.moved, new, strict=True)]
    mass.motion = new


def outwards(motion: list[float], slopes: Sequence[Sequence[float]], mass: float) -> list[float]:
    """`motion` without what brings any of the distances with these `slopes` down: the nearest motion, as the
    inertia weighs it, so that it can only lose kinetic energy. Where several leave no way out it is rest."""
    inertia = [mass] * 3 + [1.0] * (len(motion) - 3)
    for _ in range(20):
        rates = [sum(g * v for g, v in zip(slope, motion, strict=True)) for slope in slopes]
        worst = min(range(len(rates)), key=rates.__getitem__)
        if rates[worst] >= -1e-12:
            return motion
        back = [g / i for g, i in zip(slopes[worst], inertia, strict=True)]
        size = sum(g * b for g, b in zip(slopes[worst], back, strict=True))
        c = rates[worst] / max(size, 1e-12)
        motion = [v - c * b for v, b in zip(motion, back, strict=True)]
    return [0.0] * len(motion)


def kinetic(mass: Mass, pull: Pull) -> float:
    """Kinetic energy [J]."""
    squares = [v * v for v in mass.motion]
    return 0.5 * pull.mass * sum(squares[:3]) + 0.5 * sum(squares[3:])


def steer(motion: list[float], aside: Sequence[float], push: float, mass: float, h: float) -> None:
    """Turn the velocity, in place, towards the unit vector `aside` (3) as a sideways force of size `push` [N]
    would, but without changing its size: it lets the mass go around a thing and does no work."""
    speed = length(*motion[:3])
    if speed < 1e-6:
        return
    v = [part / speed for part in motion[:3]]
    along = sum(a * b for a, b in zip(v, aside, strict=True))
    across = [b - along * a for a, b in zip(v, aside, strict=True)]
    size = length(*across)
    if along > 0.999 or size < 1e-9:
        return
    angle = min(push * h / (mass * speed), math.acos(max(along, -1.0)))
    c, s = speed * math.cos(angle), speed * math.sin(angle) / size
    motion[:3] = [c * a + s * b for a, b in zip(v, across, strict=True)]
