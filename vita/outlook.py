"""What the servo knows and where it is heading, for the people who watch.

Nothing here moves the arm. The words are made a few times a second, which is as fast as anybody reads.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vita.editing import Editor
from vita.plausible import MotionCheck
from vita.rig import SimulatedRig
from vita.servo import Controller, Finding, Insight
from vita.servo.insight import words
from vita.servo.task_check import examine_task
from vita.types import Array, frozen

EVERY_TICKS = 10
LEAST_MOTION_RAD = 1e-4
"""A smaller step is no news."""
LEAST_MOTION_PX = 0.5


class Outlook:
    """Keeps the latest words; everything else is made anew for each snapshot."""

    def __init__(self) -> None:
        self._tick = 0
        self._of_task: tuple[Finding, ...] = ()
        self._of_estimate: tuple[Finding, ...] = ()
        self._seen: object = None

    def findings(
        self, editor: Editor, controller: Controller, insight: Insight | None
    ) -> tuple[Finding, ...]:
        """The doctor's sentences on the task as it is drawn, and on the estimate once there is one."""
        self._tick += 1
        task, due = editor.task, self._tick % EVERY_TICKS == 1
        if task is not self._seen or (due and not controller.moving):
            self._seen = task
            self._of_task = _examined(editor)
        if insight is None:
            self._of_estimate = ()
        elif due:
            self._of_estimate = words(insight, controller.joints, controller.used)
        return (*self._of_task, *self._of_estimate)


def _examined(editor: Editor) -> tuple[Finding, ...]:
    terms = editor.task.terms()
    if not terms:
        return ()
    fixed = [slot.spec.name for slot in editor.task.slots if slot.spec.kind == "fixed"]
    return examine_task(terms, editor.features, fixed)


def ghost(motion: MotionCheck, dq: Array | None) -> Mapping[str, Array]:
    """Tracker name to (k, 2) where a feature is expected after the joint motion `dq` (n,) [px]."""
    if dq is None or np.abs(dq).max(initial=0.0) < LEAST_MOTION_RAD:
        return {}
    places = motion.predict(dq)
    return {name: frozen(after) for name, (before, after) in places.items() if _moves(before, after)}


def _moves(before: Array, after: Array) -> bool:
    return float(np.abs(after - before).max(initial=0.0)) >= LEAST_MOTION_PX


def ghost_poses(rig: SimulatedRig, q: Array, dq: Array | None) -> Mapping[str, Array]:
    """Body name to (4, 4) T_world_body of the simulated arm after `dq` (n,) [rad]."""
    if dq is None or np.abs(dq).max(initial=0.0) < LEAST_MOTION_RAD:
        return {}
    return rig.poses_at(q + dq)
