"""The methods that are compared, each in the same world: exact kinematics, noisy corners, the real gate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from vita.experiments.side_by_side_given import GivenPerception
from vita.experiments.side_by_side_tasks import T_TOOL_MARKER, Carried, Task, Tripod, Trouble
from vita.experiments.stereo_cases import CONFIG, robot
from vita.experiments.stereo_runs import SIGMA_PX
from vita.experiments.stereo_world import CYCLES, FRAME_S, StereoWorld, Truth, stereo_rig
from vita.impedance.config import ImpedanceConfig
from vita.impedance.perception import Seen
from vita.servo import Controller, Limits, ServoConfig
from vita.servo.limits import within_gate
from vita.servo.visual_servo import GO_ON
from vita.stereo.base import MarkerCorners
from vita.types import ErrorVector, JointStep, RowLabel, Status
from vita.vision.marker_pose import marker_pose

LIMITS = Limits()
"""All methods move within the limits that a rig has by default."""
SHOWN = 10
"""Pictures that are averaged where a goal is taught by showing."""
PEOPLE_M = 0.10
"""Where a sphere is in the way, obstacles repel from here on [m]: with the default of 0.2 m the goals would
lie within its reach, and the arm would keep off them on purpose."""
CAMERAS = ("left", "right")
LABELS = tuple(
    RowLabel(f"corner {i + 1}", camera, axis) for camera in CAMERAS for i in range(4) for axis in "uv"
)


class ReachWorld(StereoWorld):
    """One method at one task; every method sees the same pictures of the goal before it begins."""

    uses: ClassVar[frozenset[str]] = frozenset()
    """Of `focal` length and `hand-eye`, what the method is given: an error of the others changes nothing."""

    def __init__(self, task: Task, trouble: Trouble, config: ImpedanceConfig = CONFIG) -> None:
        self.tripod, self.target, self.task = Tripod(task.left, task.left_after), Carried(task), task
        parts = (task.sphere,) if trouble.sphere else ()
        truth = Truth(self.target, self.tripod, lambda now: parts)
        rig = stereo_rig()
        believed = stereo_rig(trouble.focal * rig.left.fx)
        super().__init__(
            robot(task.robot)[0], task.q0, truth, config, sigma_px=SIGMA_PX, seed=task.seed,
            speed_rad_s=LIMITS.speed_rad_s, believed=believed,
        )  # fmt: skip
        self.shown = self._show()

    def _show(self) -> Mapping[str, MarkerCorners]:
        """The markers' corners with the tool at its goal: the mean of a few pictures."""
        config, shown = self.config, {}
        for name, T, size in (
            ("tool", self.task.T_goal @ T_TOOL_MARKER, config.tool_marker_m),
            ("target", self.task.T_target, config.target_marker_m),
        ):
            pictures = [self._corners(T, size) for _ in range(SHOWN)]
            left, right = (np.mean([getattr(p, side) for p in pictures], axis=0) for side in CAMERAS)
            shown[name] = MarkerCorners(left, right, SIGMA_PX)
        return shown

    # ---- what every method answers -----------------------------------------------------------------

    def start(self) -> None:
        self.controller.start()

    @property
    def status(self) -> Status:
        return self.controller.status

    @property
    def moving(self) -> bool:
        return self.controller.moving

    @property
    def on_its_way(self) -> bool:
        """Whether the arm has learned what it must and heads for the goal."""
        return self.controller.phase in ("following", "waiting")


