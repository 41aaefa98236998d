"""What both simulated rigs tell about the scene, whichever process its physics is in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Self

from vita.impedance.arm_model import ArmModel
from vita.impedance.view import Capsule
from vita.scenario.schema import Scenario
from vita.sim.arm_hull import scene_hull
from vita.sim.obstacles import obstacle_capsules
from vita.sim.robots import RobotModel
from vita.sim.truth import GroundTruth
from vita.stereo.hull import ArmHull
from vita.types import Array, Visual


class SceneRig:
    """Ground truth of the last observation, and what the drawings give."""

    _model: RobotModel
    _visuals: tuple[Visual, ...]

    def __init__(self, scenario: Scenario) -> None:
        self.cameras: tuple[str, ...] = tuple(spec.name for spec in scenario.camera)
        self._truth = GroundTruth(scenario.camera)
        self._scene = scenario.scene

    def poses(self) -> Mapping[str, Array]:
        """Ground truth at the last observation: body name to (4, 4) T_world_body."""
        return self._truth.poses

    def poses_at(self, q: Array) -> Mapping[str, Array]:
        """Where the robot's links would be at joints `q` (n,) [rad]."""
        return self._model.poses(q)

    def arm_model(self) -> ArmModel:
        """The arm's kinematics as its drawing gives them."""
        return self._model.arm_model()

    def arm_hull(self) -> ArmHull:
        """What arm, tool and what they carry take up, as their drawings give it; takes a moment."""
        return scene_hull(self._model, self._scene)

    def obstacles(self) -> Sequence[Capsule]:
        """People and obstacles at the last observation as thick segments."""
        return obstacle_capsules(self._scene.objects, self._truth.poses)

    def visuals(self) -> Sequence[Visual]:
        """The meshes of the scene."""
        return self._visuals

    def project(self, camera: str, body: str, point: Sequence[float]) -> Array:
        """(2,) pixel at which a point of `body` was seen at the last observation [px]."""
        return self._truth.project(camera, body, point)

    def distance(self, camera: str, body: str, point: Sequence[float]) -> float:
        """Distance of a point of `body` from a camera at the last observation [m]."""
        return self._truth.distance(camera, body, point)

    def locate(self, body: str, point: Sequence[float]) -> Array:
        """(3,) where a point of `body` was at the last observation [m]."""
        return self._truth.locate(body, point)

    def close(self) -> None:
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
