"""The second mode as a state machine: one call per pair of pictures, no thread, no clock, no robot.

Start learns where the cameras stand by a small motion, unless that is known, and then lets a virtual mass be
drawn to the target (TUM III). The mass runs two frame periods ahead of the pictures, so that the arm is
always on its way to where the mass will be and its motion flows from one step into the next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vita.impedance.arm_model import ArmModel
from vita.impedance.config import ImpedanceConfig
from vita.impedance.dynamics import Goal, Motion, Surroundings, VirtualImpedance
from vita.impedance.perception import BRIDGED_S, Perception, Seen
from vita.impedance.view import ImpedanceView, Phase
from vita.impedance.wiggle import Wiggle
from vita.servo.reasons import status_for
from vita.stereo.base import StereoRig
from vita.types import MOVING_STATES, Array, Joint, JointStep, Status

AHEAD_S = 2 / 30
"""How far the mass runs ahead of the pictures [s]."""
LONGEST_S = 0.1
"""The mass never moves on by more than this at once, however long no picture came [s]."""
SURE_DEG = 0.5
"""The calibration motion ends when the rotation is known this well [deg]."""
LOOK_S = 5.0
"""How long to look for the tool's marker before giving up [s]."""
HIDDEN_S = 1.0
"""A tool that was not seen for so long is not moved on: nobody could tell whether the cameras stand [s]."""
RETREAT_S = 1.5
"""A target that has been out of sight for longer may be covered by the arm itself, which then goes back to
where it was when the target was seen last [s]."""
GONE_M, BACK_M = 0.02, 0.002
"""It goes back when it has moved further than the first, and until it is nearer than the second [m]."""
STILL_S = 0.5
"""The tool must have kept to its goal for so long to be done [s]."""


