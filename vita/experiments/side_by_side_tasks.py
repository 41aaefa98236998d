"""Random reach tasks for the side-by-side experiment, and what may be wrong while they are done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vita.errors import BadInput
from vita.experiments.stereo_cases import CONFIG, EYE, LOOK_AT, eased, robot
from vita.experiments.stereo_runs import RADIUS_M
from vita.experiments.stereo_world import SIZE_PX, STEEPEST, stereo_rig
from vita.impedance.arm_model import ArmModel
from vita.impedance.inverse import solve
from vita.impedance.singularity import ElbowReach
from vita.impedance.view import Capsule
from vita.poses import look_at, pose_matrix
from vita.scenario.truth_log import between_segments
from vita.stereo.base import StereoRig, marker_square
from vita.stereo.projection import project
from vita.types import Array

NEAR_M, FAR_M, LEAST_TURN_DEG, TURN_DEG = 0.2, 0.45, 5.0, 25.0
"""How far and how much turned the goals are from where the tool starts."""
SPHERE_M, SPHERE_FREE_M = 0.04, 0.13
"""Radius of the obstacle, and how far the arm is from it at start and goal at least [m]."""
MOVED_M, MOVED_DEG, MOVED_OVER_S = 0.05, 10.0, 1.0
"""How the cameras are moved, and how long that takes."""
HAND_EYE_DEG, FOCAL = 5.0, 1.1
CARRIED_M_S, CIRCLE_M = 0.05, 0.05
"""A goal that is carried goes along a circle of this radius at this speed."""
T_TOOL_MARKER = pose_matrix(CONFIG.tool_marker_xyz, CONFIG.tool_marker_rpy_deg)
TIP = np.array([*CONFIG.tool_tip_xyz, 1.0])
"""The tool's far end in its frame."""
T_TARGET_GOAL = pose_matrix(CONFIG.offset_xyz, CONFIG.offset_rpy_deg)
INSIDE_PX = 25.0
"""So far from the rim of the picture the markers are at start and goal at least."""
TRIES = 4000


@dataclass(frozen=True)
class Trouble:
    """What is wrong, or in the way."""

    name: str
    focal: float = 1.0
    """Believed over true focal length."""
    hand_eye_deg: float = 0.0
    """How far the given place of the cameras is turned about the left camera."""
    moved: bool = False
    """Whether the cameras are moved when the tool is half way."""
    sphere: bool = False
    """Whether a sphere is across the straight way."""
    carried: bool = False
    """Whether the goal moves."""


TROUBLES: dict[str, Trouble] = {
    trouble.name: trouble
    for trouble in (
        Trouble("none"),
        Trouble("focal length +10 %", focal=FOCAL),
        Trouble("hand-eye 5 deg", hand_eye_deg=HAND_EYE_DEG),
        Trouble("focal and hand-eye", focal=FOCAL, hand_eye_deg=HAND_EYE_DEG),
        Trouble("cameras moved 5 cm, 10 deg", moved=True),
        Trouble("sphere in the way", sphere=True),
        Trouble("goal moves at 5 cm/s", carried=True),
    )
}


@dataclass(frozen=True, eq=False)
class Task:
    """Where to reach from the ready pose, and how the troubles would look there."""

    robot: str
    seed: int
    q0: Array
    """(n,) the ready pose [rad]."""
    T_start: Array
    T_goal: Array
    """(4, 4) where the tool is to be."""
    T_target: Array
    """(4, 4) where the target's marker is, for the tool to be there by the drawing."""
    left: Array
    """(4, 4) where the left camera stands (T_base_left) ..."""
    left_after: Array
    """... and where it stands once it has been moved."""
    left_believed: Array
    """... and where a wrong hand-eye calibration has it."""
    sphere: Capsule
    plane: Array
    """(2, 3) directions in which a carried goal circles."""

    @property
    def straight_m(self) -> float:
        return float(np.linalg.norm(self.T_goal[:3, 3] - self.T_start[:3, 3]))


