"""Faults of what cameras and trackers do (rows V)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from vita.errors import BadInput
from vita.faults.registry import injector
from vita.faults.site import Site
from vita.task import Slot
from vita.types import Array, Feature, Observation, frozen

JUMP_PX = 120.0
DRIFT_PX = 2.0
LATE_PERIODS = 8
NEAR_PX = 20.0
"""How near the border V10 brings a feature, in a picture 640 pixels wide."""
TURN_PX = 3.0
"""How fast V10 turns the camera, per period; trackers can follow that."""


def _slots(site: Site) -> list[Slot]:
    """The trackers in use, in the order of the constraints, without goals that are drawn on the picture."""
    task = site.engine.editor.task
    if site.engine.following is not None or not task.constraints:
        raise BadInput("this fault needs a task with trackers; draw a constraint, or open another task")
    names = dict.fromkeys(name for constraint in task.constraints for name in constraint.points)
    return [slot for slot in map(task.slot, names) if slot.spec.kind != "fixed"]


def _tracker(site: Site) -> str:
    """The first tracker in use: the one that moves with the arm, in most tasks."""
    slots = _slots(site)
    if not slots:
        raise BadInput("this fault needs a tracker that follows something")
    return slots[0].spec.name


def _camera(site: Site) -> str:
    """The first camera in use."""
    used = site.engine.mode.cameras
    cameras = [name for name in site.engine.rig.cameras if name in used]
    if not cameras:
        raise BadInput("this fault needs a task that looks through a camera; draw a constraint first")
    return cameras[0]


def _change(name: str, change: Callable[[Feature], Feature]):
    """A fault of the report of one tracker."""

    def fault(features: Mapping[str, Feature], _: Observation) -> Mapping[str, Feature]:
        return {**features, name: change(features[name])} if name in features else features

    return fault


def _gone(feature: Feature) -> Feature:
    return replace(feature, status="lost", score=0.0, detail="a fault was injected")


def _moved(feature: Feature, by: Array) -> Feature:
    """Shifted by `by` (2,) [px]."""
    segment = None if feature.segment is None else frozen(feature.segment + by)
    return replace(feature, uv=frozen(feature.uv + by), segment=segment, corners=None, outline=None)


@injector("V1")
def lost_tracker(site: Site) -> None:
    """The first tracker loses its feature."""
    site.tap.features["V1"] = _change(_tracker(site), _gone)


@injector("V2")
def blind_camera(site: Site) -> None:
    """Every tracker of the first camera loses its feature."""
    names = {slot.spec.name for slot in _slots(site) if slot.spec.camera == _camera(site)}

    def fault(features: Mapping[str, Feature], _: Observation) -> Mapping[str, Feature]:
        return {name: _gone(f) if name in names else f for name, f in features.items()}

    site.tap.features["V2"] = fault


@injector("V3")
def no_pixel(site: Site) -> None:
    """The first tracker reports what is no pixel, and something else in every picture."""
    kinds = deque((np.array([np.nan, 3]), np.array([np.inf, 3]), None, np.zeros(3), np.array([-1e9, 7])))

    def garbage(feature: Feature) -> Feature:
        kinds.rotate(-1)
        return replace(feature, uv=kinds[-1])  # type: ignore[arg-type]

    site.tap.features["V3"] = _change(_tracker(site), garbage)


@injector("V4")
def stuck_tracker(site: Site) -> None:
    """The first tracker repeats what it says now."""
    name = _tracker(site)
    now = site.engine.editor.features[name]
    site.tap.features["V4"] = _change(name, lambda _: now)


@injector("V5")
def frozen_camera(site: Site) -> None:
    """The first camera repeats its last picture."""
    camera, rig = _camera(site), site.engine.rig
    rig.perform("freeze_camera", camera=camera)
    site.tap.undo["V5"] = lambda: rig.perform("unfreeze_camera", camera=camera)


@injector("V6")
def late_pictures(site: Site) -> None:
    """The pictures of every camera fall behind, until they are a quarter of a second late."""
    waiting: deque[Observation] = deque()
    count = 0

    def late(seen: Observation) -> Observation:
        nonlocal count
        waiting.append(seen)
        count += 1
        if len(waiting) > 1 and (count % 2 == 0 or len(waiting) > LATE_PERIODS):
            waiting.popleft()
        old = waiting[0]
        return replace(seen, frames=old.frames, stamps=dict.fromkeys(old.frames, old.stamp))

    site.tap.seen["V6"] = late


@injector("V7")
def jumping_tracker(site: Site) -> None:
    """The first tracker jumps to a place that looks alike, and stays there."""
    name = _tracker(site)
    width = site.engine.observation.frames[site.engine.editor.task.slot(name).spec.camera].shape[1]
    inward = 1.0 if site.engine.editor.features[name].uv[0] < width / 2 else -1.0
    by = np.array([inward * JUMP_PX * width / 640, 0.0])
    site.tap.features["V7"] = _change(name, lambda feature: _moved(feature, by))


@injector("V8")
def swapped_trackers(site: Site) -> None:
    """Two trackers of one view change places."""
    features = site.engine.editor.features
    points = [s.spec for s in _slots(site) if features[s.spec.name].segment is None]
    pairs = [(a.name, b.name) for i, a in enumerate(points) for b in points[i + 1 :] if a.camera == b.camera]
    if not pairs:
        raise BadInput("this fault needs two trackers of points in one view")
    one, other = max(pairs, key=lambda pair: np.hypot(*(features[pair[0]].uv - features[pair[1]].uv)))

    def swap(seen: Mapping[str, Feature], _: Observation) -> Mapping[str, Feature]:
        return {**seen, one: seen[other], other: seen[one]} if {one, other} <= set(seen) else seen

    site.tap.features["V8"] = swap


@injector("V9")
def drifting_tracker(site: Site) -> None:
    """The first tracker slides off its feature, by 2 px a picture."""
    off = np.zeros(2)

    def drift(feature: Feature) -> Feature:
        nonlocal off
        off = off + (0.6 * DRIFT_PX, -0.8 * DRIFT_PX)
        return _moved(feature, off)

    site.tap.features["V9"] = _change(_tracker(site), drift)


@injector("V10")
def leaving_view(site: Site) -> None:
    """The first camera is turned, little by little, until one of its features is near the border."""
    engine, camera = site.engine, _camera(site)
    if engine.moving:
        raise BadInput("stop the arm first: a camera that is turned while it moves is another fault (V11)")
    spec = next(spec for spec in engine.present().camera if spec.name == camera)
    names = [slot.spec.name for slot in _slots(site) if slot.spec.camera == camera]
    if spec.mount is not None or not names:
        raise BadInput(f"the {camera} camera rides on the arm, or nothing is followed in it")
    place = engine.rig.poses()[f"camera:{camera}"]
    eye, towards = place[:3, 3], np.asarray(spec.look_at) - place[:3, 3]
    focal = spec.size[1] / 2 / np.tan(np.radians(spec.fov_deg) / 2)
    uv = np.array([engine.editor.features[name].uv for name in names])
    low, high = uv.min(axis=0), np.array(spec.size) - 1 - uv.max(axis=0)
    axis, far = min(((a, f) for a in (0, 1) for f in (False, True)), key=lambda x: (low, high)[x[1]][x[0]])
    goal = NEAR_PX * spec.size[0] / 640
    turned = 0.0

    def turn(by_px: float) -> None:
        """Turn the camera by so many pixels more, about the axis that carries the feature to its border."""
        nonlocal turned
        turned += by_px
        angle = np.arctan2(turned if not far else -turned, focal)
        size = float(np.linalg.norm(towards))
        aim = eye + size * (np.cos(angle) * place[:3, 2] + np.sin(angle) * place[:3, axis])
        engine.rig.perform("move_camera", camera=camera, look_at=tuple(aim.tolist()))

    def on(seen: Observation) -> Observation:
        points = np.array([engine.editor.features[name].uv for name in names])
        room = points.min(axis=0)[axis] if not far else spec.size[axis] - 1 - points.max(axis=0)[axis]
        if room > goal and not engine.moving:
            turn(min(TURN_PX, float(room - goal)))
        return seen

    def back(seen: Observation) -> Observation:
        if not engine.moving:
            turn(-min(TURN_PX, turned))
        if turned <= 0.0:
            del site.tap.seen["V10"]
        return seen

    site.tap.seen["V10"] = on
    site.tap.undo["V10"] = lambda: site.tap.seen.update(V10=back)


@injector("V12")
def unplugged_camera(site: Site) -> None:
    """The first camera gives no picture any more."""
    camera = _camera(site)

    def unplug(seen: Observation) -> Observation:
        return replace(seen, frames={name: frame for name, frame in seen.frames.items() if name != camera})

    site.tap.seen["V12"] = unplug


@injector("V13")
def failing_tracker(site: Site) -> None:
    """The code of the first tracker raises."""
    tracker = site.engine.editor.task.slot(_tracker(site)).tracker

    def update(_: object) -> Feature:
        raise ZeroDivisionError("a fault was injected")

    tracker.update = update  # type: ignore[method-assign]
    site.tap.undo["V13"] = lambda: delattr(tracker, "update")


TURNED_DEG = 90.0


@injector("V11")
def turned_camera(site: Site) -> None:
    """The first camera is turned about its line of sight by a right angle."""
    camera = _camera(site)
    site.engine.rig.perform("move_camera", camera=camera, turn_deg=TURNED_DEG)
    site.tap.undo["V11"] = lambda: site.engine.rig.perform(
        "move_camera", camera=camera, turn_deg=-TURNED_DEG
    )
