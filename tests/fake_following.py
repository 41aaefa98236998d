"""A fake runner in the stereo-impedance mode: what the page is to show is put into `view` by hand."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from fake_runner import FakeRunner

from vita import commands as c
from vita.impedance.view import Capsule, ImpedanceView
from vita.scenario.schema import CameraSpec, ObjectSpec, Scenario, SceneSpec
from vita.snapshot import Snapshot
from vita.types import Array, Status, Visual, frozen

PLACES = {"target": (0.55, 0.25, 0.45), "human": (0.2, 0.8, 0.0), "tripod": (1.4, -0.5, 0.0)}
"""Where the movable things of the fake scene stand [m]."""
DOWN = np.diag([1.0, -1.0, -1.0])


def placed(xyz: Any, rotation: np.ndarray | None = None) -> Array:
    """(4, 4) pose from a position [m] and a rotation."""
    T = np.eye(4)
    T[:3, 3] = xyz
    if rotation is not None:
        T[:3, :3] = rotation
    return T


def turned(axis: int, angle_deg: float) -> np.ndarray:
    """(3, 3) rotation about x, y or z."""
    angle, (i, j) = np.radians(angle_deg), [(1, 2), (2, 0), (0, 1)][axis]
    R = np.eye(3)
    R[i, i] = R[j, j] = np.cos(angle)
    R[j, i], R[i, j] = np.sin(angle), -np.sin(angle)
    return R


def camera_at(place: Any, target: Any) -> Array:
    """(4, 4) pose of a camera: it looks along +z, x right, y down."""
    z = np.asarray(target, float) - place
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return placed(place, np.stack([x, np.cross(z, x), z], axis=1))


def stereo_scene(mode: str = "impedance") -> Scenario:
    """Two cameras on a tripod, a target, a human, and a card that the tool carries."""
    return Scenario(
        title="Follow the target",
        mode=mode,
        scene=SceneSpec(
            objects=(
                ObjectSpec("human", "person", PLACES["human"]),
                ObjectSpec("label", "card", mount="tool"),
                ObjectSpec("tripod", "tripod", PLACES["tripod"]),
                ObjectSpec("target", "target", PLACES["target"]),
            )
        ),
        camera=(
            CameraSpec("left", mount="tripod", xyz=(0, -0.1, 1.2)),
            CameraSpec("right", mount="tripod", xyz=(0, 0.1, 1.2)),
        ),
    )


def true_poses() -> dict[str, Array]:
    """Where everything stands at first."""
    poses = {name: placed(xyz) for name, xyz in PLACES.items()}
    poses |= {"base": np.eye(4), "link1": placed((0, 0, 0.4)), "tool": placed((0.5, 0.2, 0.5), DOWN)}
    for name, side in (("left", -0.1), ("right", 0.1)):
        poses[f"camera:{name}"] = camera_at((1.4 + side * 0.4, -0.5 + side, 0.9), (0.5, 0.1, 0.35))
    return poses


def a_view(**changes: Any) -> ImpedanceView:
    """Following, a little behind the target, with the table and the human pushing."""
    square = np.array([[-20, -20], [20, -20], [20, 20], [-20, 20]], float)
    corners = {
        (camera, marker): frozen(square + at)
        for camera, marker, at in (
            ("left", "tool", (250, 220)), ("right", "tool", (300, 230)), ("left", "target", (380, 260)),
            ("right", "target", (430, 250)),
        )
    }
    poses = true_poses()
    view = ImpedanceView(
        phase="following",
        T_base_left=poses["camera:left"] @ placed((0.004, 0.0, 0.002)),
        calibration_mm=2.1,
        pairs=14,
        tool_fk=frozen([0.5, 0.2, 0.44]),
        tool_seen=frozen([0.502, 0.199, 0.441]),
        T_base_target=placed(PLACES["target"], turned(1, 20.0)),
        target_age_s=0.01,
        T_base_goal=placed((0.55, 0.25, 0.60), DOWN),
        T_base_mass=placed((0.5, 0.2, 0.5), DOWN),
        forces={"target": frozen([4.0, 4.0, 7.0]), "people": frozen([1.0, -4.0, 0.0])},
        distances={"table": 0.5, "base": 0.54, "people": 0.12, "singularity": 41.0},
        error_mm=12.3,
        error_deg=0.84,
        corners=corners,
        obstacles=(Capsule("human", frozen([0.2, 0.7, 0.2]), frozen([0.2, 0.7, 1.1]), 0.12),),
    )
    return replace(view, **changes)


def a_snapshot(view: ImpedanceView | None = None, status: Status | None = None, **changes: Any) -> Snapshot:
    """A snapshot of this mode without a runner."""
    return Snapshot(
        tick=1, stamp=1.0, status=status or Status("servoing"), q=frozen(np.zeros(4)), joints=(), frames={},
        features={}, scenario=changes.pop("scenario", stereo_scene()), poses=true_poses(),
        impedance=view or a_view(), **changes,
    )


class FakeFollowing(FakeRunner):
    """Objects go at once where they are asked to be; Start only changes the state."""

    def __init__(
        self, scenario: Scenario | None = None, pictures: dict[str, np.ndarray] | None = None
    ) -> None:
        self.view = a_view()
        self.true = true_poses()
        super().__init__(scenario or stereo_scene(), pictures=pictures)

    def visuals(self) -> list[Visual]:
        base = super().visuals()
        box = base[0]
        unit = np.asarray(box.vertices) / np.abs(box.vertices).max(axis=0)
        sizes = {"target": (0.06, 0.06, 0.004), "human": (0.12, 0.12, 0.5), "tripod": (0.04, 0.04, 0.6)}
        raised = {"target": 0.0, "human": 0.5, "tripod": 0.6}
        things = [
            Visual(name, unit * size + [0, 0, raised[name]], box.faces, box.normals, (0.45, 0.6, 0.75))
            for name, size in sizes.items()
        ]
        return [*base, *things]

    def _apply(self, cmd: object) -> None:
        if isinstance(cmd, c.SetMode):
            self._edit(mode=cmd.mode)
        elif isinstance(cmd, c.SetImpedance):
            self._edit(impedance=replace(self.scenario.impedance, **{cmd.field: cmd.value}))
        elif isinstance(cmd, c.Perform):
            arguments: dict[str, Any] = cmd.arguments
            self.true[arguments["object"]] = placed(arguments["xyz"])
        elif isinstance(cmd, c.Start) and self.scenario.mode == "impedance":
            self._status = Status("servoing")
        else:
            super()._apply(cmd)

    def _make(self) -> Snapshot:
        self._start = time.monotonic()  # It goes on until somebody stops it.
        return replace(super()._make(), poses=dict(self.true), impedance=self.view)
