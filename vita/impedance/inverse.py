"""Inverse kinematics: joints that put the tool where the virtual mass is (TUM III-B).

Position comes first, orientation with what freedom is left, and what an arm with spare joints has left after
that keeps it clear of things and near the middle of its range. Each level is a damped least-squares problem
in the null space of the one before, so neither a wrist singularity nor an orientation out of reach costs the
position. A joint at its limit is locked and the rest is solved again without it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.errors import BadInput
from vita.impedance.arm_model import ArmModel
from vita.impedance.turning import between, quaternion_of
from vita.types import Array

MARGIN_RAD = 0.03
"""How far joints stay from their limits; the gate keeps 0.02 [rad]."""
SMALL_REACH, SMALL_TURN = 0.02, 0.05
"""Singular values below which a direction is damped [m/rad], [rad/rad]."""
STEP_RAD = 0.2
"""Largest joint motion in one iteration of `solve`: the linear model holds no further [rad]."""
NEAR_M, NEAR_RAD = 1e-6, 1e-5
"""A pose met this closely is met."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Joints and what they leave."""

    q: Array
    """(n,) [rad]."""
    position_error_m: float
    """Distance of the tool from the goal."""
    angle_error_rad: float
    """Angle between the tool and the goal; 0 where orientation was not asked for."""
    limited: str
    """What keeps the tool from the goal: "joint 4 at its limit", "out of reach", or "" where it is met."""


@dataclass(frozen=True, eq=False)
class Step:
    """One small joint motion."""

    dq: Array
    """(n,) [rad]."""
    locked: tuple[int, ...]
    """Joints that a bound holds."""


def ranges(arm: ArmModel, margin: float = MARGIN_RAD) -> tuple[Array, Array]:
    """(n,), (n,) lowest and highest joint positions, `margin` inside the arm's limits [rad]; a joint with
    hardly any range keeps half of it, as it does at the gate."""
    lower = np.array([joint.lower for joint in arm.joints])
    upper = np.array([joint.upper for joint in arm.joints])
    if (lower > upper).any():
        raise BadInput("a lower joint limit is above the upper one", arm.name)
    inside = np.minimum(margin, (upper - lower) / 4)
    return lower + inside, upper - inside


def damped_inverse(J: Array, small: float) -> Array:
    """(n, m) inverse of J (m, n) in which singular values below `small` are damped, the more the smaller,
    down to nothing at zero; those above it are inverted exactly."""
    U, s, Vt = np.linalg.svd(J, full_matrices=False)
    lack = np.maximum(1.0 - (s / small) ** 2, 0.0) * small**2
    return (Vt.T * (s / (s * s + lack))) @ U.T


def step(
    J: Array, twist: Array, low: Array, high: Array, most: Array, spare: Array | None = None
) -> Step:
    """The joint motion that moves the tool by `twist` (3,) translation or (6,) with rotation [m, rad].

    J (6, n) of the tool; `low`, `high` (n,) bounds of the motion that joint limits leave [rad]; `most` (n,)
    what the joints' speeds allow [rad]: where it is exceeded, a level's whole motion is shortened, so that
    the tool keeps its direction; `spare` (n,) is done in what null space is left.
    """
    n = J.shape[1]
    dq, free, locked = np.zeros(n), np.ones(n, dtype=bool), []
    turn = twist.size == 6
    while True:
        rest = twist - J[: twist.size] @ np.where(free, 0.0, dq) if locked else twist
        motion = _levels(J[:, free], rest, turn, most[free], None if spare is None else spare[free])
        dq[free] = motion
        over = np.where(free, np.maximum(dq - high, low - dq), 0.0)
        worst = int(np.argmax(over))
        if over[worst] <= 1e-12:
            return Step(dq, tuple(locked))
        dq[worst] = min(max(dq[worst], low[worst]), high[worst])
        free[worst] = False
        locked.append(worst)
        if not free.any():
            return Step(dq, tuple(locked))


