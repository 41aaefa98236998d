"""The servo of the drawn constraints on a rig: its trackers, its controller, and what it believes.

The engine asks it for a joint step, or `vita.following.Following` in the other mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from vita.borders import Borders
from vita.constraints import stack
from vita.editing import Editor
from vita.errors import BadInput
from vita.outlook import Outlook
from vita.plausible import MotionCheck
from vita.rig import SimulatedRig
from vita.servo import Controller, Finding, status_for
from vita.servo.config import Limits, ServoConfig
from vita.servo.dropout import HALF_SPEED
from vita.servo.limits import within_gate
from vita.servo.pressed import Pressed
from vita.servo.task_check import contradiction
from vita.types import ErrorVector, Feature, JointStep, Observation

if TYPE_CHECKING:
    from vita import commands as cmd


class Servoing:
    """Raises nothing by itself: a task that is not fit to start is refused by `start`."""

    def __init__(self, rig: SimulatedRig, editor: Editor, config: ServoConfig) -> None:
        self._rig, self._editor = rig, editor
        self.controller = Controller(rig.joints, config)
        self.motion = MotionCheck()
        self._borders = Borders()
        self.leaving = ""
        """The features that are about to leave their views, in words."""
        self.error: ErrorVector = stack((), {})
        """Of the last observation."""
        self._outlook = Outlook()
        self._pressed = Pressed()

    @property
    def cameras(self) -> frozenset[str]:
        """The cameras that the task looks through."""
        return frozenset(term.camera for term in self._editor.task.terms())

    def start(self, command: cmd.Start) -> None:
        """Begin to learn, or to servo. Raises `BadInput` where the task is not fit for it."""
        self.check_task()
        self.motion = MotionCheck(frozenset() if command.relearn else self.motion.carried)
        self._pressed = Pressed()
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
        conflict = contradiction(task.terms(), self._editor.features)
        if conflict:
            raise BadInput(conflict)

    def check_joints(self) -> None:
        """Raise `BadInput` unless the joints that are to be used exist."""
        count = len(self._rig.joints)
        if any(j >= count for j in self.controller.config.joints or ()):
            raise BadInput(f"this robot has joints 0 to {count - 1}", "servo.joints")

    def see(self, seen: Observation) -> None:
        """Take in what the trackers found, where it moved as the joints did."""
        if self.controller.moving:
            self._check_motion(seen)
        self._check_borders(seen)
        self.error = stack(self._editor.task.terms(), self._editor.features)

    def _check_motion(self, seen: Observation) -> None:
        """Take no feature at its word that does not move as the arm does."""
        cameras = {slot.spec.name: slot.spec.camera for slot in self._editor.task.slots}
        verdict = self.motion.judge(
            seen.q, self._editor.features, cameras, exploring=self.controller.status.state == "learning",
            alone=self.controller.config.moving_goal <= 0.0,
        )  # fmt: skip
        self._editor.features = dict(verdict.features)
        if verdict.swapped:
            first, second = verdict.swapped
            culprit = f"{first!r} and {second!r} in the {cameras[first]} view"
            self.controller.halt("trackers_swapped", culprit=culprit)

    def _check_borders(self, seen: Observation) -> None:
        """Take no feature at its word at the border of the picture. Goals drawn on it may be there."""
        slots = [s.spec for s in self._editor.task.slots if s.spec.kind != "fixed"]
        sizes = {spec.name: seen.frames[spec.camera].shape[1::-1] for spec in slots}
        self._editor.features, leaving = self._borders.judge(self._editor.features, sizes)
        cameras = {spec.name: spec.camera for spec in slots}
        words = [f"{name!r} is leaving the {cameras[name]} view" for name in leaving if name in self._used]
        self.leaving = ", ".join(words)

    @property
    def _used(self) -> set[str]:
        """The trackers that constraints use."""
        return {name for constraint in self._editor.task.constraints for name in constraint.points}

    def _slowed(self, scale: float) -> float:
        """Half speed, and the reason told, while a feature is leaving its view."""
        status = self.controller.status
        if not self.leaving:
            return scale
        if status.state == "servoing":
            said = status_for("leaving_view", culprit=self.leaving)
            if status.degraded:
                said = replace(said, reason=status.reason, message=f"{status.message} {said.message}")
            self.controller.status = replace(said, degraded=True)
        return min(scale, HALF_SPEED)

    def decide(self, seen: Observation, limits: Limits) -> JointStep | None:
        """The next joint step; None when nothing is to move."""
        self.controller.joints = within_gate(self._rig.joints)
        decision = self.controller.tick(seen.stamp, seen.q, self.error, self._lost_trackers())
        if decision is None or self._at_a_limit(seen):
            return None
        scale = decision.speed_scale
        if decision.exploring:
            scale = min(scale, limits.explore_speed_rad_s / limits.speed_rad_s)
        return JointStep(decision.dq, seen.q, seen.oldest_s, self._slowed(scale))

    def _at_a_limit(self, seen: Observation) -> bool:
        """Whether a joint has been pressed against its limit for too long; the servo is held then."""
        if self.controller.status.state != "servoing":
            return False
        gate = self._rig.gate_state()["saturated"]
        held = list(gate) if isinstance(gate, (list, tuple)) else []
        joint = self._pressed.update(held, self.error.norm, seen.q)
        if joint is not None:
            self.controller.halt("joint_limit", culprit=f"Joint {self._rig.joints[joint].name}")
        return joint is not None

    def _lost_trackers(self) -> str:
        """The lost trackers by name; the controller itself only sees rows that are missing."""
        task, features = self._editor.task, self._editor.features
        lost = [s.spec for s in task.slots if s.spec.name in self._used and not features[s.spec.name].ok]
        places = (f"{spec.name!r} in the {spec.camera} view{_why(features[spec.name])}" for spec in lost)
        return f"tracker {', '.join(places)}" if lost else ""

    def findings(self) -> Sequence[Finding]:
        """What there is to say about the task, and about what has been learned."""
        return self._outlook.findings(self._editor, self.controller, self.controller.insight)


def _why(feature: Feature) -> str:
    """What a lost tracker says of itself, in brackets."""
    return f" ({feature.detail})" if feature.detail else ""
