"""One run of a case, and what it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vita.experiments.stereo_cases import CASES, CONFIG, home, robot, standing
from vita.experiments.stereo_world import StereoWorld, Truth
from vita.impedance.arm_model import ArmModel
from vita.impedance.view import Capsule
from vita.poses import look_at
from vita.scenario.truth_log import between_segments
from vita.types import Array

SIGMA_PX = 0.1
"""Noise of a corner's coordinate; the eyes have 0.02 to 0.1 px on rendered pictures."""


@dataclass(frozen=True, eq=False)
class StereoRun:
    """t ticks of 1/30 s. Everything is ground truth but `recovered` and `phase`."""

    case: str
    robot: str
    stamp: Array
    """(t,) [s]."""
    tool: Array
    """(t, 3) centre of the tool's marker [m]."""
    recovered: Array
    """(t, 3) the same through the cameras and the learned calibration; NaN where unknown [m]."""
    target: Array
    """(t, 3) [m]."""
    goal: Array
    """(t, 3) where the tool frame should be [m]."""
    gap: Array
    """(t, 3) the tool frame from there [m]."""
    angle: Array
    """(t,) angle between the tool and its goal [rad]."""
    height: Array
    """(t,) lowest point of the arm's skeleton from the elbow to the tool's tip [m]."""
    radius: Array
    """(t,) distance of the tool from the base's axis [m]."""
    bend: Array
    """(t,) angle that is missing to a straight elbow [rad]."""
    clearance: Array
    """(t,) distance between the arm's surface, from the elbow on, and the nearest obstacle [m]."""
    phase: tuple[str, ...]

    def since(self, begin: float, end: float = np.inf) -> np.ndarray:
        """(t,) which ticks lie in a span of time."""
        return (self.stamp >= begin) & (self.stamp <= end)

    def rms_mm(self, begin: float, end: float = np.inf) -> float:
        gaps = self.gap[self.since(begin, end)]
        return 1e3 * float(np.sqrt((gaps**2).sum(axis=1).mean()))

    def bias_mm(self, begin: float, end: float = np.inf) -> float:
        return 1e3 * float(np.linalg.norm(self.gap[self.since(begin, end)].mean(axis=0)))

    def rms_deg(self, begin: float, end: float = np.inf) -> float:
        return float(np.degrees(np.sqrt((self.angle[self.since(begin, end)] ** 2).mean())))

    @property
    def recovered_mm(self) -> Array:
        """(t,) distance between true and recovered tool [mm]."""
        return 1e3 * np.linalg.norm(self.recovered - self.tool, axis=1)


RADIUS_M = 0.05
"""Thickness of the links from the elbow on [m]."""


def run_case(case: str, robot_name: str, seed: int) -> StereoRun:
    """Run a named case on a named robot."""
    chosen = CASES[case]
    arm, q0 = robot(robot_name)
    world = StereoWorld(arm, q0, chosen.truth(arm, q0), chosen.config, sigma_px=SIGMA_PX, seed=seed)
    return record(world, chosen.seconds, case, robot_name)


def record(world: StereoWorld, seconds: float, case: str, robot_name: str) -> StereoRun:
    """Press Start and run for `seconds`."""
    world.controller.start()
    rows: list[tuple] = []
    for _ in range(round(30 * seconds)):
        # The truth of the moment at which the pictures are taken; what is made of them comes after.
        now, frames = world.now, world.arm.frames(world.q)
        (gap, angle), goal = world.gap(), world.goal()
        target, parts = world.truth.target(now), world.truth.obstacles(now)
        world.tick()
        seen = world.controller.perception.tool_seen
        joints = world.arm.outer(frames, world.config.tool_tip_xyz)
        rows.append(
            (
                now, (frames[-1] @ world.T_tool_marker)[:3, 3], np.full(3, np.nan) if seen is None else seen,
                target[:3, 3], goal[:3, 3], gap, angle, joints[:, 2].min(), np.hypot(*frames[-1][:2, 3]),
                _bend(world.arm, frames), _clearance(joints, parts), world.controller.phase,
            )
        )  # fmt: skip
    columns = [np.array(column) for column in list(zip(*rows, strict=True))[:-1]]
    return StereoRun(case, robot_name, *columns, phase=tuple(row[-1] for row in rows))


def _clearance(joints: Array, parts: Sequence[Capsule]) -> float:
    return min(
        (
            between_segments(a, b, part.start, part.end) - part.radius - RADIUS_M
            for a, b in zip(joints[:-1], joints[1:], strict=True)
            for part in parts
        ),
        default=np.inf,
    )


def _bend(arm: ArmModel, frames: Array) -> float:
    """How far the elbow is from straight, in the plane across its axis [rad]."""
    if arm.landmarks is None:
        return np.nan
    shoulder, elbow, wrist = (frames[i, :3, 3] for i in arm.landmarks)
    axis = frames[arm.landmarks[1], :3, :3] @ arm.axes[arm.landmarks[1]]
    upper, lower = elbow - shoulder, wrist - elbow
    upper, lower = upper - (upper @ axis) * axis, lower - (lower @ axis) * axis
    return float(np.arccos(np.clip(upper @ lower / np.linalg.norm(upper) / np.linalg.norm(lower), -1, 1)))


# ---- random obstacles ----------------------------------------------------------------------------------

CROSS_S = 4.5
"""When the sphere sets out [s]."""


@dataclass(frozen=True)
class Crossing:
    """A sphere that crossed the arm's workspace."""

    seed: int
    robot: str
    radius_m: float
    speed_m_s: float
    nearest_m: float
    """Smallest distance between the sphere and the arm's surface."""
    after_mm: float
    """Root mean square distance of the tool from its goal once the sphere has gone [mm]."""


def run_crossings(robot_name: str, seeds: Sequence[int]) -> list[Crossing]:
    """One run for each seed: a sphere at random crosses the way of an arm that follows a still target."""
    return [_crossing(robot_name, seed) for seed in seeds]


def _crossing(robot_name: str, seed: int) -> Crossing:
    random = np.random.default_rng([seed, 5])
    arm, q0 = robot(robot_name)
    radius, speed = random.uniform(0.06, 0.12), random.uniform(0.1, 0.25)
    tool = arm.pose(q0)[:3, 3]
    # Through a place near tool or forearm, along a level or slightly sloping line, never near the base.
    through = tool + random.uniform((-0.12, -0.1, -0.1), (0.1, 0.1, 0.2))
    angle = random.uniform(-0.5, 0.5) + random.choice([-1.0, 1.0]) * np.pi / 2
    way = np.array([np.cos(angle), np.sin(angle), random.uniform(-0.2, 0.2)])
    way /= np.linalg.norm(way)
    lead = 0.6

    def obstacles(now: float) -> list[Capsule]:
        gone = speed * (now - CROSS_S) - lead
        place = through + gone * way
        return [] if not -lead <= gone <= lead + 0.1 else [Capsule("ball", place, place, radius)]

    truth = Truth(standing(home(arm, q0)), standing(look_at((1.75, 0.0, 0.65), (0.55, 0.0, 0.35))), obstacles)
    seconds = CROSS_S + (2 * lead + 0.1) / speed + 2.5
    world = StereoWorld(arm, q0, truth, replace(CONFIG), sigma_px=SIGMA_PX, seed=seed)
    run = record(world, seconds, "crossing", robot_name)
    return Crossing(
        seed, robot_name, radius, speed, float(run.clearance.min()), run.rms_mm(run.stamp[-1] - 1.0)
    )