class ImpedanceController:
    """Follows the target with the tool."""

    def __init__(
        self, arm: ArmModel, rig: StereoRig, config: ImpedanceConfig, radii: Array | None = None
    ) -> None:
        self.arm = arm
        self.perception = Perception(rig, config)
        self.impedance = VirtualImpedance(arm, config, radii)
        self.status = Status()
        self.progress = ""
        self.phase: Phase = "idle"
        self.notice = ""
        """Something that people should be told once; whoever reads it clears it."""
        self._config = config
        self._wiggle: Wiggle | None = None
        self._motion: Motion | None = None
        self._seen: Mapping[str, Seen] = {}
        self._begin: float | None = None
        self._last = -np.inf
        self._since = 0.0
        self._arrived: float | None = None
        self._sighted: Array | None = None
        self._retreating = False
        self._q: Array | None = None
        self.frames: Array = arm.frames(np.zeros(arm.n))
        """(n + 1, 4, 4) of the arm at the last pictures, the tool's last."""

    # ---- what people can ask -------------------------------------------------------------------

    @property
    def moving(self) -> bool:
        return self.status.state in MOVING_STATES

    @property
    def config(self) -> ImpedanceConfig:
        return self._config

    @config.setter
    def config(self, config: ImpedanceConfig) -> None:
        self._config = self.impedance.config = config
        self.perception.configure(config)

    def take_joints(self, joints: Sequence[Joint]) -> None:
        """Plan within these joint limits."""
        self.arm = replace(self.arm, joints=tuple(joints))
        self.impedance.take(self.arm)

    def start(self) -> None:
        """Learn where the cameras stand, if that is not known, then follow."""
        self._begin, self._wiggle, self._arrived, self._motion = None, None, None, None
        self._sighted = None
        if self.perception.estimate is None:
            self._to_looking()
        else:
            self._to_following()

    def halt(self, reason: str, **facts: object) -> None:
        """Leave motion for the state that `reason` leads to; a fault is not overwritten."""
        if self.status.state != "fault":
            self.status = status_for(reason, **facts)
        self.progress, self.phase, self._wiggle = "", "idle", None

    def acknowledge(self) -> None:
        """Leave a fault for idle. Moves nothing."""
        if self.status.state == "fault":
            self.status = Status()

    def forget(self) -> None:
        """Forget where the cameras stand, and everything that was seen."""
        self.perception.forget()
        self._motion = None

    # ---- every pair of pictures ------------------------------------------------------------------

    def see(self, stamp: float, q: Array, seen: Mapping[str, Seen]) -> None:
        """Take in what two pictures taken at `stamp` show of tool and target; q (n,) was measured then."""
        self._seen, self._q, self.frames = seen, q, self.arm.frames(q)
        if not self.perception.see(stamp, self.frames[-1], seen):
            return
        self.perception.forget_cameras()
        self.notice = "The cameras have been moved. The arm learns anew where they stand."
        if self.moving:
            self._begin, self._wiggle = None, None
            self._to_looking("cameras_moved")

    def tick(self, stamp: float, q: Array, around: Surroundings) -> JointStep | None:
        """The next joint step, after `see` of the same pictures; None when nothing is to move."""
        if not self.moving:
            return None
        if self._begin is None:
            self._begin = self._since = stamp
            self._last = stamp - LONGEST_S
        if self._motion is None:
            self.impedance.reset(q)
        span = float(np.clip(stamp - self._last, 0.0, LONGEST_S))
        self._last = stamp
        self.impedance.pull_back(q)
        goal = self._goal(stamp, stamp + AHEAD_S - span)
        if not self.moving:
            return None
        self._motion = self.impedance.advance(span, goal, around)
        self.progress = self._motion.limited
        return JointStep(self._motion.q - q, q, stamp, arrive_s=AHEAD_S)

    def _goal(self, stamp: float, now: float) -> Goal | None:
        if self.phase == "looking":
            return self._look(stamp)
        if self.phase == "calibrating":
            return self._calibrate(stamp, now)
        return self._follow(stamp, now)

    def _look(self, stamp: float) -> None:
        """Wait until both cameras see the tool and nobody moves them any more; nothing moves meanwhile."""
        assert self._begin is not None
        if self.perception.ready:
            # What was seen before may be from another place of the cameras.
            self.perception.forget_cameras()
            self.phase = "calibrating"
            self.status = Status("learning", self.status.reason, "Learning where the cameras stand.")
            self._wiggle = Wiggle(self.frames[-1], self._config.wiggle_m, stamp)
            return
        limit = self._config.patience_s if self.status.reason else LOOK_S
        if stamp - self._begin > limit:
            self.halt("tool_unseen", culprit=self._hidden("tool"))

    def _calibrate(self, stamp: float, now: float) -> Goal | None:
        assert self._wiggle is not None
        known = self.perception.estimate
        if known is not None and known.rotation_sd_deg < SURE_DEG and self._wiggle.progress >= 0.6:
            self._to_following()
            self._since = stamp  # Time that went into looking for the cameras does not count as waiting.
            return self._follow(stamp, now)
        if self._wiggle.over:
            self.halt("not_calibrated", culprit=self._hidden("tool"))
            return None
        return self._wiggle.goal(stamp, self.frames[-1][:3, 3])

    def _follow(self, stamp: float, now: float) -> Goal | None:
        goal, unseen = self.perception.goal(stamp, now), "target"
        if self.perception.tool_hidden_s(stamp) > HIDDEN_S:
            goal, unseen = None, "tool"
        if goal is not None:
            if self.phase == "waiting":
                self._to_following()
            self._since, self._sighted = stamp, self.frames[-1].copy()
            self._check_done(stamp)
            return goal
        if self.phase != "waiting" and stamp - self._since > BRIDGED_S / 2:
            self.phase = "waiting"
            words = status_for("target_waiting", culprit=self._hidden(unseen))
            self.status = Status("servoing", words.reason, words.message, degraded=True)
        if stamp - self._since > self._config.patience_s:
            self.halt("target_unseen", culprit=self._hidden(unseen), timeout=self._config.patience_s)
        self._arrived = None
        return self._retreat(stamp) if unseen == "target" else None

    def _retreat(self, stamp: float) -> Goal | None:
        """Back to where the tool was when the target was seen last: an arm that gave way to somebody may have
        come to stand between target and cameras, and nobody else would end that."""
        if self._sighted is None or stamp - self._since < RETREAT_S or not self.moving:
            self._retreating = False
            return None
        gone = float(np.linalg.norm(self.frames[-1][:3, 3] - self._sighted[:3, 3]))
        # An arm that has hardly moved covers nothing that it did not cover before, and stays where it is.
        self._retreating = gone > (BACK_M if self._retreating else GONE_M)
        return Goal(self._sighted, np.zeros(3), np.zeros(3)) if self._retreating else None

    def _check_done(self, stamp: float) -> None:
        config = self._config
        if config.follow:
            return
        assert self._begin is not None
        gap, angle = self.perception.errors(stamp, self.frames[-1])
        turned = not self.impedance.turns or np.degrees(angle) <= config.done_deg
        if not (1e3 * gap <= config.done_mm and turned):
            self._arrived = None
            if stamp - self._begin > config.timeout_s:
                self.halt("timeout_mm", timeout=config.timeout_s, error=1e3 * gap)
            return
        self._arrived = stamp if self._arrived is None else self._arrived
        if stamp - self._arrived >= STILL_S:
            self.halt("arrived", error=1e3 * gap, tolerance=config.done_mm)

    def _to_looking(self, reason: str = "") -> None:
        self.phase = "looking"
        message = status_for(reason).message if reason else "Looking for the tool's marker in both views."
        self.status = Status("learning", reason, message)

    def _to_following(self) -> None:
        self.phase, self._wiggle = "following", None
        self.status = Status("servoing", "", "Following the target.")

    def _hidden(self, name: str) -> str:
        """Which cameras do not see a marker, in words."""
        number = self._config.tool_marker if name == "tool" else self._config.target_marker
        seen = self._seen.get(name)
        sides = [
            camera
            for camera, corners in (
                (self._config.left, seen.corners.left if seen else None),
                (self._config.right, seen.corners.right if seen else None),
            )
            if corners is None
        ]
        where = f"is not seen by {' and '.join(repr(side) for side in sides)}"
        if not sides:
            where = "is seen, but does not stay where it is: the cameras seem to move"
        return f"the {name}'s marker {number} {where}"

    # ---- what everybody sees -------------------------------------------------------------------

    def view(self, stamp: float, q: Array, around: Surroundings) -> ImpedanceView:
        """What the page and recordings show, at the pictures of `stamp`."""
        perception, motion = self.perception, self._motion
        T_base_tool = self.frames[-1] if q is self._q else self.arm.pose(q)
        known = perception.estimate
        gap, angle = perception.errors(stamp, T_base_tool)
        goal = perception.goal(stamp, stamp)
        return ImpedanceView(
            phase=self.phase,
            T_base_left=None if known is None else known.T_base_left,
            calibration_mm=np.nan if known is None else 1e3 * known.rms_m,
            pairs=len(perception.calibration),
            tool_fk=perception.marker_by_joints(T_base_tool),
            tool_seen=perception.tool_seen,
            T_base_target=perception.target_in_base(stamp),
            target_age_s=perception.target_age(stamp),
            T_base_goal=None if goal is None else goal.T_base_tool,
            T_base_mass=None if motion is None else motion.T_base_mass,
            forces={} if motion is None or not self.moving else motion.forces,
            distances={} if motion is None else motion.distances,
            energy_j=0.0 if motion is None else motion.energy_j,
            error_mm=1e3 * gap,
            error_deg=float(np.degrees(angle)),
            obstacles=around.capsules,
            surface=around.surface,
        )
