"""Faults of the robot and its process (rows R)."""

from __future__ import annotations

import os
import signal
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from vita.errors import BadInput
from vita.faults.control import busiest_joint
from vita.faults.registry import injector
from vita.faults.site import Site
from vita.sim.boxes import boxes_of
from vita.types import Array, JointStep

OLD_STEPS = 4
"""How many periods ago the commands were made that come again (R8)."""
WITHIN_M = 0.025
"""How far a thing reaches into the forearm (R6): by more than an arm moves until it is there [m]."""
FREEZE_S = 5.0
"""How long the simulation's process stands still (R2) [s]."""
SLOW_S = 0.02
"""How much longer each step of the physics takes (R3) [s]."""


@injector("R6")
def something_at_the_arm(site: Site) -> None:
    """A thing of the scene is put right at the forearm; a ball or a person if there is one, then what the
    task is not about."""
    engine = site.engine
    scenario = engine.present()
    things = [spec for spec in scenario.scene.objects if spec.mount is None]
    if not things:
        raise BadInput("this scene has nothing that could be put in the arm's way", "R6")
    about = {place.body for spec in scenario.tracker for place in (spec.attach, spec.attach_to) if place}
    thing = min(things, key=lambda spec: (spec.kind != "ball", spec.name in about, spec.kind == "person"))
    box = boxes_of([thing])
    largest = int(np.argmax(np.prod(box.halves + box.radii[:, None], axis=1)))
    pose = np.array(engine.rig.poses()[thing.name])
    # Its largest part comes to lie on the skin of the forearm, a little within, without turning.
    place = pose[:3, :3] @ box.places[largest][:3, :3]
    height = np.abs(place[2]) @ box.halves[largest] + box.radii[largest]
    centre = pose[:3, :3] @ box.places[largest][:3, 3]
    xyz = _on_the_forearm(site) + [0.0, 0.0, height - WITHIN_M] - centre
    before = pose[:3, 3].tolist()
    engine.rig.perform("drag_target", object=thing.name, xyz=xyz.tolist())
    site.tap.undo["R6"] = lambda: engine.rig.perform("drag_target", object=thing.name, xyz=before)


def _on_the_forearm(site: Site) -> Array:
    """(3,) a point on the upper side of the forearm, halfway from the elbow to the wrist [m]."""
    rig = site.engine.rig
    arm, hull = rig.arm_model(), rig.arm_hull()
    frames = arm.frames(np.asarray(site.engine.observation.q))
    starts, ends = hull.segments(frames)
    elbow = arm.landmarks[1] if arm.landmarks else arm.n // 2
    parts = [i for i, joint in enumerate(hull.frames) if joint == elbow] or [len(hull.frames) // 2]
    part = max(parts, key=lambda i: float(np.linalg.norm(ends[i] - starts[i])))
    return 0.5 * (starts[part] + ends[part]) + np.array([0.0, 0.0, hull.radii[part]])


@injector("R7")
def locked_joint(site: Site) -> None:
    """A joint stays where it is, whatever is commanded."""
    rig = site.engine.rig
    rig.perform("lock_joint", joint=busiest_joint(site))
    site.tap.undo["R7"] = lambda: rig.perform("unlock_joints")


@injector("R8")
def old_commands(site: Site) -> None:
    """Every command comes twice, and between the two one from a while ago."""
    rig = site.engine.rig
    past: deque[JointStep] = deque(maxlen=OLD_STEPS)

    def repeat(step: JointStep) -> JointStep:
        past.append(step)
        rig.command(step)
        rig.command(past[0])
        return step

    site.tap.step["R8"] = repeat


@injector("R1")
def killed(site: Site) -> None:
    """The process of the simulation is killed."""
    os.kill(_process(site, "R1"), signal.SIGKILL)


@injector("R2")
def suspended(site: Site) -> None:
    """The process of the simulation stands still for a while."""
    pid = _process(site, "R2")
    if site.later is None:
        raise BadInput("nothing may wait here, and it would stand still for good", "R2")
    until = time.monotonic() + FREEZE_S

    def thaw() -> None:
        site.tap.undo.pop("R2", None)
        try:
            os.kill(pid, signal.SIGCONT)
        except ProcessLookupError:
            pass  # Somebody restarted the simulation meanwhile.

    def wait() -> None:
        while "R2" in site.tap.undo and time.monotonic() < until:
            time.sleep(0.05)
        if "R2" in site.tap.undo:
            thaw()

    site.tap.undo["R2"] = thaw
    os.kill(pid, signal.SIGSTOP)
    site.later(wait)


@injector("R3")
def slow(site: Site) -> None:
    """Every step of the physics takes longer."""
    break_in = _inside(site, "R3")
    break_in("slow", SLOW_S)
    site.tap.undo["R3"] = lambda: break_in("mend", 0.0)


@injector("R4")
def failure_inside(site: Site) -> None:
    """The physics engine fails."""
    _inside(site, "R4")("error", 0.0)


@injector("R5")
def not_a_number(site: Site) -> None:
    """One NaN reaches the physics engine, which makes every joint NaN for good."""
    _inside(site, "R5")("corrupt", 0.0)


def _process(site: Site, row: str) -> int:
    if site.child_pid is None:
        raise BadInput("the simulation is no process of its own here; try it in `vita serve`", row)
    return site.child_pid


def _inside(site: Site, row: str) -> Callable[[str, float], None]:
    """The way into the simulation (`vita.sim.mishaps`)."""
    break_in = getattr(site.engine.rig, "break_in", None)
    if break_in is None:
        raise BadInput("this robot is not simulated", row)
    return break_in
