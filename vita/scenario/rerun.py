"""Runs the servo once more on what a recording says was seen, and compares every step to the bit.

A log from which the commands can be had again is a log that leaves nothing out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vita.scenario.record import RunRecord
from vita.servo.controller import Controller
from vita.servo.limits import within_gate
from vita.types import MOVING_STATES, ErrorVector, frozen


@dataclass(frozen=True)
class Rerun:
    """What came of it."""

    ticks: int = 0
    """Ticks in which the servo worked, and was run again."""
    different: tuple[int, ...] = ()
    """Ticks whose steps are not the same to the bit."""
    outside: tuple[tuple[int, str], ...] = ()
    """Ticks in which something else than the servo ended the motion, and the state that followed."""
    why_not: str = ""
    """Why it could not be run again; empty when it could."""

    @property
    def identical(self) -> bool:
        return self.ticks > 0 and not self.different


def rerun(record: RunRecord) -> Rerun:
    """Run the servo on the recorded stamps, joints and errors, from each Start that is in it on."""
    why_not = _why_not(record)
    if why_not:
        return Rerun(why_not=why_not)
    settings = sorted(_settings(record), key=lambda change: change[0])
    controller = Controller(within_gate(record.joints), record.scenario.servo)
    before, known, ticks, different, outside = "", False, 0, [], []
    for i, state in enumerate(record.state):
        now = record.stamp[i - 1] if i else 0.0  # A script's entry is applied between two ticks.
        while settings and settings[0][0] <= now + 1e-9:
            _, name, value = settings.pop(0)
            controller.config = replace(controller.config, **{name: value})
        if before not in MOVING_STATES and state == "learning":
            controller.start()
            known = True
        elif before not in MOVING_STATES and state in MOVING_STATES:
            known = False  # It went on with what it had learned earlier.
        before = state
        if not (known and controller.moving):
            continue
        decision = controller.tick(
            float(record.stamp[i]), record.q[i],
            ErrorVector(frozen(record.error[i]), record.labels, record.weights),
        )  # fmt: skip
        ticks += 1
        step = np.zeros(record.q.shape[1]) if decision is None else decision.dq
        if state not in MOVING_STATES and controller.moving:
            outside.append((i, state))
            controller.halt("stopped_by_user")
            step = np.zeros(record.q.shape[1])
        if step.tobytes() != record.command[i].tobytes():
            different.append(i)
    if different and any("Inject(" in str(event["text"]) for event in record.events):
        return Rerun(why_not="a fault was injected, which changed the steps behind the servo")
    if not ticks:
        return Rerun(why_not="no Start is in it from which the servo could be run again")
    return Rerun(ticks, tuple(different), tuple(outside))


def _why_not(record: RunRecord) -> str:
    if record.scenario.mode != "uvs":
        return "the stereo-impedance mode works on pictures, which are not recorded"
    if not record.joints:
        return "it was made by an older version, which did not record the joints"
    if not len(record.state) == record.ticks == len(record.command) or record.ticks == 0:
        return "it has no ticks"
    if any(e["kind"] == "command" and str(e["text"]).startswith("Set") for e in record.events):
        if "frame" in record.series:
            return "settings were changed on the way"
    if any(_field(entry).startswith("limits.") for entry in record.scenario.script):
        return "the limits were changed on the way"
    return ""


def _settings(record: RunRecord) -> list[tuple[float, str, object]]:
    """When the script changes which servo setting to what."""
    return [
        (entry.at_s, _field(entry).partition(".")[2], entry.arguments["value"])
        for entry in record.scenario.script
        if _field(entry).startswith("servo.")
    ]


def _field(entry: object) -> str:
    return str(entry.arguments.get("field", "")) if entry.do == "set" else ""  # type: ignore[attr-defined]
