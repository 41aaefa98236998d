"""Virtual impedance control (TUM III): a mass that is drawn to the goal and pushed off everything else, and
joints that follow it.

The mass is integrated in steps of a millisecond. Every few of them the arm follows by inverse kinematics and
the distances are measured anew; in between they are linear in the mass's pose. A push at the forearm acts on
the mass as the force and torque with the same power, through the inverse of the tool's Jacobian, so the whole
arm evades and not the tool alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vita.impedance import energy as energies
from vita.impedance.arm_model import ArmModel
from vita.impedance.clearance import Obstacles
from vita.impedance.config import ImpedanceConfig
from vita.impedance.detour import Detour
from vita.impedance.inverse import damped_inverse, error_to, ranges, step
from vita.impedance.mass import Aim, Mass, Pull, advance, attraction, steer
from vita.impedance.motion import Goal, Motion, limited
from vita.impedance.sightings import Sightings
from vita.impedance.spring import length
from vita.impedance.surroundings import Nearness, Skeleton, Surroundings
from vita.impedance.turning import matrix_of, quaternion_of
from vita.types import Array

__all__ = ["Goal", "Motion", "Surroundings", "VirtualImpedance"]

STEP_S = 0.001
"""Longest step of the mass [s]."""
LOOK_S = 0.0115
"""Longest time between two looks at the distances [s]."""
TURN_FULL_RAD = 0.4
"""The turning spring is at its strongest from this angle on [rad]."""
LOOSE_M, LOOSE_RAD = 2e-4, 2e-3
"""Where the arm stays behind the mass by more than this, the mass is set back to the arm."""
LEASH_RAD = 0.15
"""No joint of the plan is ever farther than this from the measured one [rad]."""
AT_END_RAD = 0.05
"""A joint this near to the end of its range, and held there, is at its limit for people [rad]."""
BRAKE_HZ = 8.0
"""A joint nears its limit no faster than this many times the way that is left, each second."""
SMALL = 0.05
"""Singular values of the tool's Jacobian below which its inverse is damped where forces are mapped."""
AVOID, AVOID_RAD_S, CENTRE_HZ = 0.4, 1.0, 0.3
"""Spare joints: speed per pushing torque [rad/s / N m], the fastest of it [rad/s], rate of centring [1/s]."""


