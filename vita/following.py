"""The stereo-impedance mode on a rig: its eyes, its controller, and what it keeps clear of.

The engine asks it for a joint step in place of the servo's. It sees pictures, joint positions, the cameras'
own geometry and the arm's drawing; where the cameras stand it must learn.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from vita import commands as cmd
from vita.errors import BadInput
from vita.impedance.config import ImpedanceConfig
from vita.impedance.controller import ImpedanceController
from vita.impedance.dynamics import Surroundings
from vita.impedance.perception import Seen
from vita.impedance.repulsion import check_balance
from vita.impedance.view import ImpedanceView, Surface
from vita.rig import SimulatedRig
from vita.scenario.schema import CameraSpec, Scenario
from vita.servo.config import Limits
from vita.stereo.base import Lens
from vita.stereo.hull import ArmHull
from vita.stereo.rig_file import load_rig
from vita.stereo.surfaces import surfaces
from vita.types import Array, JointStep, Observation
from vita.vision.marker_pose import marker_pose
from vita.vision.stereo_markers import StereoMarkers
from vita.vision.stereo_rig import stereo_rig_of

LIVE = tuple(f.name for f in fields(ImpedanceConfig) if "low" in f.metadata) + ("turn", "follow", "table_z")
"""Settings that may change while the arm moves."""
RELEARN = ("tool_marker", "target_marker", "tool_marker_m", "target_marker_m", "tool_marker_xyz")
"""Settings without which what was learned is worth nothing."""

HELD_M = 0.18
"""So much about the target's centre belongs to the target and the hand that holds it [m]."""
BLIND_SHARE, BLIND_PICTURES = 0.1, 3
"""A depth picture that could not be measured in more than this share of its pixels shows too little to move
by, and so many of them on end stop the arm: what is not seen is not free."""


@dataclass(frozen=True, eq=False)
class DepthEye:
    """A depth camera that rides with the left camera."""

    name: str
    lens: Lens
    T_left_depth: Array
    """(4, 4)."""
    hull: ArmHull

    def blind(self, depths: Mapping[str, Any]) -> bool:
        """Whether the picture is missing, or unmeasured in too large a part."""
        depth = depths.get(self.name)
        return depth is None or float(np.isnan(depth).mean()) > BLIND_SHARE

    def surface(
        self,
        depths: Mapping[str, Any],
        T_base_left: Array,
        frames: Array,
        target: Array | None,
        table_z: float,
    ) -> Surface:
        """What stands near the arm, without the arm itself, the table, and the target with its hand."""
        starts, ends = self.hull.segments(frames)
        radii = self.hull.radii
        if target is not None:
            centre = target[None, :3, 3]
            starts, ends = np.concatenate([starts, centre]), np.concatenate([ends, centre])
            radii = np.append(radii, HELD_M)
        T_base_depth = T_base_left @ self.T_left_depth
        return Surface(*surfaces(depths[self.name], self.lens, T_base_depth, starts, ends, radii, table_z))