class Carried:
    """Where the target's marker is: it stands, or goes round a circle once somebody says so."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self.begin_s = np.inf
        """When it sets out [s]."""

    def __call__(self, now: float) -> Array:
        T, (along, across) = self._task.T_target.copy(), self._task.plane
        angle = CARRIED_M_S / CIRCLE_M * max(0.0, now - self.begin_s)
        T[:3, 3] += CIRCLE_M * (np.sin(angle) * along + (1.0 - np.cos(angle)) * across)
        return T


class Tripod:
    """Where the left camera stands: moved once somebody says so."""

    def __init__(self, before: Array, after: Array) -> None:
        self._before, self._after = before, after
        self._way = Rotation.from_matrix(before[:3, :3].T @ after[:3, :3]).as_rotvec()
        self.moved_s = np.inf
        """When the motion begins [s]."""

    def __call__(self, now: float) -> Array:
        share = eased(now, self.moved_s, MOVED_OVER_S) if np.isfinite(self.moved_s) else 0.0
        T = self._before.copy()
        T[:3, 3] += share * (self._after[:3, 3] - self._before[:3, 3])
        T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(share * self._way).as_matrix()
        return T


def draw(robot_name: str, seed: int, sphere: bool = False) -> Task:
    """The task of this number; those with a sphere in the way are longer."""
    random = np.random.default_rng([seed, 17, int(sphere)])
    arm, q0 = robot(robot_name)
    T_start, left, rig = arm.pose(q0), look_at(EYE, LOOK_AT), stereo_rig()
    for _ in range(TRIES):
        T_goal = T_start.copy()
        if sphere:
            # To the side, where there is room on both ends for the arm to be clear of the sphere.
            way = np.array([*random.uniform(-0.12, 0.12, 1), random.choice([-1.0, 1.0]) * 0.44, 0.0])
            T_goal[:3, 3] += way + [0.0, 0.0, random.uniform(-0.05, 0.15)]
        else:
            T_goal[:3, 3] += random.uniform(NEAR_M, FAR_M) * _unit(random)
        T_goal[:3, :3] = _turn(random.uniform(LEAST_TURN_DEG, TURN_DEG), random) @ T_goal[:3, :3]
        T_target = T_goal @ np.linalg.inv(T_TARGET_GOAL)
        after = left.copy()
        after[:3, 3] += MOVED_M * _unit(random)
        after[:3, :3] = after[:3, :3] @ _turn(MOVED_DEG, random)
        believed = left.copy()
        believed[:3, :3] = believed[:3, :3] @ _turn(HAND_EYE_DEG, random)
        plane = np.linalg.qr(np.array([_unit(random), _unit(random)]).T)[0].T
        middle = 0.5 * (T_start[:3, 3] + T_goal[:3, 3])
        ball = Capsule("ball", middle, middle, SPHERE_M)
        task = Task(robot_name, seed, q0, T_start, T_goal, T_target, left, after, believed, ball, plane)
        if _possible(task, arm, rig, sphere):
            return task
    raise BadInput(f"no task was found for {robot_name} with seed {seed}", "seed")


def _possible(task: Task, arm: ArmModel, rig: StereoRig, sphere: bool) -> bool:
    """Whether the goal can be reached and both markers are seen at start and goal."""
    goal, target = task.T_goal[:3, 3], task.T_target[:3, 3]
    if target[2] < 0.12 or goal[2] < 0.25 or np.hypot(*goal[:2]) < 0.4:
        return False
    if any((T @ TIP)[2] < CONFIG.table_m + 0.03 for T in (task.T_start, task.T_goal)):
        return False  # The table would hold the tool's tip off, and rightly so.
    markers = (
        (task.T_start @ T_TOOL_MARKER, CONFIG.tool_marker_m),
        (task.T_goal @ T_TOOL_MARKER, CONFIG.tool_marker_m),
        (task.T_target, CONFIG.target_marker_m),
    )
    if not all(_in_both(rig, T, *marker) for T in (task.left, task.left_after) for marker in markers):
        return False
    found = solve(arm, task.q0, task.T_goal, tries=0)
    if found.limited:
        return False
    elbow = ElbowReach.of(arm)
    if elbow is not None and elbow.angle(found.q) < np.radians(CONFIG.singular_deg) + 0.1:
        return False  # So stretched a pose is kept away from.
    free = min(clearance(arm, q, (task.sphere,)) for q in (task.q0, found.q))
    return not sphere or free > SPHERE_FREE_M


def clearance(arm: ArmModel, q: Array, parts: Sequence[Capsule]) -> float:
    """Smallest distance between the arm's surface, from the elbow on, and the nearest of `parts` [m]."""
    joints = arm.outer(arm.frames(q), CONFIG.tool_tip_xyz)
    return min(
        (
            between_segments(a, b, part.start, part.end) - part.radius - RADIUS_M
            for a, b in zip(joints[:-1], joints[1:], strict=True)
            for part in parts
        ),
        default=np.inf,
    )


def _in_both(rig: StereoRig, T_base_left: Array, T_base_marker: Array, size_m: float) -> bool:
    """Whether both cameras see a marker well inside their pictures."""
    T_left_marker = np.linalg.inv(T_base_left) @ T_base_marker
    for lens, T in ((rig.left, np.eye(4)), (rig.right, rig.T_right_left)):
        T_camera_marker = T @ T_left_marker
        centre = T_camera_marker[:3, 3]
        pixels = project(lens, marker_square(size_m) @ T_camera_marker[:3, :3].T + centre)
        inside = (pixels > INSIDE_PX).all() and (pixels < np.array(SIZE_PX) - 1 - INSIDE_PX).all()
        if not inside or -(T_camera_marker[:3, 2] @ centre) / np.linalg.norm(centre) < 2.0 * STEEPEST:
            return False
    return True


def _unit(random: np.random.Generator) -> Array:
    """(3,) a direction at random."""
    v = random.standard_normal(3)
    return v / np.linalg.norm(v)


def _turn(deg: float, random: np.random.Generator) -> Array:
    """(3, 3) a turn by so much about an axis at random."""
    return Rotation.from_rotvec(np.radians(deg) * _unit(random)).as_matrix()
