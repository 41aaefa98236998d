"""The servo of the drawn constraints on a rig: its trackers, its controller, and what it believes.

The engine asks it for a joint step, or `vita.following.Following` in the other mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vita.constraints import stack
from vita.editing import Editor
from vita.errors import BadInput
from vita.outlook import Outlook
from vita.plausible import MotionCheck
from vita.rig import SimulatedRig
from vita.servo import Controller, Finding
from vita.servo.config import Limits, ServoConfig
from vita.servo.limits import within_gate
from vita.types import ErrorVector, JointStep, Observation

if TYPE_CHECKING:
    from vita import commands as cmd


class Servoing:
    """Raises nothing by itself: a task that is not fit to start is refused by `start`."""

    def __init__(self, rig: SimulatedRig, editor: Editor, config: ServoConfig) -> None:
        self._rig, self._editor = rig, editor
        self.controller = Controller(rig.joints, config)
        self.motion = MotionCheck()
        self.error: ErrorVector = stack((), {})
        """Of the last observation."""
        self._outlook = Outlook()

    @property
    def cameras(self) -> frozenset[str]:
        """The cameras that the task looks through."""
        return frozenset(term.camera for term in self._editor.task.terms())

    def start(self, command: cmd.Start) -> None:
        """Begin to learn, or to servo. Raises `BadInput` where the task is not fit for it."""
        self.check_task()
        self.motion = MotionCheck()
        self.controller.joints = within_gate(self._rig.joints)
        self.check_joints()
        self._rig.release()
        self.controller.start(relearn=command.relearn)

    def check_task(self) -> None:
        """Raise `BadInput` unless there are constraints and their trackers see what they follow."""
        task = self._editor.task
        if not task.constraints:
            raise BadInput("there is no constraint yet: pick a kind and click its features, then Start")
        lost = [n for n, f in self._editor.features.items() if not f.ok]
        used = {p for c in task.constraints for p in c.points}
        if used.intersection(lost):
            names = ", ".join(repr(n) for n in lost if n in used)
            raise BadInput(f"lost tracker {names}: drag it onto its feature or delete it, then Start")

    def check_joints(self) -> None:
        """Raise `BadInput` unless the joints that are to be used exist."""
        count = len(self._rig.joints)
        if any(j >= count for j in self.controller.config.joints or ()):
            raise BadInput(f"this robot has joints 0 to {count - 1}", "servo.joints")

    def see(self, seen: Observation) -> None:
        """Take in what the trackers found, where it moved as the joints did."""
        if self.controller.moving:
            self._check_motion(seen)
        self.error = stack(self._editor.task.terms(), self._editor.features)

    def _check_motion(self, seen: Observation) -> None:
        """Take no feature at its word that does not move as the arm does."""
        cameras = {slot.spec.name: slot.spec.camera for slot in self._editor.task.slots}
        verdict = self.motion.judge(seen.q, self._editor.features, cameras)
        self._editor.features = dict(verdict.features)
        if verdict.swapped:
            first, second = verdict.swapped
            culprit = f"{first!r} and {second!r} in the {cameras[first]} view"
            self.controller.halt("trackers_swapped", culprit=culprit)

    def decide(self, seen: Observation, limits: Limits) -> JointStep | None:
        """The next joint step; None when nothing is to move."""
        self.controller.joints = within_gate(self._rig.joints)
        decision = self.controller.tick(seen.stamp, seen.q, self.error, self._lost_trackers())
        if decision is None:
            return None
        scale = decision.speed_scale
        if decision.exploring:
            scale = min(scale, limits.explore_speed_rad_s / limits.speed_rad_s)
        return JointStep(decision.dq, seen.q, seen.stamp, scale)

    def _lost_trackers(self) -> str:
        """The lost trackers by name; the controller itself only sees rows that are missing."""
        task, features = self._editor.task, self._editor.features
        used = {name for constraint in task.constraints for name in constraint.points}
        lost = [s.spec for s in task.slots if s.spec.name in used and not features[s.spec.name].ok]
        places = ", ".join(f"{spec.name!r} in the {spec.camera} view" for spec in lost)
        return f"tracker {places}" if lost else ""

    def findings(self) -> Sequence[Finding]:
        """What there is to say about the task, and about what has been learned."""
        return self._outlook.findings(self._editor, self.controller, self.controller.insight)
