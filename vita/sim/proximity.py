"""How near the arm is to what it must not touch: the scene's things, the table, people, and itself.

The arm's links are capsules around their meshes, things are boxes around theirs, people and balls the
capsules that enclose them; all of that is a little larger than what is drawn. Some of it is meant to touch:
what is on the flange (the tool and what it carries) touches things, the base stands on the table, and the
wrist may come near the things that the task is about. None of these is watched.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.impedance.arm_model import ArmModel
from vita.impedance.clearance import between_segments
from vita.scenario.schema import Scenario
from vita.servo.keep_off import NEAR_M, Nearness, Pair
from vita.sim.arm_hull import arm_hull
from vita.sim.boxes import Boxes, boxes_of, nearest_on_boxes, room_boxes
from vita.sim.people import SEGMENTS
from vita.sim.robots import RobotModel
from vita.stereo.hull import ArmHull
from vita.types import Array

EVERY_CYCLES = 8
"""Gate cycles from one look to the next: once in a frame period."""
ALWAYS_NEAR_M = 0.02
"""Links that are nearer than `NEAR_M` and this to another in the ready pose cannot be told apart from those
that touch: their joints' limits keep them off each other [m]."""
_HULLS: dict[str, ArmHull] = {}


@dataclass(frozen=True, eq=False)
class _Itself:
    """The pairs of the arm's own capsules that are looked at."""

    first: NDArray[np.intp]
    second: NDArray[np.intp]


class Proximity:
    """Distances and their gradients at a given moment."""

    def __init__(self, model: RobotModel, scenario: Scenario) -> None:
        """Raises `BadInput` for an arm with sliding joints, whose shape is not known."""
        scene = scenario.scene
        self._arm = model.arm_model()
        key = f"{model.urdf}:{model.urdf.stat().st_mtime_ns}"
        if key not in _HULLS:
            _HULLS[key] = arm_hull(model)
        self._hull = _HULLS[key]
        self._links = np.array(self._hull.frames)
        self._moving = np.flatnonzero(self._links >= 0)
        things = [spec for spec in scene.objects if spec.mount is None]
        self._boxes: Boxes = room_boxes(scene.table) + boxes_of(things)
        self._itself = self._pairs_of_itself(model.q_ready)
        about = {f"the {spec.name}" for spec in things if spec.name in touched(scenario)}
        wrist = wrist_of(model)
        watched = [
            [self._links[i] < wrist or name not in about for name in self._boxes.names] for i in self._moving
        ]
        self._watched = np.flatnonzero(watched)
        """Which of the (link, box) pairs count."""
        names = [part_name(model, joint) for joint in self._hull.frames]
        to_things = [Pair(names[i], owner) for i in self._moving for owner in self._boxes.names]
        self.pairs: tuple[Pair, ...] = (
            *(to_things[i] for i in self._watched),
            *(Pair(names[i], names[k]) for i, k in zip(self._itself.first, self._itself.second, strict=True)),
        )
        """(c,) what is near to what."""

    def look(self, q: Array, poses: Mapping[str, Array], stamp: float) -> Nearness:
        """How near everything is, with the joints at q (n,) and the things where `poses` has them."""
        frames = self._arm.frames(q)
        starts, ends = self._hull.segments(frames)
        axes, moments = _screws(self._arm, frames)
        radii = self._hull.radii
        # The things.
        some = self._moving
        on_arm, normals, far = nearest_on_boxes(starts[some], ends[some], self._boxes.placed(poses))
        watched = self._watched
        distances = (far - radii[some, None] - self._boxes.radii).reshape(-1)[watched]
        links = np.repeat(self._links[some], len(self._boxes.names))[watched]
        on_arm, normals = on_arm.reshape(-1, 3)[watched], normals.reshape(-1, 3)[watched]
        gradients = _rates(on_arm, normals, links, axes, moments)
        # The arm itself.
        i, k = self._itself.first, self._itself.second
        if i.size:
            s, t = (
                np.diagonal(share)[:, None]
                for share in between_segments(starts[i], ends[i], starts[k], ends[k])
            )
            a, b = starts[i] + s * (ends[i] - starts[i]), starts[k] + t * (ends[k] - starts[k])
            apart = a - b
            length = np.sqrt((apart * apart).sum(1))
            n = apart / np.maximum(length, 1e-9)[:, None]
            distances = np.concatenate([distances, length - radii[i] - radii[k]])
            own = _rates(a, n, self._links[i], axes, moments) - _rates(b, n, self._links[k], axes, moments)
            gradients = np.concatenate([gradients, own])
        return Nearness(stamp, q, distances, gradients, self.pairs)

    def _pairs_of_itself(self, q: Array) -> _Itself:
        """Neighbours always touch, and so do links that the ready pose has next to each other."""
        starts, ends = self._hull.segments(self._arm.frames(q))
        s, t = between_segments(starts, ends, starts, ends)
        a = starts[:, None] + s[..., None] * (ends - starts)[:, None]
        b = starts[None] + t[..., None] * (ends - starts)[None]
        gaps = np.linalg.norm(a - b, axis=-1) - self._hull.radii[:, None] - self._hull.radii
        apart = self._links[None, :] - self._links[:, None]
        first, second = np.nonzero((apart >= 2) & (gaps > NEAR_M + ALWAYS_NEAR_M))
        # The farther link is the one that people see moving.
        return _Itself(second, first)


