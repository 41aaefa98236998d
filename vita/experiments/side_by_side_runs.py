"""One reach by one method, judged by the simulation's truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vita.experiments.side_by_side_methods import METHODS, ReachWorld
from vita.experiments.side_by_side_tasks import TROUBLES, Task, Trouble, clearance, draw
from vita.types import Array

LONGEST_S, CARRIED_S = 25.0, 5.5
"""A run ends here at the latest, and one with a carried goal so long after the arm has learned."""
REST_TICKS, LAST_S = 15, 2.0
"""A run goes on for so long once the method has stopped by itself. A carried goal is judged over its last
seconds."""
NEAR_MM, NEAR_DEG = 5.0, 2.0
"""What counts as arrived."""


@dataclass(frozen=True, eq=False)
class Reach:
    """How one run went."""

    method: str
    trouble: str
    robot: str
    seed: int
    mm: float
    """Distance of the tool from its goal at the end; of a carried goal, root mean square at the end."""
    deg: float
    time_s: float
    """Time from Start until the tool is within 5 mm for good; infinite where it is not."""
    learned_s: float
    """Time from Start until the arm heads for the goal."""
    way: float
    """Length of the tool's way from then on, relative to the straight one."""
    clearance_mm: float
    """Smallest distance between the sphere and the arm; infinite without one."""
    beyond_rad: float
    """How far a joint was beyond its limits at most; negative inside."""
    speed: float
    """Fastest motion of a joint, relative to its limit."""
    reason: str
    """Why the method ended by itself, in the codes of the status; empty where it did not."""
    stamp: Array = field(repr=False)
    """(t,) [s]."""
    gap_mm: Array = field(repr=False)
    """(t,) distance of the tool from its goal."""
    tool: Array = field(repr=False)
    """(t, 3) the tool's way [m]."""

    @property
    def arrived(self) -> bool:
        """Whether it is there, and has touched nothing on its way."""
        return self.mm < NEAR_MM and self.deg < NEAR_DEG and self.clearance_mm > 0.0


def reaches(robot: str, seed: int, trouble: str, methods: Sequence[str]) -> list[Reach]:
    """The task of this robot and number with one trouble, by each of these methods."""
    chosen = TROUBLES[trouble]
    task = draw(robot, seed, chosen.sphere)
    return [run(method, task, chosen) for method in methods]


def run(method: str, task: Task, trouble: Trouble) -> Reach:
    """Press Start and watch."""
    world = METHODS[method](task, trouble)
    world.start()
    rows, begun, rest, most = [], np.nan, 0, LONGEST_S
    while world.now < most and rest < REST_TICKS:
        gap, angle = world.gap()
        q, away = world.q.copy(), float(np.linalg.norm(gap))
        if np.isnan(begun) and world.on_its_way:
            begun = world.now
            if trouble.carried:
                world.target.begin_s, most = begun, begun + CARRIED_S
        _shove(world, trouble, begun, away)
        world.tick()
        free = clearance(world.arm, world.q, world.truth.obstacles(world.now))
        rows.append((world.now, *world.arm.pose(world.q)[:3, 3], away, angle, free, *_bounds(world, q)))
        rest = 0 if world.moving or trouble.carried else rest + 1
    return _judged(method, task, trouble, world, np.array(rows), begun)


def _shove(world: ReachWorld, trouble: Trouble, begun: float, away: float) -> None:
    """Begin to move the cameras when the tool is half way to its goal."""
    half = begun >= 0.0 and away < 0.5 * world.task.straight_m
    if trouble.moved and half and not np.isfinite(world.tripod.moved_s):
        world.tripod.moved_s = world.now


def _bounds(world: ReachWorld, before: Array) -> tuple[float, float]:
    """How far a joint is beyond its limits [rad], and the fastest since `before`, relative to its limit."""
    joints, dt = world.arm.joints, 1 / 30
    beyond = max(max(q - j.upper, j.lower - q) for q, j in zip(world.q, joints, strict=True))
    speed = max(abs(a - b) / dt / j.max_speed for a, b, j in zip(world.q, before, joints, strict=True))
    return float(beyond), float(speed)


def _judged(method: str, task: Task, trouble: Trouble, world: ReachWorld, rows: Array, begun: float) -> Reach:
    stamp, tool = rows[:, 0], rows[:, 1:4]
    gap, angle = world.gap()
    # A row's gap is that before its tick; the last one is added, so that the end is the end.
    gaps = 1e3 * np.append(rows[1:, 4], float(np.linalg.norm(gap)))
    angles = np.degrees(np.append(rows[1:, 5], angle))
    last = stamp > stamp[-1] - (LAST_S if trouble.carried else 0.01)
    far = np.flatnonzero(gaps >= NEAR_MM)
    reached = not far.size or far[-1] < len(gaps) - 1
    time_s = (stamp[far[-1] + 1] if far.size else 0.0) if reached else np.inf
    going = stamp > begun
    way = np.linalg.norm(np.diff(tool[going], axis=0), axis=1).sum() if going.sum() > 1 else np.nan
    return Reach(
        method, trouble.name, task.robot, task.seed,
        mm=float(np.sqrt((gaps[last] ** 2).mean())), deg=float(np.sqrt((angles[last] ** 2).mean())),
        time_s=float(time_s), learned_s=float(begun), way=float(way / task.straight_m),
        clearance_mm=1e3 * float(rows[:, 6].min()), beyond_rad=float(rows[:, 7].max()),
        speed=float(rows[:, 8].max()), reason="" if world.moving else world.status.reason,
        stamp=stamp, gap_mm=gaps, tool=tool,
    )  # fmt: skip
