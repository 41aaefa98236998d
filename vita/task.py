"""The task that people edit: trackers and constraints, as an immutable value.

An edit makes a new `Task`; undo puts an old one back. Trackers are live objects, so a deleted one
that comes back goes on from where it last saw its target.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from vita.constraints import Term, constraint_of
from vita.errors import BadInput, UnknownName
from vita.scenario.schema import ConstraintSpec, TrackerSpec
from vita.types import Feature
from vita.vision.base import Tracker

MAX_ITEMS = 64
NAME = re.compile(r"[A-Za-z0-9 _.\-]{1,64}")
LEAST_PRIORITY = 9
"""The least important priority that a constraint may have."""


@dataclass(frozen=True)
class Slot:
    """A tracker of the task: what was asked for and the object that does it."""

    spec: TrackerSpec
    tracker: Tracker


@dataclass(frozen=True)
class Task:
    """Trackers and constraints, in the order in which they were made."""

    slots: tuple[Slot, ...] = ()
    constraints: tuple[ConstraintSpec, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(slot.spec.name for slot in self.slots)

    def slot(self, name: str) -> Slot:
        for slot in self.slots:
            if slot.spec.name == name:
                return slot
        raise UnknownName("tracker", name, self.names)

    def constraint(self, name: str) -> ConstraintSpec:
        for constraint in self.constraints:
            if constraint.name == name:
                return constraint
        raise UnknownName("constraint", name, (c.name for c in self.constraints))

    def terms(self) -> tuple[Term, ...]:
        """The constraints in the form that the stack takes."""
        camera = {slot.spec.name: slot.spec.camera for slot in self.slots}
        return tuple(
            Term(c.name, c.kind, c.points, camera[c.points[0]], c.weight, c.priority)
            for c in self.constraints
        )

    # ---- edits ---------------------------------------------------------------------------------

    def with_tracker(self, slot: Slot) -> Task:
        if len(self.slots) >= MAX_ITEMS:
            raise BadInput(f"a task holds at most {MAX_ITEMS} trackers; delete one first")
        _check_name(slot.spec.name, self.names, "tracker")
        return replace(self, slots=(*self.slots, slot))

    def with_moved(self, name: str, slot: Slot) -> Task:
        self.slot(name)
        return replace(self, slots=tuple(slot if s.spec.name == name else s for s in self.slots))

    def renamed(self, name: str, new: str) -> Task:
        self.slot(name)
        if new == name:
            return self
        _check_name(new, self.names, "tracker")
        slots = tuple(
            replace(s, spec=replace(s.spec, name=new)) if s.spec.name == name else s for s in self.slots
        )
        constraints = tuple(
            replace(c, points=tuple(new if p == name else p for p in c.points)) for c in self.constraints
        )
        return Task(slots, constraints)

    def without_tracker(self, name: str) -> Task:
        """Constraints that use the tracker go with it."""
        self.slot(name)
        return Task(
            tuple(s for s in self.slots if s.spec.name != name),
            tuple(c for c in self.constraints if name not in c.points),
        )

    def with_constraint(self, spec: ConstraintSpec, features: Mapping[str, Feature]) -> Task:
        """Raises `BadInput` on a wrong number of points, two cameras, a repeated point or a line
        that is too short."""
        if len(self.constraints) >= MAX_ITEMS:
            raise BadInput(f"a task holds at most {MAX_ITEMS} constraints; delete one first")
        _check_name(spec.name, (c.name for c in self.constraints), "constraint")
        constraint = constraint_of(spec.kind)
        cameras = {self.slot(p).spec.camera for p in spec.points}
        if not constraint.fits([features[p].points.shape[0] for p in spec.points]):
            raise BadInput(
                f"{constraint.title} takes {constraint.arity} points ({'; '.join(constraint.roles)}), "
                f"got {len(spec.points)} trackers; a line tracker stands for both ends of a line"
            )
        if len(cameras) > 1:
            raise BadInput(f"the points of one constraint must be in one view, got {sorted(cameras)}")
        if len(set(spec.points)) != len(spec.points):
            raise BadInput(f"{constraint.title}: a point is used twice in {list(spec.points)}")
        check_weight(spec.weight)
        check_priority(spec.priority)
        constraint.check(np.concatenate([features[p].points for p in spec.points]))
        return replace(self, constraints=(*self.constraints, spec))

    def without_constraint(self, name: str) -> Task:
        self.constraint(name)
        return replace(self, constraints=tuple(c for c in self.constraints if c.name != name))

    def with_weight(self, name: str, weight: float) -> Task:
        check_weight(weight)
        return self._with(name, weight=weight)

    def with_priority(self, name: str, priority: int) -> Task:
        check_priority(priority)
        return self._with(name, priority=priority)

    def _with(self, name: str, **changes: float) -> Task:
        """The task with a constraint changed. Raises `UnknownName`."""
        self.constraint(name)
        changed = (replace(c, **changes) if c.name == name else c for c in self.constraints)
        return replace(self, constraints=tuple(changed))


def check_weight(weight: object) -> None:
    number = isinstance(weight, (int, float)) and not isinstance(weight, bool)
    if not number or not 0.0 < weight <= 1e3:  # type: ignore[operator]
        raise BadInput(f"a weight is a number above 0 and at most 1000, got {weight!r}")


def check_priority(priority: object) -> None:
    if isinstance(priority, bool) or not isinstance(priority, int) or not 1 <= priority <= LEAST_PRIORITY:
        raise BadInput(f"a priority is 1 (the most important) to {LEAST_PRIORITY}, got {priority!r}")


def free_name(prefix: str, taken: Iterable[str], form: Callable[[str, int], str] = "{}{}".format) -> str:
    """The first of prefix1, prefix2, ... that is not taken."""
    names = set(taken)
    number = 1
    while form(prefix, number) in names:
        number += 1
    return form(prefix, number)


def _check_name(name: str, taken: Iterable[str], what: str) -> None:
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise BadInput(f"{name!r} is no {what} name; use 1 to 64 letters, digits, blanks, '_', '-' or '.'")
    if name in set(taken):
        raise BadInput(f"there is a {what} named {name!r} already; choose another name")