def part_name(model: RobotModel, joint: int) -> str:
    """What people call the part of the arm that `joint` turns; -1 is the base."""
    if joint < 0:
        return "the base"
    if model.landmarks is None:
        return f"the link after {model.joints[joint].name}" if joint < model.n else "the last link"
    shoulder, elbow, _ = model.landmarks
    if joint < shoulder:
        return "the shoulder"
    if joint < elbow:
        return "the upper arm"
    return "the forearm" if joint < wrist_of(model) else "the wrist"


def touched(scenario: Scenario) -> frozenset[str]:
    """The things that a task is about: those that its trackers are attached to. People never are."""
    places = [place for spec in scenario.tracker for place in (spec.attach, spec.attach_to) if place]
    people = {spec.name for spec in scenario.scene.objects if spec.kind in SEGMENTS}
    return frozenset(place.body for place in places) - people


def wrist_of(model: RobotModel) -> int:
    """The first joint that turns the wrist: the one along the forearm, if it has one; of an arm that is not
    known better, the last but two."""
    if model.landmarks is None:
        return max(model.n - 3, 0)
    _, elbow, wrist = model.landmarks
    return max(elbow + 1, wrist - 1)


def proximity_of(model: RobotModel, scenario: Scenario) -> Proximity | None:
    """The monitor of a scene; None for an arm that it does not know the shape of."""
    try:
        return Proximity(model, scenario)
    except BadInput:
        return None


def _screws(arm: ArmModel, frames: Array) -> tuple[Array, Array]:
    """(n, 3) axes of the joints in the base frame and (n, 3) their moments about its origin."""
    axes = (frames[: arm.n, :3, :3] @ arm.axes[:, :, None])[..., 0]
    return axes, _cross(frames[: arm.n, :3, 3], axes)


def _rates(points: Array, normals: Array, links: NDArray[np.intp], axes: Array, moments: Array) -> Array:
    """(k, n) speed along its normal of each of the (k, 3) points, that moves with the joint `links` (k,),
    for a unit speed of each joint [m/rad]."""
    rates = _cross(points, normals) @ axes.T + normals @ moments.T
    return np.where(np.arange(len(axes)) <= links[:, None], rates, 0.0)


def _cross(a: Array, b: Array) -> Array:
    """(k, 3) cross products; numpy's own takes longer than all the rest."""
    (x, y, z), (u, v, w) = a.T, b.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)
