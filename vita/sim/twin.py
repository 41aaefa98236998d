"""A scenario's scene as bare geometry: where every feature is seen, for any pose of arm or hand.

No physics, no pictures and no time, so that thousands of poses can be tried in a second. It is ground
truth, for advice before a run and for judging; the servo never sees it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vita.constraints import Term, constraint_of
from vita.poses import pose_matrix
from vita.scenario.schema import AttachSpec, Scenario, TrackerSpec
from vita.sim.camera import PinholeCamera, camera_pose
from vita.sim.environment import build_environment
from vita.sim.joint_limits import limits_in_force
from vita.sim.objects import build_object
from vita.sim.ray import Surface
from vita.sim.robots import load_robot
from vita.sim.tools import build_tool
from vita.sim.urdf import UrdfJoint, cross_matrix
from vita.types import Array, Joint, RowLabel, frozen

UNSEEN_PX = 1e4
"""Error of a row whose features are behind a camera [px]."""


@dataclass(frozen=True)
class Mark:
    """What a tracker holds on to: constant pixels, or points fixed to a body."""

    tracker: str
    camera: str
    body: str
    """Empty for constant pixels."""
    points: Array
    """(k, 3) in the body's frame [m], or (k, 2) pixels."""


class Twin:
    """The scene of `scenario` with the arm at `q0`."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.model = load_robot(scenario.scene.robot)
        self.joints: tuple[Joint, ...] = limits_in_force(self.model.joints, scenario.limits)
        q0 = scenario.scene.q0_deg
        self.q0 = frozen(self.model.q_ready if q0 is None else np.radians(q0))
        self.lenses = {c.name: PinholeCamera(c.name, c.size, c.fov_deg) for c in scenario.camera}
        self._props = [(spec, pose_matrix(spec.xyz, spec.rpy_deg)) for spec in scenario.scene.objects]
        still = [spec for spec in scenario.camera if spec.mount is None]
        self._fixed_cameras = {spec.name: camera_pose(spec, {}) for spec in still}
        self._T_tool_last = np.linalg.inv(self.model.T_last_tool)
        self._start = self.bodies(self.q0)
        self._carriers = self._hand_bodies()
        self.surface = Surface(
            (
                *self.model.visuals(),
                *build_tool(scenario.scene.tool),
                *(v for spec in scenario.scene.objects for v in build_object(spec.kind, spec.name)),
                *build_environment(scenario.scene.table),
            )
        )
        self.marks = {spec.name: self._mark(spec) for spec in scenario.tracker}
        camera = {spec.name: spec.camera for spec in scenario.tracker}
        self.terms = tuple(
            Term(c.name, c.kind, c.points, camera[c.points[0]], c.weight) for c in scenario.constraint
        )
        self.labels = tuple(
            RowLabel(t.name, t.camera, part) for t in self.terms for part in constraint_of(t.kind).components
        )
        rows = [len(constraint_of(t.kind).components) for t in self.terms]
        self.weights = frozen(np.repeat([t.weight for t in self.terms], rows))

    # ---- where things are: all of it takes leading axes `...`, many poses at once -----------------

    def bodies(self, q: Array) -> dict[str, Array]:
        """Body name to (..., 4, 4) T_world_body at joints `q` (..., n) [rad]; cameras as `camera:NAME`.
        What does not move with the arm is (4, 4)."""
        index = {joint.name: i for i, joint in enumerate(self.model.joints)}
        frames = {self.model.tree.root: self.model.T_world_base}
        for joint in self.model.tree.joints:
            here = frames[joint.parent]
            if joint.name in index:
                frames[joint.child] = here @ _turned(joint, q[..., index[joint.name]])
            else:
                frames[joint.child] = here @ joint.motion(0.0)
        bodies = {self.model.bodies[link]: frame for link, frame in frames.items()}
        bodies["flange"] = bodies["tool"] = bodies[self.model.link_names[-1]] @ self.model.T_last_tool
        return self._with_props({"world": np.eye(4), **bodies})

    def bodies_of_hand(self, T_world_tool: Array) -> dict[str, Array]:
        """The same with the hand at poses (..., 4, 4) of its own, torn off the arm, which stays behind."""
        links = {name: self._start[name] for name in ("world", *self.model.link_names)}
        links[self.model.link_names[-1]] = T_world_tool @ self._T_tool_last
        return self._with_props(links | {"tool": T_world_tool, "flange": T_world_tool})

    def _with_props(self, bodies: dict[str, Array]) -> dict[str, Array]:
        links = dict(bodies)
        for spec, placed in self._props:
            bodies[spec.name] = placed if spec.mount is None else links[spec.mount] @ placed
        for spec in self.scenario.camera:
            own = self._fixed_cameras.get(spec.name)
            if own is None:
                own = bodies[spec.mount or ""] @ pose_matrix(spec.xyz, spec.rpy_deg)
            bodies[f"camera:{spec.name}"] = own
        return bodies

    def _hand_bodies(self) -> frozenset[str]:
        """The bodies that are rigid with the tool."""
        hand = {"tool", "flange", self.model.link_names[-1]}
        hand |= {spec.name for spec in self.scenario.scene.objects if spec.mount in hand}
        return frozenset(hand | {f"camera:{c.name}" for c in self.scenario.camera if c.mount in hand})

    def on_hand(self, body: str) -> bool:
        """Whether `body` is rigid with the tool."""
        return body in self._carriers

    def on_arm(self, body: str) -> bool:
        """Whether `body` moves with the arm, but not with the tool."""
        moving = set(self.model.link_names[1:]) - self._carriers
        moving |= {spec.name for spec in self.scenario.scene.objects if spec.mount in moving}
        return body in moving | {f"camera:{c.name}" for c in self.scenario.camera if c.mount in moving}

    # ---- features ------------------------------------------------------------------------------

    def _mark(self, spec: TrackerSpec) -> Mark:
        """What the tracker will hold on to, if it is placed as the file says: the point that is attached,
        or what the ray through the pixel hits first."""
        ends = ((spec.at, spec.attach), (spec.to, spec.attach_to))
        if spec.kind == "fixed":
            given = [(at, attach) for at, attach in ends if at or attach]
            pixels = [at if attach is None else self._pixel(spec.camera, attach) for at, attach in given]
            return Mark(spec.name, spec.camera, "", frozen(pixels))
        body, points = "", []
        for at, attach in ends:
            if attach is not None:
                body, point = attach.body, np.asarray(attach.point, float)
            elif at is not None:
                T = self._start[f"camera:{spec.camera}"]
                found = self.surface.hit(T, self.lenses[spec.camera].intrinsics, at, self._start)
                if found is None:  # Nothing but sky: it will never move.
                    return Mark(spec.name, spec.camera, "", frozen([a for a, _ in ends if a is not None]))
                place = found[1]
                body = body or found[0]
                inverse = np.linalg.inv(self._start[body])
                point = inverse[:3, :3] @ place + inverse[:3, 3]
            else:
                continue
            points.append(point)
        return Mark(spec.name, spec.camera, body, frozen(points))

    def _pixel(self, camera: str, attach: AttachSpec) -> Array:
        T = self._start[attach.body]
        where = T[:3, :3] @ np.asarray(attach.point, float) + T[:3, 3]
        return self.lenses[camera].project(self._start[f"camera:{camera}"], where)[0]

    def pixels(self, bodies: Mapping[str, Array]) -> dict[str, Array]:
        """Tracker to the (..., k, 2) pixels at which its points would be seen; NaN behind the camera."""
        found = {}
        for name, mark in self.marks.items():
            found[name] = mark.points
            if mark.body:
                eye = bodies[f"camera:{mark.camera}"]
                local = _moved(eye, self.world_points(name, bodies))
                depth = np.where(local[..., 2:] > 1e-9, local[..., 2:], np.nan)
                lens = self.lenses[mark.camera]
                width, height = lens.size
                middle = (0.5 * (width - 1), 0.5 * (height - 1))
                found[name] = lens.focal_px * local[..., :2] / depth + middle
        return found

    def error(self, bodies: Mapping[str, Array]) -> Array:
        """(..., m) residuals without weights [px]; `UNSEEN_PX` in rows that cannot be seen."""
        return self.error_of(self.pixels(bodies))

    def error_of(self, pixels: Mapping[str, Array]) -> Array:
        """(..., m) residuals of given pixels."""
        if not self.terms:
            return np.zeros(0)
        axes = np.broadcast_shapes(*(uv.shape[:-2] for uv in pixels.values()))
        rows = []
        for term in self.terms:
            parts = [np.broadcast_to(pixels[name], (*axes, *pixels[name].shape[-2:])) for name in term.points]
            rows.append(constraint_of(term.kind).residual(np.concatenate(parts, axis=-2)))
        values = np.concatenate(rows, axis=-1)
        return np.where(np.isfinite(values), values, UNSEEN_PX)

    def world_points(self, tracker: str, bodies: Mapping[str, Array]) -> Array:
        """(..., k, 3) where a tracker's points are [m]; (0, 3) for constant pixels."""
        mark = self.marks[tracker]
        if not mark.body:
            return np.zeros((0, 3))
        T = bodies[mark.body]
        return mark.points @ T[..., :3, :3].swapaxes(-1, -2) + T[..., None, :3, 3]

    # ---- derivatives ---------------------------------------------------------------------------

    def tool_jacobian(self, q: Array) -> Array:
        """(6, n) velocity of the tool's origin [m/rad] and turning [rad/rad] about the world's axes."""
        poses = self.model.poses(q)
        origin = poses["tool"][:3, 3]
        columns = []
        for joint in self.model.urdf_joints:
            T = poses[self.model.bodies[joint.child]]
            axis = T[:3, :3] @ joint.axis
            if joint.kind == "prismatic":
                columns.append(np.concatenate([axis, np.zeros(3)]))
            else:
                columns.append(np.concatenate([np.cross(axis, origin - T[:3, 3]), axis]))
        return np.stack(columns, axis=1)

    def joint_jacobian(self, q: Array, step: float = 1e-6) -> Array:
        """(m, n) d error / d joints by central differences [px/rad]."""
        away = step * np.eye(q.size)
        ahead, behind = self.error(self.bodies(q + away)), self.error(self.bodies(q - away))
        return ((ahead - behind) / (2 * step)).T


def _turned(joint: UrdfJoint, q: Array) -> Array:
    """(..., 4, 4) child frames in the parent link's frame at joint positions `q` (...,) [rad]; Rodrigues."""
    motion = np.broadcast_to(np.eye(4), (*np.shape(q), 4, 4)).copy()
    if joint.kind == "prismatic":
        motion[..., :3, 3] = q[..., None] * joint.axis
    else:
        cross = cross_matrix(joint.axis)
        sine, versine = np.sin(q)[..., None, None], (1.0 - np.cos(q))[..., None, None]
        motion[..., :3, :3] += sine * cross + versine * (cross @ cross)
    return joint.origin @ motion


def _moved(frame: Array, points: Array) -> Array:
    """(..., k, 3) world `points` in `frame` (..., 4, 4)."""
    return (points - frame[..., None, :3, 3]) @ frame[..., :3, :3]
