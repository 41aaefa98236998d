"""How thick a robot and its tool are, from their meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.poses import pose_matrix
from vita.scenario.schema import SceneSpec
from vita.sim.objects import build_object
from vita.sim.robots import RobotModel
from vita.sim.tools import build_tool
from vita.stereo.hull import ArmHull
from vita.stereo.segments import clearances
from vita.types import Array, Visual

CUTS = (0.2, 0.35, 0.5, 0.65, 0.8)
"""Where along its longest axis a link is tried to be cut in two."""
WORTH = 0.7
"""Two capsules instead of one must take up less than this share of its volume."""
FIXED_M = 1e-6
"""What moves by less in a link's frame, from one pose to another, is fixed to that link [m]."""
MOST_PARTS = 3
"""Capsules for one link, at most."""


@dataclass(frozen=True, eq=False)
class _Capsule:
    start: Array
    end: Array
    radius: float

    @property
    def volume(self) -> float:
        """[m^3]."""
        length = float(np.linalg.norm(self.end - self.start))
        return np.pi * self.radius**2 * (length + 4 / 3 * self.radius)


def arm_hull(model: RobotModel, tool: Sequence[Visual] = ()) -> ArmHull:
    """Capsules, up to three for each link, that contain all meshes of the arm and of its `tool` (see
    `vita.sim.tools`), in every pose. A capsule is convex: it contains a triangle if it does its corners."""
    arm = model.arm_model()
    frames, poses = arm.frames(model.q_ready), model.poses(model.q_ready)
    # A second pose tells which joint's frame each link is fixed to.
    q = _elsewhere(model)
    others, turned = arm.frames(q), model.poses(q)
    found: list[tuple[int, _Capsule]] = []
    visuals = (*model.visuals(), *tool)
    for body in dict.fromkeys(visual.body for visual in visuals):
        joint = _carrier(poses[body], turned[body], frames, others)
        base = np.eye(4) if joint < 0 else frames[joint]
        T = np.linalg.inv(base) @ poses[body]
        triangles, points = _mesh([visual for visual in visuals if visual.body == body], T)
        found += [(joint, capsule) for capsule in _capsules(points, triangles, MOST_PARTS)]
    return ArmHull(
        tuple(joint for joint, _ in found),
        np.array([capsule.start for _, capsule in found]).reshape(-1, 3),
        np.array([capsule.end for _, capsule in found]).reshape(-1, 3),
        np.array([capsule.radius for _, capsule in found]),
    )


def scene_hull(model: RobotModel, scene: SceneSpec) -> ArmHull:
    """The hull of a scene's arm with its tool and with the objects that it carries."""
    poses = model.poses(model.q_ready)
    carried = list(build_tool(scene.tool))
    for spec in scene.objects:
        if spec.mount in poses:
            T = pose_matrix(spec.xyz, spec.rpy_deg)
            for visual in build_object(spec.kind, spec.name):
                moved = visual.vertices @ T[:3, :3].T + T[:3, 3]
                carried.append(replace(visual, body=spec.mount, vertices=moved))
    return arm_hull(model, carried)


def skeleton_radii(model: RobotModel, tool: Sequence[Visual] = ()) -> Array:
    """(n,) how far arm and tool reach sideways of the segments between consecutive frames of
    `ArmModel.frames` (the last one ends at the tool frame) in every pose [m].

    A point counts for the nearest of the segments that are fixed to its link: a link often reaches along the
    next joint's axis, too. Where axes meet, as in a wrist, a segment is a point. The base does not count.
    """
    arm = model.arm_model()
    q = np.stack([model.q_ready, _elsewhere(model)])
    frames, poses = [arm.frames(each) for each in q], [model.poses(each) for each in q]
    radii = np.zeros(model.n)
    for visual in (*model.visuals(), *tool):
        here, there = (np.linalg.inv(pose[visual.body]) for pose in poses)
        if np.allclose(here, there):
            continue
        points, others = (
            seen[:, :3, 3] @ T[:3, :3].T + T[:3, 3] for seen, T in zip(frames, (here, there), strict=True)
        )
        still = np.linalg.norm(points - others, axis=1) < FIXED_M
        fixed = np.flatnonzero(still[:-1] & still[1:])
        away = clearances(visual.vertices, points[fixed], points[fixed + 1], np.zeros(len(fixed)))
        np.maximum.at(radii, fixed[away.argmin(axis=1)], away.min(axis=1))
    return radii


