"""A world for the stereo-impedance experiments: exact kinematics behind the real gate, markers as noisy
corners instead of pictures.

It runs some twenty times faster than drawing, so that hundreds of runs are possible; the scenarios run the
same controller on rendered pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vita.impedance.arm_model import ArmModel
from vita.impedance.config import ImpedanceConfig
from vita.impedance.controller import ImpedanceController
from vita.impedance.dynamics import Surroundings
from vita.impedance.perception import Seen
from vita.impedance.view import Capsule
from vita.poses import pose_matrix
from vita.servo.gate import Gate
from vita.stereo.base import Lens, MarkerCorners, StereoRig, marker_square
from vita.stereo.projection import project
from vita.types import Array
from vita.vision.marker_pose import marker_pose

FRAME_S, CYCLES = 1 / 30, 8
SIZE_PX = (640, 480)
STEEPEST = np.cos(np.radians(75.0))
"""A marker that is seen more from the side than this is not recognised."""

Path = Callable[[float], Array]
"""Time [s] to a (4, 4) pose in the base frame."""


def stereo_rig(focal_px: float = 515.0, baseline_m: float = 0.2) -> StereoRig:
    """Two parallel cameras side by side, as on the tripod."""
    lens = Lens(focal_px, focal_px, 0.5 * (SIZE_PX[0] - 1), 0.5 * (SIZE_PX[1] - 1))
    T = np.eye(4)
    T[0, 3] = -baseline_m
    return StereoRig(lens, lens, T)


@dataclass
class Truth:
    """What happens around the arm."""

    target: Path
    """The target's marker."""
    left: Path
    """The left camera (T_base_left)."""
    obstacles: Callable[[float], Sequence[Capsule]] = field(default=lambda now: ())
    hidden: Callable[[float], bool] = field(default=lambda now: False)
    """Whether something stands between the cameras and the target."""
    rig: StereoRig = field(default_factory=stereo_rig)
    """The cameras as they are; the controller may believe in others."""


class StereoWorld:
    """The arm, its gate and the controller in lockstep, a pair of pictures at a time."""

    def __init__(
        self,
        arm: ArmModel,
        q0: Array,
        truth: Truth,
        config: ImpedanceConfig,
        *,
        sigma_px: float = 0.1,
        seed: int = 0,
        speed_rad_s: float = 1.5,
        believed: StereoRig | None = None,
        radii: Array | None = None,
    ) -> None:
        """sigma_px: noise of every corner coordinate. believed: the cameras as the controller knows them."""
        joints = tuple(replace(joint, max_speed=min(joint.max_speed, speed_rad_s)) for joint in arm.joints)
        self.arm, self.truth, self.config = replace(arm, joints=joints), truth, config
        self.q = np.array(q0, dtype=float)
        self.now = 0.0
        self._gate = Gate(joints)
        self._gate.reset(self.q)
        self._sigma, self._noise = sigma_px, np.random.default_rng(seed)
        self.believed = truth.rig if believed is None else believed
        self.controller = ImpedanceController(self.arm, self.believed, config, radii)
        self.T_tool_marker = pose_matrix(config.tool_marker_xyz, config.tool_marker_rpy_deg)
        self.T_target_goal = pose_matrix(config.offset_xyz, config.offset_rpy_deg)

    # ---- one pair of pictures --------------------------------------------------------------------

    def tick(self) -> None:
        """See, decide, and let 1/30 s pass."""
        around = Surroundings(tuple(self.truth.obstacles(self.now)))
        self.controller.see(self.now, self.q.copy(), self.look())
        step = self.controller.tick(self.now, self.q.copy(), around)
        self._gate.command(step, self.now)
        for _ in range(CYCLES):
            self.q, _ = self._gate.cycle(self.now, self.q)
            self.now += FRAME_S / CYCLES
        self.now = round(self.now * 30) / 30

    def look(self) -> dict[str, Seen]:
        """What the pictures of now show of tool and target."""
        T_base_tool = self.arm.pose(self.q)
        config = self.config
        markers = {
            "tool": (T_base_tool @ self.T_tool_marker, config.tool_marker_m, False),
            "target": (self.truth.target(self.now), config.target_marker_m, self.truth.hidden(self.now)),
        }
        seen = {}
        for name, (T_base_marker, size, hidden) in markers.items():
            corners = MarkerCorners(None, None, self._sigma) if hidden else self._corners(T_base_marker, size)
            pose = marker_pose(self.believed, corners, size) if corners.seen else None
            seen[name] = Seen(corners, pose)
        return seen

    def _corners(self, T_base_marker: Array, size_m: float) -> MarkerCorners:
        """The corners in both pictures, None in one where the marker is out of view or seen from the side."""
        rig = self.truth.rig
        T_left_marker = np.linalg.inv(self.truth.left(self.now)) @ T_base_marker
        found: list[Array | None] = []
        for lens, T in ((rig.left, np.eye(4)), (rig.right, rig.T_right_left)):
            T_camera_marker = T @ T_left_marker
            points = marker_square(size_m) @ T_camera_marker[:3, :3].T + T_camera_marker[:3, 3]
            centre = T_camera_marker[:3, 3]
            facing = -(T_camera_marker[:3, 2] @ centre) / np.linalg.norm(centre) > STEEPEST
            pixels = project(lens, points)
            inside = bool((pixels > 2).all() and (pixels < np.array(SIZE_PX) - 3).all())  # NaN is not.
            noisy = pixels + self._sigma * self._noise.standard_normal(pixels.shape)
            found.append(noisy if facing and inside else None)
        return MarkerCorners(found[0], found[1], max(self._sigma, 0.02))

    # ---- truth -----------------------------------------------------------------------------------

    def goal(self) -> Array:
        """(4, 4) where the tool should be now."""
        return self.truth.target(self.now) @ self.T_target_goal

    def gap(self) -> tuple[Array, float]:
        """The tool's offset from its goal (3,) [m], and the angle between them [rad]."""
        is_, wanted = self.arm.pose(self.q), self.goal()
        cosine = 0.5 * (np.trace(wanted[:3, :3].T @ is_[:3, :3]) - 1.0)
        return is_[:3, 3] - wanted[:3, 3], float(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def recovered(self) -> float:
        """Distance between the tool's marker and where the learned calibration puts it [m]; NaN if unseen."""
        seen = self.controller.perception.tool_seen
        truth = (self.arm.pose(self.q) @ self.T_tool_marker)[:3, 3]
        return np.nan if seen is None else float(np.linalg.norm(seen - truth))
