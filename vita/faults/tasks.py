"""Faults of what the task asks (rows T)."""

from __future__ import annotations

from vita import commands as cmd
from vita.commands import Command
from vita.errors import BadInput
from vita.faults.refusal import read, refused, task, text
from vita.faults.registry import injector
from vita.faults.site import Site
from vita.scenario.schema import ConstraintSpec


@injector("T5")
def line_without_length(site: Site) -> None:
    camera = _camera(site)
    line = f'[[tracker]]\nname = "no line"\ncamera = "{camera}"\nkind = "line"\n'
    line += "at = [20, 20]\nto = [21, 20]\n"
    refused("open a file with a line of one pixel", read(text(site) + line))


@injector("T7")
def not_a_number(site: Site) -> None:
    broken = f'[[tracker]]\nname = "nowhere"\ncamera = "{_camera(site)}"\nkind = "fixed"\nat = [nan, 20]\n'
    refused("open a file with a pixel that is no number", read(text(site) + broken))


@injector("T8")
def unknown_camera(site: Site) -> None:
    camera = _camera(site)
    broken = f'[[tracker]]\nname = "lost"\ncamera = "{camera[:-1]}#"\nkind = "fixed"\nat = [20, 20]\n'
    refused("open a file with a tracker in a camera that is not there", read(text(site) + broken))


@injector("T9")
def too_many_trackers(site: Site) -> None:
    one = f'[[tracker]]\nname = "n%d"\ncamera = "{_camera(site)}"\nkind = "fixed"\nat = [20, 20]\n'
    refused("open a file with 1000 trackers", read(text(site) + "".join(one % i for i in range(1000))))


@injector("T1")
def nothing_to_do(site: Site) -> None:
    """Start without a constraint; the task is put back."""
    engine = site.engine
    if engine.moving:
        raise BadInput("stop the arm first; then try to start without a constraint")
    status, empty = engine.active.status, not engine.editor.task.constraints
    if not empty:
        engine.apply(cmd.ClearTask())
    try:
        refused("start without a constraint", lambda: engine.apply(cmd.Start()))
    finally:
        if not empty:
            engine.apply(cmd.Undo())
        engine.active.status = status


@injector("T11")
def edit_in_motion(site: Site) -> None:
    """Delete everything while the arm moves."""
    if not site.engine.moving:
        raise BadInput("press Start first; this is about an arm that moves")
    refused("delete everything while the arm moves", lambda: site.engine.apply(cmd.ClearTask()))


def _camera(site: Site) -> str:
    """The first camera of the scene."""
    for camera in task(site).camera:
        return camera.name
    raise BadInput("the scene has no camera", "scene")


# ---- tasks that cannot be met, or that leave too much to chance --------------------------------------

AWAY_PX = 60.0
"""How far from its goal T4 sends a point a second time."""


def _pair(site: Site) -> ConstraintSpec:
    """A point that is sent to another one, of the task that is loaded."""
    for constraint in task(site).constraint:
        if constraint.kind == "point_to_point":
            return constraint
    raise BadInput("this fault needs a point that is sent to a point; draw one first")


def _drawn(site: Site, row: str, *edits: Command) -> None:
    """Edit the task, until people mend it."""
    before = len(task(site).constraint)
    for edit in edits:
        site.engine.apply(edit)

    def back() -> None:
        if len(task(site).constraint) != before and not site.engine.moving:
            for _ in edits:
                site.engine.apply(cmd.Undo())

    site.tap.undo[row] = back


@injector("T2")
def motions_left_free(site: Site) -> None:
    """The arm is told to stop where the task leaves a joint motion free, as most tasks do."""
    engine = site.engine
    before = engine.controller.config.free_motions
    engine.apply(cmd.SetServo("free_motions", "hold"))
    site.tap.undo["T2"] = lambda: engine.apply(cmd.SetServo("free_motions", before))


@injector("T3")
def the_same_twice(site: Site) -> None:
    """A constraint is drawn a second time: more rows than the arm needs."""
    pair = _pair(site)
    _drawn(site, "T3", cmd.AddConstraint(pair.kind, pair.points, name="the same again"))


@injector("T4")
def two_goals(site: Site) -> None:
    """A point that has a goal gets another one, elsewhere in the picture."""
    pair, engine = _pair(site), site.engine
    camera = next(t.camera for t in task(site).tracker if t.name == pair.points[0])
    uv, frame = engine.editor.features[pair.points[1]].uv, engine.observation.frames[camera]
    u = float(uv[0]) + (AWAY_PX if uv[0] + AWAY_PX < frame.shape[1] - 10.0 else -AWAY_PX)
    goal = cmd.AddTracker(camera, (u, float(uv[1])), "fixed", "elsewhere")
    _drawn(site, "T4", goal, cmd.AddConstraint(pair.kind, (pair.points[0], "elsewhere"), name="second goal"))


@injector("T10")
def one_viewpoint(site: Site) -> None:
    """The second camera is put where the first one is."""
    scene = {spec.name: spec for spec in task(site).camera}
    views = [scene[name] for name in site.engine.rig.cameras if name in site.engine.mode.cameras]
    free = [spec for spec in views if spec.mount is None]
    if len(views) < 2 or len(free) < 2:
        raise BadInput("this fault needs a task in two cameras that stand in the room")
    one, other = free[:2]

    def put(look_from: object, look_at: object) -> None:
        site.engine.rig.perform("move_camera", camera=other.name, look_from=look_from, look_at=look_at)

    put(one.look_from, one.look_at)
    site.tap.undo["T10"] = lambda: put(other.look_from, other.look_at)