def _elsewhere(model: RobotModel) -> Array:
    """(n,) a pose in which no joint is as in the ready pose, nor turned as far as another."""
    return model.q_ready + 0.3 + 0.1 * np.arange(model.n)


def _carrier(T: Array, turned: Array, frames: Array, others: Array) -> int:
    """Index of the first frame that a link at T, and at `turned` in another pose, is fixed to; -1 for the
    base."""
    if np.allclose(T, turned, atol=1e-9):
        return -1
    for joint, (a, b) in enumerate(zip(frames, others, strict=True)):
        if np.allclose(np.linalg.inv(a) @ T, np.linalg.inv(b) @ turned, atol=FIXED_M):
            return joint
    raise BadInput("a link that turns with none of the joints", "robot")


def _mesh(visuals: Sequence[Visual], T: Array) -> tuple[NDArray[np.int64], Array]:
    """(t, 3) triangles and the (v, 3) points that they index, in the frame that T (4, 4) leads to; points
    that meshes have twice, for their edges, are one."""
    starts = np.cumsum([0, *(len(visual.vertices) for visual in visuals)])
    triangles = np.concatenate([visual.faces + start for visual, start in zip(visuals, starts, strict=False)])
    points = np.concatenate([visual.vertices for visual in visuals])
    points, index = np.unique(points.round(6), axis=0, return_inverse=True)
    return index.reshape(-1)[triangles], points @ T[:3, :3].T + T[:3, 3]


def _capsules(points: Array, triangles: NDArray[np.int64], most: int) -> list[_Capsule]:
    """Up to `most` capsules around the (t, 3) triangles."""
    whole = _around(points[np.unique(triangles)])
    if most < 2 or len(triangles) < 2:
        return [whole]
    middles = points[triangles].mean(axis=1)
    least, chosen = WORTH * whole.volume, None
    along = middles @ _axes(middles)[3]
    for level in along.min() + np.multiply(CUTS, np.ptp(along)):
        side = along < level
        if not 0 < side.sum() < len(side):
            continue
        volume = sum(_around(points[np.unique(triangles[part])]).volume for part in (side, ~side))
        if volume < least:
            least, chosen = volume, side
    if chosen is None:
        return [whole]
    first = _capsules(points, triangles[chosen], most - 1)
    return [*first, *_capsules(points, triangles[~chosen], most - len(first))]


def _around(points: Array) -> _Capsule:
    """The smallest of the capsules around the points that lie along one of the directions to try."""
    return min((_along(points, axis) for axis in _axes(points)), key=lambda capsule: capsule.volume)


def _axes(points: Array) -> NDArray[np.float64]:
    """(6, 3) directions to try: those of the frame and the principal ones, the longest first."""
    spread = np.linalg.eigh(np.cov(points.T))[1].T[::-1]
    return np.vstack([np.eye(3), spread])


def _along(points: Array, axis: Array) -> _Capsule:
    """The capsule around the points whose axis is parallel to the unit vector `axis`."""
    across = np.linalg.svd(axis[None])[2][1:]
    flat = points @ across.T
    middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    aside = np.linalg.norm(flat - middle, axis=1)
    radius = float(aside.max()) + 1e-5  # The points were rounded.
    # A point at t is within the round end about s if |t - s| does not exceed its share of the radius.
    share, t = np.sqrt(np.maximum(radius**2 - aside**2, 0.0)), points @ axis
    low, high = float((t + share).min()), float((t - share).max())
    if low > high:  # A ball will do.
        low = high = 0.5 * (low + high)
    centre = middle @ across
    return _Capsule(centre + low * axis, centre + high * axis, radius)