class VirtualImpedance:
    """The mass, the arm that follows it, and nothing else. Time is an argument."""

    def __init__(
        self, arm: ArmModel, config: ImpedanceConfig, radii: Sequence[float] | Array | None = None
    ) -> None:
        """`radii` (n,) is the thickness of each link, from its joint's frame to the next one's [m]."""
        self.config = config
        self._skeleton = Skeleton(arm, radii)
        self.take(arm)
        self.reset(np.clip(np.zeros(arm.n), self._lower, self._upper))

    @property
    def turns(self) -> bool:
        """Whether the tool takes the goal's orientation too."""
        return self.config.turn and self.arm.n >= 6

    def take(self, arm: ArmModel) -> None:
        """Go on with the same arm under other joint limits."""
        self.arm = arm
        self._lower, self._upper = ranges(arm)
        self._speeds = np.array([joint.max_speed for joint in arm.joints])

    def reset(self, q: Array) -> None:
        """Put the mass, at rest, where the tool is at q (n,) [rad]."""
        self._place(np.array(q, dtype=float))
        pose = self._frames[-1]
        self._mass = Mass(pose[:3, 3].tolist(), quaternion_of(pose[:3, :3]), [0.0] * (6 if self.turns else 3))
        self._detour, self._sightings = Detour(), Sightings()

    def pull_back(self, q_measured: Array) -> None:
        """Keep the plan near the arm: an arm that the gate slows down or holds is not run away from."""
        ahead = self._q - np.asarray(q_measured, dtype=float)
        if float(np.abs(ahead).max()) <= LEASH_RAD:
            return
        self._place(q_measured + np.clip(ahead, -LEASH_RAD, LEASH_RAD))
        self._set_back(everything=True)

    def advance(self, duration_s: float, goal: Goal | None, around: Surroundings) -> Motion:
        """Move on by `duration_s`. Without a goal the mass comes to rest where it is, and still evades."""
        pull, aim = self._pull(), self._aim(goal)
        if len(self._mass.motion) != (6 if pull.turn else 3):
            # Orientation was switched on or off; the mass starts to turn from rest.
            self._mass.motion = self._mass.motion[:3] + [0.0] * (3 if pull.turn else 0)
        others = self._sightings.take(around, duration_s)
        near = self._look(others, around)
        looks = max(1, math.ceil(duration_s / LOOK_S - 1e-9))
        steps = max(1, math.ceil(duration_s / looks / STEP_S - 1e-9))
        h = duration_s / looks / steps
        locked: tuple[int, ...] = ()
        for _ in range(looks):
            mass = self._mass
            mass.work, mass.moved = 0.0, [0.0] * len(mass.motion)
            before = energies.total(mass, aim, pull, near.walls)
            was = (self._q, mass.x, mass.turn)
            side = self._detour.look(near, mass.x, None if aim is None else aim.x, self.config.around)
            for _ in range(steps):
                if side is not None:
                    steer(mass.motion, side[0], side[1], pull.mass, h)
                advance(mass, aim, pull, near.walls, h)
            locked = self._follow(steps * h, near, resting=aim is None)
            near = self._look(others, around)
            excess = energies.total(mass, aim, pull, near.walls) - before - mass.work
            if not energies.take_out(mass, excess, pull):
                self._place(was[0])
                mass.x, mass.turn, mass.motion = was[1], was[2], [0.0] * len(mass.motion)
                near = self._look(others, around)
        return self._motion(aim, pull, near, locked)

    def _pull(self) -> Pull:
        c = self.config
        return Pull(
            c.mass_kg, c.stiffness, c.damping, c.pull_n, c.turn_stiffness, c.turn_damping,
            c.turn_stiffness * TURN_FULL_RAD, c.top_speed, c.feed_forward, self.turns,
        )

    def _aim(self, goal: Goal | None) -> Aim | None:
        if goal is None:
            return None
        T = np.asarray(goal.T_base_tool, dtype=float)
        velocity, turn_rate = np.asarray(goal.velocity, float), np.asarray(goal.turn_rate, float)
        return Aim(T[:3, 3].tolist(), quaternion_of(T[:3, :3]), velocity.tolist(), turn_rate.tolist())

    def _place(self, q: Array) -> None:
        self._q = q
        self._frames = self.arm.frames(q)
        self._J = self.arm.jacobian(self._frames)

    def _look(self, others: Obstacles, around: Surroundings) -> Nearness:
        inverse = damped_inverse(self._J if self.turns else self._J[:3], SMALL)
        return self._skeleton.look(
            self._frames, self._J, inverse, self._q, others, around.surface, self.config
        )

    def _follow(self, h: float, near: Nearness, resting: bool) -> tuple[int, ...]:
        """Bring the tool to the mass within what the joints may do in h seconds; set the mass back where they
        cannot. Returns the joints at their limits."""
        mass, start = self._mass, self._q
        most = 0.95 * h * self._speeds
        high = np.where(self._upper >= start, (self._upper - start) * min(1.0, BRAKE_HZ * h), 0.0)
        low = np.where(self._lower <= start, (self._lower - start) * min(1.0, BRAKE_HZ * h), 0.0)
        high = np.where(self._upper < start, np.maximum(self._upper - start, -most), high)
        low = np.where(self._lower > start, np.minimum(self._lower - start, most), low)
        locked: tuple[int, ...] = ()
        rows = 6 if self.turns else 3
        spare = self._spare(near, h, resting) if self.arm.n > rows else None
        goal = np.eye(4)
        goal[:3, :3], goal[:3, 3] = matrix_of(mass.turn), mass.x
        for _ in range(3):
            left = error_to(goal, self._frames[-1])[:rows]
            if spare is None and length(*left[:3].tolist()) < 1e-5 and np.abs(left[3:]).sum() < 1e-4:
                break
            done = self._q - start
            move = step(self._J, left, low - done, high - done, np.maximum(most - np.abs(done), 0.0), spare)
            locked, spare = move.locked, None
            self._place(self._q + move.dq)
        self._set_back()
        at_end = (self._q > self._upper - AT_END_RAD) | (self._q < self._lower + AT_END_RAD)
        return tuple(i for i in locked if at_end[i])

    def _spare(self, near: Nearness, h: float, resting: bool) -> Array:
        """(n,) motion of the joints that the tool's pose leaves free [rad]: away from what pushes and, unless
        the arm is to rest, towards the middle of the ranges where that leads no nearer to anything."""
        rate = 0.0 if resting else CENTRE_HZ
        centre = rate * ((self._lower + self._upper) / 2 - self._q)
        push = np.zeros(self.arm.n)
        for wall in near.walls:
            push += wall.push(wall.distance)[0] * wall.spare
        away = AVOID * push
        fastest = float(np.abs(away).max())
        if fastest > AVOID_RAD_S:
            away *= AVOID_RAD_S / fastest
        against = float(push @ centre)
        if against < 0.0:
            centre = centre - push * (against / float(push @ push))
        return h * (away + centre)

    def _set_back(self, everything: bool = False) -> None:
        """Put the mass where the arm is, if the arm could not follow, and stop its motion that way."""
        mass, pose = self._mass, self._frames[-1]
        lost = error_to(_pose(mass), pose)
        if everything or length(*lost[:3].tolist()) > LOOSE_M:
            mass.x = pose[:3, 3].tolist()
            mass.motion[:3] = _held(mass.motion[:3], lost[:3])
        if len(mass.motion) < 6:
            mass.turn = quaternion_of(pose[:3, :3])
        elif everything or length(*lost[3:].tolist()) > LOOSE_RAD:
            mass.turn = quaternion_of(pose[:3, :3])
            mass.motion[3:] = _held(mass.motion[3:], lost[3:])

    def _motion(self, aim: Aim | None, pull: Pull, near: Nearness, locked: tuple[int, ...]) -> Motion:
        mass = self._mass
        forces: dict[str, Array] = {}
        if aim is not None:
            forces["target"] = np.array(attraction(mass, aim, pull)[0][:3])
        for wall in near.walls:
            push = wall.push(wall.distance)[0]
            if push > 0.0:
                forces[wall.kind] = forces.get(wall.kind, 0.0) + push * np.array(wall.slope[:3])
        energy = energies.total(mass, aim, pull, near.walls)
        return Motion(
            self._q.copy(), _pose(mass), np.array(mass.motion[:3]), forces, near.distances, energy,
            limited(mass, aim, pull, forces, locked),
        )  # fmt: skip


def _pose(mass: Mass) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = matrix_of(mass.turn), mass.x
    return T


def _held(motion: list[float], lost: Array) -> list[float]:
    """(3) `motion` without its part along `lost` (3,), the way on which the arm stayed behind."""
    size = float(lost @ lost)
    if size < 1e-18:
        return motion
    ahead = max(float(np.dot(motion, lost)), 0.0) / size
    return [v - ahead * e for v, e in zip(motion, lost.tolist(), strict=True)]