class Uvs(ReachWorld):
    """Vita's first mode with its default settings: the tool marker's corners in both pictures are brought to
    where they were when the goal was shown. No parameter of a camera or of the arm comes in."""

    tolerance_px = ServoConfig().tolerance_px
    tied = False
    """Whether the goal's corners are shifted with the target's marker in each picture."""

    def __init__(self, task: Task, trouble: Trouble) -> None:
        super().__init__(task, trouble)
        follows = trouble.carried and self.tied
        config = ServoConfig(moving_goal=float(follows), tolerance_px=self.tolerance_px)
        self.servo = Controller(within_gate(self.arm.joints), config)
        self._follows = follows

    def start(self) -> None:
        self.servo.start()

    @property
    def status(self) -> Status:
        return self.servo.status

    @property
    def moving(self) -> bool:
        return self.servo.moving

    @property
    def on_its_way(self) -> bool:
        return self.servo.status.state == "servoing"

    def tick(self) -> None:
        """See, decide, and let 1/30 s pass."""
        decision = self.servo.tick(self.now, self.q.copy(), self._error(self.look()))
        if self._follows and not self.moving and self.status.reason in GO_ON:
            self.servo.start(relearn=False, even_if_met=True)  # As `VisualServo.follow` does.
        step = None
        if decision is not None:
            scale = decision.speed_scale
            if decision.exploring:
                scale = min(scale, LIMITS.explore_speed_rad_s / LIMITS.speed_rad_s)
            step = JointStep(decision.dq, self.q.copy(), self.now, scale)
        self._gate.command(step, self.now)
        for _ in range(CYCLES):
            self.q, _ = self._gate.cycle(self.now, self.q)
            self.now += FRAME_S / CYCLES
        self.now = round(self.now * 30) / 30

    def _error(self, seen: Mapping[str, Seen]) -> ErrorVector:
        rows = []
        for camera in CAMERAS:
            corners, goal = getattr(seen["tool"].corners, camera), getattr(self.shown["tool"], camera)
            if self.tied:
                target, then = getattr(seen["target"].corners, camera), getattr(self.shown["target"], camera)
                goal = goal + (np.nan if target is None else (target - then).mean(axis=0))
            rows.append(np.full(8, np.nan) if corners is None else (corners - goal).ravel())
        values = np.concatenate(rows)
        return ErrorVector(values, LABELS, np.ones(values.size))


class PatientUvs(Uvs):
    """The same that goes on until every corner is within 0.3 px, three times the trackers' noise."""

    tolerance_px = 0.3


class TiedUvs(Uvs):
    """The same as `Uvs` with a goal that goes along with the target's marker, shifted as its centre is in
    each picture. That is right for small motions only: a picture also turns and scales what it shows."""

    tied = True


class Learning(ReachWorld):
    """The stereo-impedance mode as it is: it learns where the cameras stand, and watches whether they do."""

    uses = frozenset({"focal"})
    taught = False
    """Whether the wanted place of the tool beside the target is taught through the cameras that the
    controller believes in; otherwise it is the drawing's."""

    def __init__(self, task: Task, trouble: Trouble) -> None:
        config = replace(CONFIG, follow=trouble.carried)
        if trouble.sphere:
            config = replace(config, people_m=PEOPLE_M)
        super().__init__(task, trouble, config)
        if self.taught:
            xyz, rpy = self._taught()
            self.config = self.controller.config = replace(config, offset_xyz=xyz, offset_rpy_deg=rpy)

    def _taught(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Where the tool was beside the target when the goal was shown, by the believed cameras."""
        config = self.config
        tool = marker_pose(self.believed, self.shown["tool"], config.tool_marker_m).T_left_marker
        target = marker_pose(self.believed, self.shown["target"], config.target_marker_m).T_left_marker
        T = np.linalg.inv(target) @ tool @ np.linalg.inv(T_TOOL_MARKER)
        rpy = Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True)
        return tuple(T[:3, 3].tolist()), tuple(rpy.tolist())


class TaughtLearning(Learning):
    """The same, taught by showing."""

    taught = True


class Calibrated(Learning):
    """The same with a place of the cameras that is given once and for all, right or wrong."""

    uses = frozenset({"focal", "hand-eye"})
    blind = False
    """Whether the tool's marker is not looked at: only joints and calibration say where the tool is."""

    def __init__(self, task: Task, trouble: Trouble) -> None:
        super().__init__(task, trouble)
        given = task.left_believed if trouble.hand_eye_deg else task.left
        self.controller.perception = GivenPerception(self.believed, self.config, given, self.blind)


class TaughtCalibrated(Calibrated):
    """The same, taught by showing."""

    taught = True


class Blind(Calibrated):
    """The classic form: the target's place through the given calibration, the tool's by the joints alone."""

    blind = True


METHODS: dict[str, type[ReachWorld]] = {
    "uvs": Uvs,
    "uvs, to 0.3 px": PatientUvs,
    "uvs, goal tied to the target": TiedUvs,
    "stereo, learning, drawn": Learning,
    "stereo, learning, taught": TaughtLearning,
    "stereo, calibrated, drawn": Calibrated,
    "stereo, calibrated, taught": TaughtCalibrated,
    "stereo, calibrated, tool unseen": Blind,
}
