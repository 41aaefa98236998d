"""The situations of the stereo-impedance experiment: who carries the target where, who moves the cameras, and
who walks into the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from vita.experiments.stereo_world import Path, Truth
from vita.impedance.arm_model import ArmModel
from vita.impedance.config import ImpedanceConfig
from vita.impedance.view import Capsule
from vita.poses import look_at, pose_matrix
from vita.sim.robots import load_robot
from vita.types import Array

EYE, LOOK_AT = (1.75, 0.0, 0.65), (0.55, 0.0, 0.35)
"""Where the tripod stands and looks [m]."""
SETTLED_S = 7.0
"""The calibration motion is over by then [s]."""
CONFIG = ImpedanceConfig()


@dataclass(frozen=True)
class Case:
    """One situation, from Start on."""

    name: str
    doc: str
    truth: Callable[[ArmModel, Array], Truth]
    """Of the arm and its start (n,)."""
    seconds: float
    from_s: float = SETTLED_S
    """Errors count from here on [s]."""
    until_s: float = np.inf
    config: ImpedanceConfig = field(default_factory=lambda: CONFIG)


def robot(name: str) -> tuple[ArmModel, Array]:
    """The arm and its ready pose (n,) [rad]."""
    model = load_robot(name)
    return model.arm_model(), np.array(model.q_ready)


def home(arm: ArmModel, q0: Array, shift: tuple[float, float, float] = (0.0, 0.05, 0.02)) -> Array:
    """(4, 4) a target whose goal is `shift` [m] beside where the tool is at q0."""
    T = arm.pose(q0) @ np.linalg.inv(pose_matrix(CONFIG.offset_xyz, CONFIG.offset_rpy_deg))
    T[:3, 3] += shift
    return T


def eased(now: float, begin: float, over: float) -> float:
    """0 before, 1 after, smooth in between."""
    x = float(np.clip((now - begin) / over, 0.0, 1.0))
    return x**3 * (10 - 15 * x + 6 * x * x)


def standing(T: Array) -> Path:
    return lambda now: T


def _still(arm: ArmModel, q0: Array) -> Truth:
    return Truth(standing(home(arm, q0)), standing(look_at(EYE, LOOK_AT)))


SPEED_M_S, TURN_DEG_S, RADIUS_M = 0.1, 20.0, 0.1
"""How the target is carried: along a circle, and to and fro about its own axes."""


def _carried(arm: ArmModel, q0: Array) -> Truth:
    start = home(arm, q0, (0.0, 0.0, 0.05))
    # Turning to and fro between +-15 degrees at a steady speed, as a hand does, its corners rounded.
    swing = np.radians(15.0)
    rate = np.radians(TURN_DEG_S) / swing

    def target(now: float) -> Array:
        t = max(0.0, now - 5.0)
        fade = eased(now, 5.0, 1.0)
        T = start.copy()
        angle = SPEED_M_S / RADIUS_M * t
        T[:3, 3] += fade * RADIUS_M * np.array([0.0, np.sin(angle), np.cos(angle) - 1.0])
        turn = fade * swing * np.sin(rate * t)
        T[:3, :3] = Rotation.from_rotvec(turn * np.array([0.0, 0.0, 1.0])).as_matrix() @ T[:3, :3]
        return T

    return Truth(target, standing(look_at(EYE, LOOK_AT)))


MOVED_S, MOVED_OVER_S = 10.0, 1.0
MOVED_M, MOVED_DEG = 0.20, 30.0


def _tripod(arm: ArmModel, q0: Array) -> Truth:
    """The tripod is moved by 20 cm and turned by 30 degrees, so that it still sees both markers."""
    before = look_at(EYE, LOOK_AT)
    after = before.copy()
    after[:3, 3] += MOVED_M * np.array([-0.6, 0.8, 0.0])
    # Turned partly about its optical axis, or the markers would leave the picture.
    turn = Rotation.from_rotvec(np.radians(MOVED_DEG) * np.array([0.25, 0.12, 0.96]))
    after[:3, :3] = look_at(after[:3, 3], LOOK_AT)[:3, :3] @ _rest(before, after, turn)

    def left(now: float) -> Array:
        share = eased(now, MOVED_S, MOVED_OVER_S)
        T = before.copy()
        T[:3, 3] += share * (after[:3, 3] - before[:3, 3])
        way = Rotation.from_matrix(before[:3, :3].T @ after[:3, :3]).as_rotvec()
        T[:3, :3] = before[:3, :3] @ Rotation.from_rotvec(share * way).as_matrix()
        return T

    return Truth(standing(home(arm, q0)), left)


def _rest(before: Array, after: Array, turn: Rotation) -> Array:
    """(3, 3) the roll by which the whole turn of the tripod comes to 30 degrees."""
    facing = before[:3, :3].T @ look_at(after[:3, 3], LOOK_AT)[:3, :3]
    best = min(
        np.linspace(0.0, 60.0, 241),
        key=lambda deg: abs(
            Rotation.from_matrix(facing @ _roll(deg)).magnitude() - turn.magnitude()
        ),
    )
    return _roll(best)


def _roll(deg: float) -> Array:
    return Rotation.from_euler("z", deg, degrees=True).as_matrix()


HIDDEN_S, HIDE_RADIUS_M = 9.0, 0.05


def _hidden(arm: ArmModel, q0: Array) -> Truth:
    """A pole is put between the cameras and the target; then the tripod is carried to where it sees again."""
    target = home(arm, q0)
    before, after = look_at(EYE, LOOK_AT), look_at((1.55, 0.55, 0.7), LOOK_AT)
    middle = before[:3, 3] + 0.1 * before[:3, 0]
    pole = target[:3, 3] + 0.45 * (middle - target[:3, 3])

    def left(now: float) -> Array:
        share = eased(now, HIDDEN_S + 2.0, 1.5)
        eye = before[:3, 3] + share * (after[:3, 3] - before[:3, 3])
        return look_at(eye, LOOK_AT)

    def obstacles(now: float) -> list[Capsule]:
        if now < HIDDEN_S:
            return []
        return [Capsule("pole", pole - [0, 0, 0.3], pole + [0, 0, 0.25], HIDE_RADIUS_M)]

    def hidden(now: float) -> bool:
        if now < HIDDEN_S:
            return False
        eye = left(now)[:3, 3] + 0.1 * left(now)[:3, 0]
        way = target[:3, 3] - eye
        # The pole is upright: only how the line of sight passes it in the plan matters.
        share = np.clip(((pole - eye)[:2] @ way[:2]) / (way[:2] @ way[:2]), 0.0, 1.0)
        return bool(np.linalg.norm((eye + share * way - pole)[:2]) < HIDE_RADIUS_M + 0.09)

    return Truth(standing(target), left, obstacles, hidden)


WALK_S, WALK_M_S = 9.0, 0.2


def person_at(place: Array) -> list[Capsule]:
    """A standing person as thick segments: body, head, and an arm stretched towards the robot."""
    x, y, _ = place
    return [
        Capsule("person", np.array([x, y, 0.0]), np.array([x, y, 0.55]), 0.16),
        Capsule("person", np.array([x, y, 0.78]), np.array([x, y, 0.82]), 0.11),
        Capsule("person", np.array([x, y, 0.5]), np.array([x - 0.3, y, 0.45]), 0.05),
    ]


def _human(arm: ArmModel, q0: Array) -> Truth:
    """A person walks across in front of the arm, an arm stretched into its way, while it follows."""
    carried = _carried(arm, q0).target
    tool = arm.pose(q0)[:3, 3]

    def obstacles(now: float) -> list[Capsule]:
        y = -0.9 + WALK_M_S * max(0.0, now - WALK_S)
        return [] if y > 0.9 else person_at(np.array([tool[0] + 0.38, tool[1] + y, 0.0]))

    return Truth(carried, standing(look_at((2.1, 0.0, 1.05), LOOK_AT)), obstacles)


def _pulled(there: tuple[float, float, float], over: float = 3.0) -> Callable[[ArmModel, Array], Truth]:
    """The target is carried to a place where the arm must not follow, held there, and carried back."""

    def truth(arm: ArmModel, q0: Array) -> Truth:
        start = home(arm, q0, (0.0, 0.0, 0.0))
        goal = arm.pose(q0)[:3, 3]

        def target(now: float) -> Array:
            share = eased(now, SETTLED_S, over) - eased(now, SETTLED_S + over + 3.0, over)
            T = start.copy()
            T[:3, 3] += share * (np.where(np.isnan(there), goal, there) - goal)
            return T

        return Truth(target, standing(look_at((2.4, 0.0, 0.9), (0.6, 0.0, 0.4))))

    return truth


CASES: dict[str, Case] = {
    case.name: case
    for case in (
        Case("still", "a target that is held still", _still, 15.0),
        Case("carried", "a target carried along a circle at 0.1 m/s and turned at 20 deg/s", _carried, 20.0),
        Case("tripod", "the tripod is moved by 20 cm and 30 degrees (figure 7)", _tripod, 22.0, 20.0),
        Case("hidden", "the target is hidden, the tripod carried to see it (figure 6)", _hidden, 25.0, 23.0),
        Case("human", "a person crosses the way while the target is carried (figure 8)", _human, 24.0, 20.0),
        Case("table", "the target is pushed 10 cm below the table", _pulled((np.nan, np.nan, -0.10)), 13.0),
        Case("singular", "the target is pulled out of reach", _pulled((1.25, 0.0, 0.6)), 16.0),
        Case("base", "the target is pushed through the base", _pulled((0.0, 0.0, np.nan)), 16.0),
    )
}