def _levels(J: Array, twist: Array, turn: bool, most: Array, spare: Array | None) -> Array:
    """(k,) position, then orientation, then `spare`, each in the null space of what came before."""
    inverse = damped_inverse(J[:3], SMALL_REACH)
    dq = _shortened(inverse @ twist[:3], 0.0, most)
    left = np.eye(J.shape[1]) - inverse @ J[:3]
    if turn:
        J_turn = J[3:] @ left
        inverse = damped_inverse(J_turn, SMALL_TURN)
        dq = _shortened(left @ (inverse @ (twist[3:] - J[3:] @ dq)), dq, most)
        left = left - inverse @ J_turn
    if spare is not None:
        dq = _shortened(left @ spare, dq, most)
    return dq


def _shortened(more: Array, done: Array | float, most: Array) -> Array:
    """`done` plus the largest share of `more` that keeps every joint within `most`."""
    room = np.maximum(most - np.sign(more) * done, 0.0)
    share = float(np.min(room / np.maximum(np.abs(more), 1e-15)))
    return done + min(1.0, share) * more


def error_to(T_goal: Array, T: Array) -> Array:
    """(6,) translation and rotation vector, in the base frame, from pose T to T_goal [m, rad]."""
    turn = between(quaternion_of(T_goal[:3, :3]), quaternion_of(T[:3, :3]))
    return np.concatenate([T_goal[:3, 3] - T[:3, 3], turn])


def solve(
    arm: ArmModel,
    q_from: Array,
    T_goal: Array,
    turn: bool = True,
    margin: float = MARGIN_RAD,
    iterations: int = 150,
    tries: int = 12,
) -> Solution:
    """Joints near `q_from` (n,) [rad] that bring the tool to T_goal (4, 4); `turn` false leaves its
    orientation free. Where the way from `q_from` ends at a joint limit, other starting points are tried,
    always the same ones, and the best end is returned with what limits it."""
    T_goal = np.asarray(T_goal, dtype=float)
    if T_goal.shape != (4, 4) or not np.isfinite(T_goal).all():
        raise BadInput(f"expected a finite (4, 4) pose, got shape {T_goal.shape}", "T_goal")
    lower, upper = ranges(arm, margin)
    start = np.clip(np.asarray(q_from, dtype=float), lower, upper)
    best = _descend(arm, start, T_goal, turn, lower, upper, iterations)
    random = np.random.default_rng(0)
    for _ in range(tries):
        if not best.limited:
            break
        other = random.uniform(lower, upper)
        found = _descend(arm, other, T_goal, turn, lower, upper, iterations)
        if not found.limited or _cost(found) < 0.5 * _cost(best):
            best = found
    return best


def _descend(
    arm: ArmModel, q: Array, T_goal: Array, turn: bool, lower: Array, upper: Array, iterations: int
) -> Solution:
    rows, most, middle = 6 if turn else 3, np.full(arm.n, STEP_RAD), (lower + upper) / 2
    spare_joints = arm.n > rows
    locked: tuple[int, ...] = ()
    frames = arm.frames(q)
    for i in range(iterations):
        error = error_to(T_goal, frames[-1])[:rows]
        if np.linalg.norm(error[:3]) < NEAR_M and np.linalg.norm(error[3:]) < NEAR_RAD:
            locked = ()
            break
        # Centring fades, so that the last iterations converge on the pose alone.
        spare = 0.02 * 0.9**i * (middle - q) if spare_joints else None
        move = step(arm.jacobian(frames), error, lower - q, upper - q, most, spare)
        q, locked = np.clip(q + move.dq, lower, upper), move.locked
        frames = arm.frames(q)
    error = error_to(T_goal, frames[-1])[:rows]
    away, angle = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    limited = ""
    if away > 1e-4 or angle > 1e-3:
        limited = held_by(locked) or "out of reach"
    return Solution(q, away, angle, limited)


def held_by(locked: tuple[int, ...]) -> str:
    """"joint 4 at its limit" for people, who count from 1."""
    if not locked:
        return ""
    names = ", ".join(str(i + 1) for i in sorted(locked))
    return f"joint {names} at its limit" if len(locked) == 1 else f"joints {names} at their limits"


def _cost(found: Solution) -> float:
    return found.position_error_m + 0.1 * found.angle_error_rad