class Following:
    """Raises `BadInput` where the scenario's cameras or robot are not fit for this mode."""

    def __init__(self, rig: SimulatedRig, scenario: Scenario) -> None:
        config = scenario.impedance
        check_balance(config)
        cameras = {spec.name: spec for spec in scenario.camera}
        self._rig = rig
        self._cameras = (config.left, config.right)
        left, right = _camera(cameras, config.left, "left"), _camera(cameras, config.right, "right")
        self._stereo = load_rig(config.rig_file) if config.rig_file else stereo_rig_of(left, right)
        self._markers = self._eyes(config)
        self.controller = ImpedanceController(rig.arm_model(), self._stereo, config)
        self.take_limits()
        self._last: dict[str, Array] = {}
        self._depth = self._depth_camera(cameras, config)
        self._around = Surroundings(())
        self._seen: Observation | None = None
        self._blind_for = 0

    def configure(self, config: ImpedanceConfig, field: str) -> None:
        """Put changed settings in force. Raises `BadInput` where they do not fit together."""
        if field in ("left", "right", "depth", "rig_file"):
            raise BadInput("which cameras are used is set in the file", f"impedance.{field}")
        check_balance(config)
        if field in ("tool_marker", "target_marker"):
            self._markers = self._eyes(config)
        self.controller.config = config
        if field in RELEARN:
            self.controller.forget()

    def take_limits(self) -> None:
        """Plan within the joint limits that are in force."""
        self.controller.take_joints(self._rig.joints)

    def _eyes(self, config: ImpedanceConfig) -> StereoMarkers:
        numbers = {"tool": config.tool_marker, "target": config.target_marker}
        return StereoMarkers(self._stereo, self._cameras, numbers)

    def see(self, seen: Observation) -> None:
        """Find the markers in a new pair of pictures and take them in."""
        self._seen = seen
        config = self.controller.config
        sizes = {"tool": config.tool_marker_m, "target": config.target_marker_m}
        found = self._markers.look(seen.frames)
        sights = {}
        for name, corners in found.items():
            # The target's filter reads the corners themselves and wants a pose only to begin with.
            wanted = name == "tool" or self.controller.perception.target.wants_start(seen.stamp)
            pose = None
            if wanted and corners.seen:
                pose = marker_pose(self._stereo, corners, sizes[name], near=self._last.get(name))
                self._last[name] = pose.T_left_marker
            sights[name] = Seen(corners, pose)
        self.controller.see(seen.stamp, seen.q, sights)
        self._around = self._look_around(seen)

    def _depth_camera(self, cameras: Mapping[str, CameraSpec], config: ImpedanceConfig) -> DepthEye | None:
        """The camera that shows obstacles, if one is named; it must ride with the left camera, because where
        that one stands is all that is learned."""
        if not config.depth:
            return None
        spec, left = _camera(cameras, config.depth, "depth"), cameras[config.left]
        if not spec.depth:
            raise BadInput(f"camera {spec.name!r} measures no depth (depth = true)", "impedance.depth")
        pair = stereo_rig_of(left, spec) if spec is not left else None
        T_left_depth = np.eye(4)
        if pair is not None:
            T_left_depth = np.asarray(np.linalg.inv(pair.T_right_left), dtype=float)
        lens = self._stereo.left if pair is None else pair.right
        return DepthEye(spec.name, lens, T_left_depth, self._rig.arm_hull())

    def _look_around(self, seen: Observation) -> Surroundings:
        """What to keep clear of. Until the cameras' place is known a depth picture says nothing of the base
        frame, and nothing is read into it."""
        if self._depth is None:
            return Surroundings(tuple(self._rig.obstacles()))
        controller = self.controller
        self._blind_for = self._blind_for + 1 if self._depth.blind(seen.depths) else 0
        if self._blind_for >= BLIND_PICTURES and controller.moving:
            controller.halt("depth_blind", culprit=repr(self._depth.name))
        known = controller.perception.estimate
        if known is None:
            return Surroundings(())
        if self._blind_for or controller.perception.moved.suspicious:
            return self._around  # What stood there a moment ago has not gone because it is not seen.
        target = controller.perception.target_in_base(seen.stamp)
        surface = self._depth.surface(
            seen.depths, known.T_base_left, controller.frames, target, controller.config.table_z
        )
        return Surroundings((), surface=surface)

    @property
    def cameras(self) -> frozenset[str]:
        """The cameras without which this mode is blind."""
        config = self.controller.config
        return frozenset(name for name in (config.left, config.right, config.depth) if name)

    def start(self, _: cmd.Start) -> None:
        """Begin to learn where the cameras stand, or to follow."""
        self._rig.release()
        self.controller.start()

    def decide(self, seen: Observation, _: Limits) -> JointStep | None:
        """The next joint step; None when nothing is to move."""
        return self.controller.tick(seen.stamp, seen.q, self._around)

    def view(self) -> ImpedanceView:
        """What the page and recordings show of the last pictures."""
        if self._seen is None:
            return ImpedanceView()
        view = self.controller.view(self._seen.stamp, self._seen.q, self._around)
        return replace(view, corners=self._markers.corners)


def _camera(cameras: Mapping[str, CameraSpec], name: str, side: str) -> CameraSpec:
    if name not in cameras:
        raise BadInput(f"there is no camera {name!r}; choose two of {sorted(cameras)}", f"impedance.{side}")
    return cameras[name]
