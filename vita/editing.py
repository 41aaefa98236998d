"""Edits of the task: placing trackers on live images, constraints, undo, and what gets saved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np

from vita import commands as cmd
from vita.constraints import constraint_of
from vita.errors import BadInput, UnknownName, Untrackable
from vita.rig import SimulatedRig
from vita.scenario.schema import AttachSpec, ConstraintSpec, NoiseSpec, Scenario, TrackerSpec
from vita.sound import Trackers
from vita.task import Slot, Task, free_name
from vita.types import Array, Feature, Observation, frozen
from vita.vision import ProjectedTracker, make_tracker, tracker_seed
from vita.vision.base import Tracker

UNDO_DEPTH = 100
Reports = Callable[[Mapping[str, Feature], Observation], Mapping[str, Feature]]


class Editor:
    """Holds the task with its history, and the latest feature of every tracker.

    `origin` is where the arm and the trackers were when the last tracker was placed. That pair is
    what a saved file holds and what a reset goes back to, so that both show the task as it was drawn,
    not as it ended.
    """

    def __init__(self, rig: SimulatedRig, scenario: Scenario, seen: Observation) -> None:
        self._rig = rig
        self._home = seen.q
        self.task = Task()
        self.features: dict[str, Feature] = {}
        self._trackers = Trackers()
        self._seed = scenario.seed
        self._origin_q = seen.q
        self._origin_uv: dict[Tracker, Array] = {}
        self._past: list[Task] = []
        self._future: list[Task] = []
        self.load(scenario, seen)

    @property
    def can_undo(self) -> bool:
        return bool(self._past)

    @property
    def can_redo(self) -> bool:
        return bool(self._future)

    # ---- every tick ----------------------------------------------------------------------------

    def track(
        self,
        seen: Observation,
        lost: frozenset[str] = frozenset(),
        blind: Mapping[str, str] = MappingProxyType({}),
        tap: Reports | None = None,
    ) -> None:
        """Update every tracker on the frames of `seen`; the names in `lost` are reported lost.

        `blind` names the cameras without a usable picture, and why; what follows something there waits.
        `tap` is where injected faults change what the trackers report.
        """
        features, shapes = {}, {}
        for slot in self.task.slots:
            name, camera = slot.spec.name, slot.spec.camera
            shapes[name] = seen.frames[camera].shape
            if camera in blind:
                why = f"the {camera} camera's picture cannot be used: {blind[camera]}"
                features[name] = self._trackers.lost(name, shapes[name], why)
                continue
            feature = self._trackers.read(name, slot.tracker, seen.frames[camera], seen.stamp)
            if name in lost:
                feature = replace(feature, status="lost", score=0.0, detail="taken away by the script")
            features[name] = feature
        reports = features if tap is None else self._tapped(tap, features, seen)
        self.features = {n: self._trackers.checked(n, reports.get(n), shape) for n, shape in shapes.items()}

    def _tapped(self, tap: Reports, found: Mapping[str, Feature], seen: Observation) -> Mapping[str, Feature]:
        try:
            return tap(found, seen)
        except Exception as failure:  # It stands for trackers that raise.
            why = f"its code failed ({type(failure).__name__}: {failure})"
            return {n: replace(f, status="lost", score=0.0, detail=why) for n, f in found.items()}

    # ---- whole tasks ---------------------------------------------------------------------------

    def start_pose(self, scenario: Scenario) -> Array:
        """(n,) where the arm stands at the start of `scenario` [rad]."""
        q0 = scenario.scene.q0_deg
        return self._home if q0 is None else np.deg2rad(q0)

    def same_scene(self, other: Scenario) -> bool:
        """Whether `other` can run on this rig (its start pose may differ)."""
        mine = replace(self._scenario.scene, q0_deg=None)
        return mine == replace(other.scene, q0_deg=None) and self._scenario.camera == other.camera

    def load(self, scenario: Scenario, seen: Observation) -> None:
        """Take the trackers and constraints of `scenario`, placing each tracker on `seen`.

        Raises `BadInput` naming the culprit; the old task is then kept.
        """
        task, features = Task(), {}
        for spec in scenario.tracker:
            placed = self._located(spec)
            slot = Slot(placed, self._make(placed, seen))
            task = task.with_tracker(slot)
            frame = seen.frames[spec.camera]
            features[spec.name] = self._trackers.read(spec.name, slot.tracker, frame, seen.stamp)
        for constraint in scenario.constraint:
            task = task.with_constraint(constraint, features)
        self._scenario = replace(scenario, script=(), expect=None)
        self._replace_task(task, seen, features)

    def _located(self, spec: TrackerSpec) -> TrackerSpec:
        """An `attach` becomes the pixel where that point is seen now; pixels are all that an image
        tracker gets."""
        if spec.attach is None or spec.kind == "projected":
            return spec
        at = self._projected(spec, spec.attach)
        to = spec.to if spec.attach_to is None else self._projected(spec, spec.attach_to)
        return replace(spec, at=at, to=to, attach=None, attach_to=None)

    def _projected(self, spec: TrackerSpec, attach: AttachSpec) -> tuple[float, float]:
        u, v = self._rig.project(spec.camera, attach.body, attach.point)
        if not (np.isfinite(u) and np.isfinite(v)):
            raise BadInput(
                f"the attached point of {attach.body!r} is behind camera {spec.camera!r}",
                f"tracker {spec.name!r}",
            )
        return float(u), float(v)

    def _make(self, spec: TrackerSpec, seen: Observation) -> Tracker:
        if spec.camera not in seen.frames:
            raise UnknownName("camera", spec.camera, seen.frames)
        frame = seen.frames[spec.camera]
        seed = tracker_seed(self._seed, spec.name)
        if spec.kind == "projected":
            if spec.attach is None:
                raise BadInput("a projected tracker needs `attach`", f"tracker {spec.name!r}")
            where = partial(self._rig.project, spec.camera, spec.attach.body, spec.attach.point)
            size = (frame.shape[1], frame.shape[0])
            away = partial(self._rig.distance, spec.camera, spec.attach.body, spec.attach.point)
            return ProjectedTracker(where, spec.noise or NoiseSpec(), seed, size, distance=away)
        assert spec.at is not None  # The file's validation and `_located` see to it.
        try:
            return make_tracker(spec.kind, frame, spec.at, to=spec.to, size_px=spec.size_px, seed=seed)
        except Untrackable as failure:
            where = f"tracker {spec.name!r} in the {spec.camera} view"
            raise Untrackable(str(failure), where, failure.suggestion) from None

    # ---- single edits --------------------------------------------------------------------------

    def apply(self, command: cmd.Command, seen: Observation) -> None:
        """Carry out one edit. Raises `BadInput` and changes nothing when it cannot."""
        task = self.task
        match command:
            case cmd.Undo():
                self._step_history(self._past, self._future, "undo", seen)
            case cmd.Redo():
                self._step_history(self._future, self._past, "redo", seen)
            case cmd.AddTracker():
                self._commit(task.with_tracker(self._placed(command, seen)), seen)
            case cmd.MoveTracker():
                self._commit(task.with_moved(command.name, self._moved(command, seen)), seen)
            case cmd.RenameTracker():
                self._commit(task.renamed(command.name, command.new), seen)
            case cmd.DeleteTracker():
                self._commit(task.without_tracker(command.name), seen)
            case cmd.AddConstraint():
                title = constraint_of(command.kind).title
                name = command.name or free_name(title, (c.name for c in task.constraints), "{} {}".format)
                spec = ConstraintSpec(name, command.kind, tuple(command.points), command.weight)
                self._commit(task.with_constraint(spec, self.features), seen)
            case cmd.DeleteConstraint():
                self._commit(task.without_constraint(command.name), seen)
            case cmd.SetWeight():
                self._commit(task.with_weight(command.name, command.weight), seen)
            case cmd.SetPriority():
                self._commit(task.with_priority(command.name, command.priority), seen)
            case cmd.ClearTask():
                self._commit(Task(), seen)
            case _:
                raise UnknownName("edit", type(command).__name__, ())

    def _placed(self, command: cmd.AddTracker, seen: Observation) -> Slot:
        uv = _pixel(command.uv)
        prefix = "G" if command.kind == "fixed" else "T"
        name = command.name or free_name(prefix, self.task.names)
        to = None if command.to is None else _pixel(command.to)
        # Two pixels are a line whoever asks, and a saved task must say so.
        kind = "line" if to is not None and command.kind == "auto" else command.kind
        spec = TrackerSpec(name, command.camera, kind, uv, to)
        if spec.kind == "projected":
            raise BadInput("projected trackers come from scenario files; choose `auto` or `fixed`")
        return Slot(spec, self._make(spec, seen))

    def _moved(self, command: cmd.MoveTracker, seen: Observation) -> Slot:
        """A new tracker object takes the name, so that undo can go back to the old one."""
        spec = self.task.slot(command.name).spec
        if spec.kind == "projected":
            raise BadInput(f"{command.name!r} is a projected tracker; it cannot be moved by hand")
        at, to = _pixel(command.uv), None if command.to is None else _pixel(command.to)
        segment = self.features[command.name].segment
        if segment is not None and to is None:
            # A line dragged by its middle keeps its direction and length.
            (u0, v0), (u1, v1) = segment - segment.mean(axis=0) + at
            at, to = (float(u0), float(v0)), (float(u1), float(v1))
        spec = replace(spec, at=at, to=to)
        return Slot(spec, self._make(spec, seen))

    def _commit(self, task: Task, seen: Observation) -> None:
        if task == self.task:
            return
        self._past = [*self._past[-(UNDO_DEPTH - 1) :], self.task]
        self._future = []
        self._replace_task(task, seen)

    def _step_history(self, source: list[Task], other: list[Task], what: str, seen: Observation) -> None:
        if not source:
            raise BadInput(f"nothing to {what}")
        other.append(self.task)
        self._replace_task(source.pop(), seen)

    def _replace_task(
        self, task: Task, seen: Observation, features: Mapping[str, Feature] | None = None
    ) -> None:
        self._trackers.keep([s.spec.name for s in task.slots if s in self.task.slots])
        self.task = task
        if features is None:
            self.track(seen)
        else:
            self.features = dict(features)
        if features is not None or any(slot.tracker not in self._origin_uv for slot in task.slots):
            self._remember_origin(seen)

    # ---- saving --------------------------------------------------------------------------------

    def _remember_origin(self, seen: Observation) -> None:
        self._origin_q = frozen(seen.q)
        self._origin_uv = {s.tracker: self.features[s.spec.name].points for s in self.task.slots}

    def to_save(self) -> Scenario:
        """The scenario that saving now would write."""
        trackers = tuple(
            slot.spec
            if slot.spec.kind == "projected"
            else _at(slot.spec, self._origin_uv[slot.tracker])
            for slot in self.task.slots
        )
        q0 = tuple(round(float(angle), 6) for angle in np.rad2deg(self._origin_q))
        return replace(
            self._scenario,
            scene=replace(self._scenario.scene, q0_deg=q0),
            tracker=trackers,
            constraint=self.task.constraints,
        )


def _pixel(uv: object) -> tuple[float, float]:
    try:
        u, v = (float(x) for x in uv)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise BadInput(f"a pixel is a pair of numbers (column, row), got {uv!r}") from None
    if not (np.isfinite(u) and np.isfinite(v)):
        raise BadInput(f"a pixel needs finite numbers, got {uv!r}")
    return u, v


def _at(spec: TrackerSpec, points: Array) -> TrackerSpec:
    """`spec` placed at the (1, 2) or (2, 2) `points` of its feature."""
    to = _rounded(points[1]) if len(points) == 2 else None
    return replace(spec, at=_rounded(points[0]), to=to)


def _rounded(uv: Array) -> tuple[float, float]:
    """A thousandth of a pixel is below every tracker's noise and keeps files readable."""
    return round(float(uv[0]), 3), round(float(uv[1]), 3)
