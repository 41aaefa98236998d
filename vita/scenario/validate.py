"""Whether a scenario makes sense: names, references, ranges. Every error carries the culprit's path.

`from_plain` is the one gate: files, `--set` and scenarios made in Python all pass through it, so
that nobody can bring in what another would refuse.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from vita.errors import BadInput, UnknownName
from vita.impedance.repulsion import check_balance
from vita.scenario import names
from vita.scenario.actions import checked_action
from vita.scenario.emit import is_block
from vita.scenario.lengths import check_lengths
from vita.scenario.limits import check_numbers
from vita.scenario.names import LINE
from vita.scenario.schema import (
    SCHEMA,
    CameraSpec,
    ConstraintSpec,
    NoiseSpec,
    Scenario,
    ScriptSpec,
    TrackerSpec,
)
from vita.scenario.typed import build, plain, whole
from vita.stereo.rig_file import load_rig
from vita.types import Joint

DEG = math.degrees(1.0)
"""Degrees in a radian."""


def validate(scenario: Scenario) -> Scenario:
    """The same scenario in its exact types (lists to tuples, 1 to 1.0); raises `BadInput`."""
    return from_plain(plain(scenario))


def from_plain(table: Mapping[str, Any]) -> Scenario:
    """The scenario of a plain table such as a TOML parser gives; raises `BadInput`."""
    _check_schema(table)
    scenario: Scenario = build(Scenario, table)
    script = tuple(checked_action(entry, f"script[{i}]") for i, entry in enumerate(scenario.script))
    # In the order in which a file has them: plain values first.
    extra = dict(sorted(scenario.extra.items(), key=lambda item: is_block(item[1])))
    scenario = replace(scenario, script=script, extra=extra)
    check_numbers(scenario)
    robot = _robot(scenario)
    bodies = _check_scene(scenario, robot.links)
    cameras = _check_cameras(scenario.camera, bodies[1:])
    trackers = _check_trackers(scenario.tracker, cameras, bodies)
    _check_constraints(scenario.constraint, trackers)
    check_lengths(scenario)
    _check_joints(scenario, robot.joints)
    for i, entry in enumerate(script):
        _check_references(entry, f"script[{i}]", scenario, len(robot.joints))
    _check_expect(scenario, bodies, cameras)
    _check_mode(scenario, cameras)
    return scenario


def _check_schema(table: Mapping[str, Any]) -> None:
    if "schema" not in table:
        raise BadInput(f"the key is missing; a scenario file starts with `schema = {SCHEMA}`", "schema")
    version = whole(table["schema"], "schema")
    if version > SCHEMA:
        raise BadInput(newer(version), "schema")
    if version < 1:
        raise BadInput(f"there is no schema {version}; write `schema = {SCHEMA}`", "schema")


def newer(version: int) -> str:
    """What to say of a file of a later version."""
    return f"made by version {version} of the format; this is {SCHEMA}: install a newer vita"


def _robot(scenario: Scenario) -> names.RobotNames:
    try:
        return names.robot(scenario.scene.robot)
    except BadInput as error:
        error.args = (f"scene.robot: {error}",)
        error.path = "scene.robot"
        raise


def known(what: str, name: str, choices: Iterable[str], path: str) -> None:
    """Raise `UnknownName` unless `name` is among the choices."""
    choices = tuple(choices)
    if name not in choices:
        raise UnknownName(what, name[:80], choices, path)


def _unique(specs: Sequence[Any], path: str) -> None:
    seen: dict[str, int] = {}
    for i, spec in enumerate(specs):
        if spec.name in seen:
            raise BadInput(
                f"the name {spec.name!r} is taken by {path}[{seen[spec.name]}]", f"{path}[{i}].name"
            )
        seen[spec.name] = i


def _check_scene(scenario: Scenario, links: Sequence[str]) -> tuple[str, ...]:
    """The names of all bodies in the scene."""
    scene = scenario.scene
    known("tool", scene.tool, names.tools(), "scene.tool")
    _unique(scene.objects, "scene.objects")
    for i, spec in enumerate(scene.objects):
        path = f"scene.objects[{i}]"
        known("object kind", spec.kind, names.object_kinds(), f"{path}.kind")
        if spec.name in ("world", *links):
            raise BadInput(f"the name {spec.name!r} is taken by the robot", f"{path}.name")
        if spec.mount is not None:
            known("link", spec.mount, links, f"{path}.mount")
    return ("world", *links, *(spec.name for spec in scene.objects))


def _check_cameras(cameras: Sequence[CameraSpec], carriers: Sequence[str]) -> dict[str, CameraSpec]:
    _unique(cameras, "camera")
    for i, camera in enumerate(cameras):
        path = f"camera[{i}]"
        if camera.mount is not None:
            for key in ("look_from", "look_at"):
                if getattr(camera, key) is not None:
                    raise BadInput("give either mount or look_from and look_at, not both", f"{path}.{key}")
            known("link or object", camera.mount, carriers, f"{path}.mount")
            continue
        for key in ("look_from", "look_at"):
            if getattr(camera, key) is None:
                raise BadInput("a camera needs look_from and look_at, or mount", f"{path}.{key}")
        for key in ("xyz", "rpy_deg"):
            if any(getattr(camera, key)):
                raise BadInput("belongs to a camera with mount; use look_from here", f"{path}.{key}")
        if camera.look_from == camera.look_at:
            raise BadInput("the camera cannot look at the place where it stands", f"{path}.look_at")
    return {camera.name: camera for camera in cameras}


def _check_trackers(
    trackers: Sequence[TrackerSpec], cameras: Mapping[str, CameraSpec], bodies: Sequence[str]
) -> dict[str, TrackerSpec]:
    _unique(trackers, "tracker")
    for i, tracker in enumerate(trackers):
        path = f"tracker[{i}]"
        known("camera", tracker.camera, cameras, f"{path}.camera")
        known("tracker kind", tracker.kind, names.tracker_kinds(), f"{path}.kind")
        if tracker.at is not None and tracker.attach is not None:
            raise BadInput("give either at or attach, not both", f"{path}.attach")
        if tracker.attach is not None:
            known("body", tracker.attach.body, bodies, f"{path}.attach.body")
        elif tracker.kind == "projected":
            raise BadInput("a projected tracker needs attach = { body = ..., point = [...] }", path)
        elif tracker.at is None:
            raise BadInput("a tracker needs at = [u, v] or attach = { body = ..., point = [...] }", path)
        if tracker.at is not None and tracker.kind != "fixed":
            _check_seen(tracker.at, cameras[tracker.camera], f"{path}.at")
        _check_line(tracker, cameras[tracker.camera], bodies, path)
        if tracker.noise is not None:
            if tracker.kind != "projected":
                raise BadInput("only a projected tracker has a noise model", f"{path}.noise")
            known("noise kind", tracker.noise.kind, names.noise_kinds(), f"{path}.noise.kind")
            _check_noise(tracker.noise, f"{path}.noise")
    return {tracker.name: tracker for tracker in trackers}


def _check_noise(noise: NoiseSpec, path: str) -> None:
    if noise.sigma_px and noise.kind not in ("gaussian", "distance"):
        raise BadInput("belongs to the noise kinds gaussian and distance", f"{path}.sigma_px")
    if noise.at_m != NoiseSpec.at_m and noise.kind != "distance":
        raise BadInput("belongs to the noise kind distance", f"{path}.at_m")
    for i, (start, end) in enumerate(noise.occluded):
        if start >= end:
            where = f"{path}.occluded[{i}]"
            raise BadInput(f"a span of time ends after it begins, got {start:g} to {end:g} s", where)
    for key, other in (("jump_px", "jump_every_s"), ("jump_every_s", "jump_px")):
        if getattr(noise, key) and not getattr(noise, other):
            raise BadInput(f"needs {other} beside it", f"{path}.{key}")


def _check_line(tracker: TrackerSpec, camera: CameraSpec, bodies: Sequence[str], path: str) -> None:
    """A line has a second end, given in the same way as the first; nothing else has."""
    for key, first in (("to", tracker.at), ("attach_to", tracker.attach)):
        value = getattr(tracker, key)
        if value is not None and (tracker.kind != LINE or first is None):
            raise BadInput(f"belongs to a {LINE!r} tracker placed by {'at' if key == 'to' else 'attach'}",
                           f"{path}.{key}")  # fmt: skip
    if tracker.kind == LINE and tracker.to is None and tracker.attach_to is None:
        raise BadInput("a line tracker needs its other end: to = [u, v] or attach_to = { ... }", path)
    if tracker.to is not None:
        _check_seen(tracker.to, camera, f"{path}.to")
    if tracker.attach_to is not None:
        known("body", tracker.attach_to.body, bodies, f"{path}.attach_to.body")


def _check_seen(at: tuple[float, float], camera: CameraSpec, path: str) -> None:
    """Refuse a start outside the image. The margin lets a task be saved while a tracker sits at its edge."""
    margin_px = 16
    for value, size in zip(at, camera.size, strict=True):
        if not -margin_px <= value <= size - 1 + margin_px:
            w, h = camera.size
            raise BadInput(f"{list(at)} lies outside the image of {camera.name!r} ({w} x {h} px)", path)


def _check_constraints(constraints: Sequence[ConstraintSpec], trackers: Mapping[str, TrackerSpec]) -> None:
    _unique(constraints, "constraint")
    for i, spec in enumerate(constraints):
        path = f"constraint[{i}]"
        known("constraint kind", spec.kind, names.constraint_kinds(), f"{path}.kind")
        for j, name in enumerate(spec.points):
            known("tracker", name, trackers, f"{path}.points[{j}]")
            if name in spec.points[:j]:
                raise BadInput(f"{name!r} is used twice in one constraint", f"{path}.points[{j}]")
            first, here = trackers[spec.points[0]].camera, trackers[name].camera
            if here != first:
                raise BadInput(
                    f"{name!r} is in camera {here!r} and {spec.points[0]!r} in {first!r}; "
                    "each view has its own constraint",
                    f"{path}.points[{j}]",
                )
        if not names.constraint_fits(spec.kind, [2 if trackers[n].kind == LINE else 1 for n in spec.points]):
            roles = names.constraint_roles(spec.kind)
            raise BadInput(
                f"{spec.kind} ties {len(roles)} trackers, got {len(spec.points)}: {'; '.join(roles)} (one "
                f"{LINE!r} tracker stands for both ends of a line)",
                f"{path}.points",
            )


def _check_joints(scenario: Scenario, joints: Sequence[Joint]) -> None:
    n, robot = len(joints), scenario.scene.robot
    q0 = scenario.scene.q0_deg
    if q0 is not None and len(q0) != n:
        raise BadInput(f"{robot} has {n} joints, got {len(q0)} angles", "scene.q0_deg")
    for i, value in enumerate(q0 or ()):
        low, high = joints[i].lower * DEG, joints[i].upper * DEG
        if not low - 1e-6 <= value <= high + 1e-6:
            path = f"scene.q0_deg[{i}]"
            raise BadInput(f"{value:g} is outside the joint's {low:.1f} to {high:.1f} deg", path)
    for i, joint in enumerate(scenario.servo.joints or ()):
        if joint >= n:
            raise BadInput(f"{robot} has the joints 0 to {n - 1}, got {joint}", f"servo.joints[{i}]")
    seen = set()
    for i, limit in enumerate(scenario.limits.joint):
        path = f"limits.joint[{i}]"
        if not 0 <= limit.joint < n:
            raise BadInput(f"{robot} has the joints 0 to {n - 1}, got {limit.joint}", f"{path}.joint")
        if limit.joint in seen:
            raise BadInput(f"joint {limit.joint} is listed twice", f"{path}.joint")
        seen.add(limit.joint)
        own = joints[limit.joint]
        low = own.lower * DEG if limit.lower_deg is None else limit.lower_deg
        high = own.upper * DEG if limit.upper_deg is None else limit.upper_deg
        if low >= high:
            raise BadInput(f"the lower limit {low:g} is not below the upper {high:g} deg", path)


def _check_references(entry: ScriptSpec, path: str, scenario: Scenario, n: int) -> None:
    choices = {
        "camera": [c.name for c in scenario.camera],
        "tracker": [t.name for t in scenario.tracker],
        "object": [o.name for o in scenario.scene.objects],
    }
    for key, names_ in choices.items():
        if key in entry.arguments:
            known(key, entry.arguments[key], names_, f"{path}.{key}")
    if entry.do == "push_robot" and not 1 <= len(entry.arguments["dq_deg"]) <= n:
        raise BadInput(
            f"{scenario.scene.robot} has {n} joints, got {len(entry.arguments['dq_deg'])} angles",
            f"{path}.dq_deg",
        )
    if entry.do == "lock_joint" and not 0 <= entry.arguments["joint"] < n:
        got = entry.arguments["joint"]
        raise BadInput(f"the robot has the joints 0 to {n - 1}, got {got}", f"{path}.joint")
    if entry.do == "set" and entry.arguments["field"] == "servo.joints":
        for joint in entry.arguments["value"]:
            if joint >= n:
                raise BadInput(f"the robot has the joints 0 to {n - 1}, got {joint}", f"{path}.value")


def _check_mode(scenario: Scenario, cameras: Mapping[str, CameraSpec]) -> None:
    known("mode", scenario.mode, names.MODES, "mode")
    if scenario.mode != "impedance":
        return
    for key in ("left", "right"):
        known("camera", getattr(scenario.impedance, key), cameras, f"impedance.{key}")
    if scenario.impedance.depth:
        known("depth camera", scenario.impedance.depth, [n for n, c in cameras.items() if c.depth],
              "impedance.depth")  # fmt: skip
    check_balance(scenario.impedance)
    if scenario.impedance.rig_file:
        try:
            load_rig(scenario.impedance.rig_file)
        except BadInput as error:
            raise BadInput(str(error), "impedance.rig_file") from None


def _check_expect(scenario: Scenario, bodies: Sequence[str], cameras: Iterable[str]) -> None:
    expect = scenario.expect
    if expect is None:
        return
    if expect.outcome is not None:
        known("outcome", expect.outcome, names.OUTCOMES, "expect.outcome")
    if expect.reason is not None:
        known("reason", expect.reason, names.reasons(), "expect.reason")
    if expect.final_distance_mm is not None:
        places = (*bodies, *(f"camera:{name}" for name in cameras))
        for key in ("of", "to"):
            known("body", getattr(expect.final_distance_mm, key), places, f"expect.final_distance_mm.{key}")
    for i, follow in enumerate(expect.follow):
        for key in ("of", "to"):
            known("body", getattr(follow, key), bodies, f"expect.follow[{i}].{key}")
    for i, clearance in enumerate(expect.clearance):
        things = ("table", *(spec.name for spec in scenario.scene.objects))
        known("body", clearance.to, things, f"expect.clearance[{i}].to")
