"""What this mode knows of tool, target and cameras: a filter, the on-line calibration, and its watch.

The target's place relative to the tool is what the pictures say, and is only turned into the base frame by
the learned rotation (TUM eq. 17): a bias that both markers share cancels, and a wrong rotation bends the way
to the target but not its end. Of the tool only a slow mean of the difference between where it is seen and
where joints and calibration put it is used, so that its quick motion comes from the joints, without noise or
lag.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vita.impedance.config import ImpedanceConfig
from vita.impedance.dynamics import Goal
from vita.poses import pose_matrix
from vita.stereo.base import BaseFromCamera, MarkerCorners, PoseSight, StereoRig
from vita.stereo.moved_rig import MovedRig
from vita.stereo.online_calibration import OnlineCalibration
from vita.stereo.pose_filter import PoseFilter
from vita.types import Array

BRIDGED_S = 0.4
"""A target that was not seen for so long is no longer followed [s]."""
BIAS_S = 0.3
"""Time over which the difference between the tool as seen and as calculated is averaged [s]."""
LONGEST_S = 0.1
"""After a gap the mean moves on as over this time, however long it was [s]."""


@dataclass(frozen=True, eq=False)
class Seen:
    """One marker in one pair of pictures."""

    corners: MarkerCorners
    pose: PoseSight | None
    """Its pose from these pictures alone; None where no camera sees it."""


class Perception:
    """Updated with every pair of pictures, whether or not the arm moves."""

    def __init__(self, rig: StereoRig, config: ImpedanceConfig) -> None:
        self._rig = rig
        self.calibration = OnlineCalibration()
        self._watched: tuple[float, int] = (np.nan, 0)
        self._goals: dict[tuple[float, float], Goal | None] = {}
        self.configure(config)
        self.forget()

    def configure(self, config: ImpedanceConfig) -> None:
        """Put settings in force."""
        watched = config.moved_mm, config.moved_frames
        if watched != self._watched:
            self._watched, self.moved = watched, MovedRig(1e-3 * config.moved_mm, config.moved_frames)
        self.config = config
        self._goals = {}
        self._T_tool_marker = pose_matrix(config.tool_marker_xyz, config.tool_marker_rpy_deg)
        self._T_target_goal = pose_matrix(config.offset_xyz, config.offset_rpy_deg)

    def forget(self) -> None:
        """Forget what was seen, and where the cameras stand."""
        self.target = PoseFilter(self._rig, self.config.target_marker_m)
        self._tool_stamp = -np.inf
        self.forget_cameras()

    def forget_cameras(self) -> None:
        """The cameras stand elsewhere: pairs from before are worth nothing."""
        self.calibration.restart()
        self.moved.restart()
        self._goals = {}
        self.tool_seen: Array | None = None
        self._in_sight, self._bias = False, np.zeros(3)

    @property
    def ready(self) -> bool:
        """Whether both cameras see the tool and nobody moves them."""
        return self._in_sight and self.moved.settled

    @property
    def estimate(self) -> BaseFromCamera | None:
        """Where the left camera stands; None before it is known."""
        return self.calibration.estimate

    # ---- every pair of pictures ------------------------------------------------------------------

    def see(self, stamp: float, T_base_tool: Array, seen: Mapping[str, Seen]) -> bool:
        """Take in one pair of pictures; True when the cameras have been moved since the last ones.

        T_base_tool: (4, 4) by the joints, at `stamp`. seen: `tool`, `target` to what was seen of it.
        """
        self._goals = {}
        target = seen.get("target")
        if target is not None and target.corners.seen:
            self.target.update(stamp, target.corners, target.pose)
        x_base = (T_base_tool @ self._T_tool_marker)[:3, 3]
        sight = seen.get("tool")
        both = sight is not None and sight.corners.left is not None and sight.corners.right is not None
        if sight is None or sight.pose is None or not both:
            self._in_sight, self.tool_seen = False, None
            return self.moved.update(None)
        x_left = sight.pose.T_left_marker[:3, 3]
        span = min(stamp - self._tool_stamp, LONGEST_S)
        self._in_sight, self._tool_stamp = True, stamp
        self.moved.watch(stamp, x_base, x_left)
        covariance = sight.pose.covariance[:3, :3]
        known = self.estimate
        if known is None:
            self.tool_seen = None
            self.calibration.add(stamp, x_base, x_left, covariance)
            return False
        R = known.T_base_left[:3, :3]
        self.tool_seen = moved(known.T_base_left, x_left)
        residual, spread = self.tool_seen - x_base, self.calibration.spread_at(x_base)
        if self.moved.update(residual, R @ covariance @ R.T, spread):
            return True
        off = x_left - R.T @ (x_base - known.T_base_left[:3, 3])
        self._bias += span / BIAS_S * (off - self._bias)
        if not self.moved.suspicious:
            self.calibration.add(stamp, x_base, x_left, covariance)
        return False

    # ---- what follows from it --------------------------------------------------------------------

    def tool_hidden_s(self, stamp: float) -> float:
        """Time since both cameras last saw the tool [s]."""
        return stamp - self._tool_stamp

    def target_age(self, stamp: float) -> float:
        """Time since the target was last seen [s]."""
        found = self.target.at(stamp)
        return np.inf if found is None else found.age_s

    def goal(self, stamp: float, later: float) -> Goal | None:
        """Where the tool is to be at the time `later`, judged by the pictures of `stamp`; None while the
        target, or where the cameras stand, is not known."""
        asked = stamp, later
        if asked not in self._goals:  # Control, verdict and page ask for the same.
            self._goals[asked] = self._goal(stamp, later)
        return self._goals[asked]

    def _goal(self, stamp: float, later: float) -> Goal | None:
        known, target, ahead = self.estimate, self.target.at(stamp), self.target.at(later)
        if known is None or target is None or ahead is None or target.age_s > BRIDGED_S:
            return None
        R, t = known.T_base_left[:3, :3], known.T_base_left[:3, 3]
        T_left_goal = ahead.T_left_marker @ self._T_target_goal
        T = np.eye(4)
        T[:3, :3] = R @ T_left_goal[:3, :3]
        T[:3, 3] = R @ (T_left_goal[:3, 3] - self._bias) + t
        arm = T_left_goal[:3, 3] - ahead.T_left_marker[:3, 3]
        velocity = ahead.velocity + np.cross(ahead.turn_rate, arm)
        return Goal(T, R @ velocity, R @ ahead.turn_rate)

    def target_in_base(self, stamp: float) -> Array | None:
        """(4, 4) the target's marker in the base frame; None while it or the cameras are not known."""
        known, found = self.estimate, self.target.at(stamp)
        return None if known is None or found is None else known.T_base_left @ found.T_left_marker

    def errors(self, stamp: float, T_base_tool: Array) -> tuple[float, float]:
        """Distance [m] and angle [rad] between the tool and its goal as the pictures show them; NaN if not
        known."""
        goal = self.goal(stamp, stamp)
        if goal is None:
            return np.nan, np.nan
        turn = goal.T_base_tool[:3, :3] @ T_base_tool[:3, :3].T
        gap = goal.T_base_tool[:3, 3] - T_base_tool[:3, 3]
        return float(np.linalg.norm(gap)), float(Rotation.from_matrix(turn).magnitude())

    def marker_by_joints(self, T_base_tool: Array) -> Array:
        """(3,) the centre of the tool's marker in the base frame."""
        return (T_base_tool @ self._T_tool_marker)[:3, 3]


def moved(T: Array, point: Array) -> Array:
    """(3,) the point in the frame that T (4, 4) leads to."""
    return T[:3, :3] @ point + T[:3, 3]


