"""The seam between vita and a robot with cameras, real or simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from vita.impedance.arm_model import ArmModel
from vita.impedance.view import Capsule
from vita.stereo.hull import ArmHull
from vita.types import Array, Joint, JointStep, Observation, Visual


@runtime_checkable
class Rig(Protocol):
    """An arm and its cameras. Whoever implements it keeps the gate between `command` and the arm."""

    @property
    def joints(self) -> Sequence[Joint]:
        """The joints with the limits in force."""
        ...

    @property
    def robot_joints(self) -> Sequence[Joint]:
        """The joints with the robot's own limits, which nothing widens."""
        ...

    @property
    def cameras(self) -> Sequence[str]:
        """Camera names, in the order in which people see them."""
        ...

    def observe(self) -> Observation:
        """The next observation. Lockstep simulation advances one frame period, a live rig waits.

        A camera that gives no picture is left out of its frames. Raises `RigOffline` when nothing comes. A
        rig that must be told to try such a camera again has a method `reopen(camera)` besides, which returns
        at once.
        """
        ...

    def command(self, step: JointStep | None) -> None:
        """Ask for a motion; None asks the arm to brake and hold still."""
        ...

    def set_limits(self, joints: Sequence[Joint], acceleration: float | None = None) -> None:
        """Put new joint limits, and an acceleration bound [rad/s^2], in force from the next gate
        cycle on."""
        ...

    def gate_state(self) -> Mapping[str, object]:
        """What the gate says: `fault` (a sentence, empty while all is well), `saturated` (indices of
        joints held by a limit), `dropped` (steps refused), `stopped`, `at_rest`."""
        ...

    def stop_now(self) -> None:
        """Brake and stay, from any thread, before anything else; until `release`."""
        ...

    def release(self) -> None:
        """Let steps move the arm again after `stop_now` or a gate fault. Moves nothing itself."""
        ...

    def close(self) -> None: ...


@runtime_checkable
class SimulatedRig(Rig, Protocol):
    """What a simulation adds: ground truth for judging and a way to disturb the scene.

    Ground truth serves scenario files (`attach`, `expect`) and `projected` trackers only; the
    servo never sees it.
    """

    def poses(self) -> Mapping[str, Array]:
        """Body name to (4, 4) T_world_body at the last observation: robot links (`base`, `link1`,
        ..., `flange`, `tool`), objects by name, `world`, and cameras as `camera:NAME` (looking
        along +z, x right, y down)."""
        ...

    def poses_at(self, q: Array) -> Mapping[str, Array]:
        """Body name to (4, 4) T_world_body of the robot's links, were the joints at `q` (n,) [rad]."""
        ...

    def arm_model(self) -> ArmModel:
        """The arm's kinematics as its drawing gives them: what a controller of this robot may know."""
        ...

    def arm_hull(self) -> ArmHull:
        """Capsules that enclose the arm, its tool and what it carries, as their drawings give them."""
        ...

    def obstacles(self) -> Sequence[Capsule]:
        """People and obstacles at the last observation as thick segments, as a safety scanner would report
        them."""
        ...

    def visuals(self) -> Sequence[Visual]:
        """The meshes of the scene, for a 3D view."""
        ...

    def project(self, camera: str, body: str, point: Sequence[float]) -> Array:
        """(2,) pixel at which a point fixed to `body` is seen now [px]."""
        ...

    def distance(self, camera: str, body: str, point: Sequence[float]) -> float:
        """Distance of a point fixed to `body` from the camera's centre [m]."""
        ...

    def locate(self, body: str, point: Sequence[float]) -> Array:
        """(3,) world position of a point fixed to `body` [m]."""
        ...

    def perform(self, action: str, **arguments: object) -> None:
        """Carry out a script action: move_camera, freeze_camera, drag_target, push_robot, cover, ...

        Raises `BadInput` on an unknown action or argument.
        """
        ...

    def hard_reset(self, q: np.ndarray) -> None:
        """Put the arm at `q` [rad] at rest at once (simulation only), e.g. back to the start."""
        ...
