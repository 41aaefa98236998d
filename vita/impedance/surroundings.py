"""What the virtual mass is told of the world, and the walls that this makes at one pose of the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vita.errors import BadInput
from vita.impedance.arm_model import ArmModel
from vita.impedance.clearance import Gap, Obstacles, to_axis, to_obstacles, to_surface
from vita.impedance.config import ImpedanceConfig
from vita.impedance.repulsion import Wall, cap
from vita.impedance.singularity import ElbowReach, lever
from vita.impedance.view import Capsule, Surface
from vita.types import Array

TOOL_THICK_M = 0.03
"""Radius of the tool, from its frame to its tip [m]."""
THICK_M = 0.05
"""Radius of a link where none is given [m]."""
AHEAD_S = 0.15
"""How far ahead an approaching obstacle is taken to be: where it will be after this time [s]."""
FASTEST = 1.0
"""No obstacle is taken to come faster than this; a jump is not a speed [m/s]."""
MARGIN_M, MARGIN_RAD = 0.03, 0.1
"""Things up to this much beyond the onset are kept in view, for they may come nearer before the next look."""
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Surroundings:
    """People and obstacles now, in the robot's base frame."""

    capsules: tuple[Capsule, ...] = ()
    velocities: tuple[Array, ...] | None = None
    """(3,) of each capsule [m/s]; None takes them from one call to the next."""
    surface: Surface | None = None
    """What a depth camera sees."""


@dataclass(frozen=True, eq=False)
class Nearness:
    """The walls at one pose and what they mean for people."""

    walls: tuple[Wall, ...]
    distances: dict[str, float]
    """`table`, `base`, `people` in metres, `singularity` in degrees: the nearest of each kind."""
    passing: tuple[Array, float] | None
    """(3,) unit vector away from the nearest of the people within the onset, and how hard it pushes [N]."""


class Skeleton:
    """The arm's outer links as thick segments: from the elbow, where it has one, to the tool."""

    def __init__(self, arm: ArmModel, radii: Sequence[float] | Array | None = None) -> None:
        if radii is None:
            radii = np.full(arm.n, THICK_M)
        radii = np.asarray(radii, dtype=float)
        if radii.shape != (arm.n,) or not (np.isfinite(radii).all() and (radii >= 0).all()):
            raise BadInput(f"expected {arm.n} radii, one a link, none below 0, got {radii}", "radii")
        self.arm = arm
        first = 1 if arm.landmarks is None else arm.landmarks[1]
        frames = arm.frames(np.zeros(arm.n))
        lengths = np.linalg.norm(np.diff(frames[:, :3, 3], axis=0), axis=1)
        # Joints whose axes meet have their frames in one place; such links have no length of their own.
        links = [i for i in range(first, arm.n) if lengths[i] > 1e-6] or [arm.n - 1]
        self.links = np.array(links)
        self.radii = radii[self.links]
        self.reach = ElbowReach.of(arm)
        wrist = arm.n if self.reach is None else self.reach.wrist
        self.marks = sorted({arm.n, wrist})
        """Joint frames (n: the tool) that the base repels."""
        elbow = [] if self.reach is None else [self.reach.elbow]
        self.low = [(i, float(radii[i]) if i < arm.n else 0.0) for i in (*elbow, *self.marks)]
        """Joint frames that the table repels, with their radii; the lowest point of a chain of segments is
        one of its corners."""

    def gaps(self, places: Array, others: Obstacles, surface: Surface | None) -> list[Gap]:
        """The closest approaches to people and obstacles; `places` are those of `look`."""
        n, links, radii = self.arm.n, self.links, self.radii
        if np.linalg.norm(places[n + 1] - places[n]) > 1e-6:
            links, radii = np.append(links, n), np.append(radii, TOOL_THICK_M)
        starts, ends = places[links], places[links + 1]
        back = places[1] - places[n]
        fallback = back / max(float(np.linalg.norm(back)), 1e-9)
        found = to_obstacles(starts, ends, radii, others, fallback)
        if surface is not None:
            found += to_surface(starts, ends, radii, surface)
        return found

    def look(
        self, frames: Array, J: Array, inverse: Array, q: Array, others: Obstacles,
        surface: Surface | None, config: ImpedanceConfig,
    ) -> Nearness:
        """All walls at joints q (n,), with `frames`, the tool's Jacobian J (6, n) and the `inverse` (n, 6),
        or (n, 3) of its translation alone."""
        n = self.arm.n
        # Where the joints, the tool's frame and its tip are, (n + 2, 3).
        tip = frames[n, :3, :3] @ np.asarray(config.tool_tip_xyz, dtype=float) + frames[n, :3, 3]
        places = np.concatenate([frames[:, :3, 3], tip[None]])
        found: list[tuple[str, float, float, float, Array, Array, int]] = []
        for mark, radius in (*self.low, (n + 1, 0.0)):
            point = places[mark]
            height = float(point[2]) - config.table_z - radius
            found.append(("table", height, config.table_m, 0.0, UP, point, min(mark + 1, n)))
        for mark in self.marks:
            point = places[mark]
            far, out = to_axis(point)
            found.append(("base", far, config.base_m, config.base_stop_m, out, point, min(mark + 1, n)))
        for gap in self.gaps(places, others, surface):
            d = gap.distance - AHEAD_S * min(gap.coming, FASTEST)
            link = int(self.links[gap.segment]) if gap.segment < self.links.size else n
            joints = min(link + 1, n)
            found.append(("people", d, config.people_m, config.stop_m, gap.normal, gap.point, joints))

        distances: dict[str, float] = {}
        for kind, d, *_ in found:
            distances[kind] = min(distances.get(kind, np.inf), d)
        walls: list[Wall] = []
        passing, nearest = None, np.inf
        gain, steepness = config.push_n, config.steepness
        for kind, d, onset, stop, normal, point, joints in found:
            if onset <= 0.0 or gain <= 0.0 or d > onset + MARGIN_M:
                continue
            # How the joints move this point along the normal, and so how the tool's pose does.
            spare = np.zeros(n)
            spare[:joints] = lever(J[3:, :joints], point, frames[:joints, :3, 3], normal)
            slope = tuple((spare @ inverse).tolist())
            top = cap(gain, steepness, onset, config.pull_n)
            wall = Wall(kind, d, slope, gain, steepness, onset, stop, top, spare)
            walls.append(wall)
            if kind == "people" and d < nearest:
                nearest, passing = d, (normal, wall.push(d)[0])
        if self.reach is not None:
            angle = self.reach.angle(q)
            distances["singularity"] = float(np.rad2deg(angle))
            onset = float(np.deg2rad(config.singular_deg))
            if onset > 0.0 and config.singular_n > 0.0 and angle < onset + MARGIN_RAD:
                arm = self.reach.shortening(onset)
                gain, steepness = config.singular_n * arm, config.singular_steepness
                slope = tuple(self.reach.bending(frames, angle, inverse, J[3:]).tolist())
                top = cap(gain, steepness, onset, config.pull_n, arm)
                walls.append(
                    Wall("singularity", angle, slope, gain, steepness, onset, onset / 4, top, np.zeros(n))
                )
        return Nearness(tuple(walls), distances, passing)
