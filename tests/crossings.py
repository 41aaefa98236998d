"""Spheres that cross an arm's way while it follows a target: `python -m tests.crossings 100 tx90` for all."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

from tests.impedance_arms import ARMS, READY
from vita.impedance.arm_model import ArmModel
from vita.impedance.config import ImpedanceConfig
from vita.impedance.dynamics import Goal, Surroundings, VirtualImpedance
from vita.impedance.view import Capsule
from vita.types import Array

PERIOD = 1 / 30
THICK = 0.05
HALF_WAY = 0.7
"""How far before and behind the arm the sphere's way begins and ends [m]."""


@dataclass(frozen=True, eq=False)
class Crossing:
    """A sphere on a straight way through the arm's outer part."""

    radius: float
    speed: float
    middle: Array
    direction: Array

    def centre(self, t: float) -> Array:
        return self.middle + (self.speed * t - HALF_WAY) * self.direction

    @property
    def duration(self) -> float:
        return 2 * HALF_WAY / self.speed


@dataclass(frozen=True)
class Encounter:
    """How one crossing went."""

    nearest_m: float
    """Smallest distance between the surfaces of arm and sphere."""
    resumed_mm: float
    """Largest distance from the target in the last second, after the sphere has gone."""


def random_crossing(rng: np.random.Generator, arm: ArmModel, q: Array) -> Crossing:
    """Aimed between forearm and tool; never through shoulder, base or the inner upper arm, which no motion of
    the arm could clear, nor through the table."""
    assert arm.landmarks is not None
    frames = arm.frames(q)
    shoulder, elbow, tool = frames[1, :3, 3], frames[arm.landmarks[1], :3, 3], frames[-1, :3, 3]
    share = np.linspace(0, 1, 20)[:, None]
    fixed = np.vstack([share[:15] * (elbow - shoulder) + shoulder, share * [0, 0, shoulder[2]]])
    radius, speed = rng.uniform(0.06, 0.12), rng.uniform(0.1, 0.25)
    while True:
        middle = elbow + rng.uniform(0.35, 1.05) * (tool - elbow) + rng.normal(0, 0.04, 3)
        direction = rng.normal(size=3) * [1, 1, 0.5]
        direction /= np.linalg.norm(direction)
        way = middle + np.linspace(-HALF_WAY, HALF_WAY, 150)[:, None] * direction
        gap = np.linalg.norm(way[:, None] - fixed[None], axis=2).min()
        if gap > radius + 0.22 and way[:, 2].min() > radius / 2:
            return Crossing(radius, speed, middle, direction)


def gap_to(arm: ArmModel, q: Array, centre: Array) -> float:
    """Distance of a point from the surface of the links from the elbow on, by sampling them densely [m]."""
    assert arm.landmarks is not None
    corners = arm.frames(q)[arm.landmarks[1] :, :3, 3]
    share = np.linspace(0, 1, 150)[:, None]
    links = np.vstack([a + share * (b - a) for a, b in zip(corners[:-1], corners[1:], strict=True)])
    return float(np.linalg.norm(links - centre, axis=1).min()) - THICK


def encounter(name: str, seed: int) -> Encounter:
    """One run: the target goes in a circle at 8 cm/s, a sphere crosses and leaves, the target goes on."""
    arm, q = ARMS[name], READY[name]
    crossing = random_crossing(np.random.default_rng(seed), arm, q)
    start, radius = arm.pose(q), 0.06
    rate = 0.08 / radius

    def goal(t: float) -> Goal:
        T = start.copy()
        T[:3, 3] += radius * np.array([np.cos(rate * t) - 1, np.sin(rate * t), 0])
        return Goal(T, rate * radius * np.array([-np.sin(rate * t), np.cos(rate * t), 0]))

    plan = VirtualImpedance(arm, ImpedanceConfig())
    plan.reset(q)
    nearest, errors, ticks = np.inf, [], int(crossing.duration / PERIOD)
    for k in range(ticks + 90):
        t, centre = k * PERIOD, crossing.centre(k * PERIOD)
        there = (Capsule("sphere", centre, centre, crossing.radius),) if k < ticks else ()
        motion = plan.advance(PERIOD, goal(t), Surroundings(there))
        if k < ticks:
            # Judged where the sphere is by then, which the arm was not told.
            gap = gap_to(arm, motion.q, crossing.centre(t + PERIOD)) - crossing.radius
            nearest = min(nearest, gap)
        target = goal(t + PERIOD).T_base_tool[:3, 3]
        errors.append(float(np.linalg.norm(arm.pose(motion.q)[:3, 3] - target)))
    return Encounter(nearest, 1e3 * max(errors[-30:]))


if __name__ == "__main__":
    count, arm_name = int(sys.argv[1]), sys.argv[2]
    runs = []
    for number in range(count):
        run = encounter(arm_name, number)
        runs.append(run)
        print(f"{number}: nearest {1e3 * run.nearest_m:.0f} mm, resumed {run.resumed_mm:.1f} mm", flush=True)
    near, resumed = min(run.nearest_m for run in runs), max(run.resumed_mm for run in runs)
    print(f"{arm_name}: {count} runs, nearest {1e3 * near:.0f} mm, resumed within {resumed:.1f} mm")
