"""What `vita check` says of a valid scenario: explored and searched in simulation, told in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vita.engine import Engine
from vita.scenario.schema import Scenario
from vita.scenario.second_solution import CONDITION, Search, Solution, find_second_solutions
from vita.scenario.view_check import point_views, view_findings
from vita.servo.doctor import Diagnosis, diagnose
from vita.servo.insight import Finding
from vita.servo.task_check import examine_task
from vita.sim.twin import Twin
from vita.types import Array

LONGEST_TICKS = 3000
"""Exploring is given up after so many frame periods."""
UNKNOWN = 0.02
"""Relative deviation of an explored Jacobian, where the servo has not come to say its own."""
SIGMA_PX = 0.3
"""Noise of an error row, where the servo has not measured it [px]."""
FOLLOWS = "the target draws the tool: its place and, for arms of six joints and more, its orientation"
ORDER = {"bad": 0, "warning": 1, "info": 2, "good": 3}


@dataclass(frozen=True)
class Checkup:
    """Everything that was found out, the worst first in `findings`."""

    freedom: str
    """How many joint motions the task holds, in one sentence."""
    diagnosis: Diagnosis | None
    """None without constraints, or when exploring failed."""
    search: Search
    findings: tuple[Finding, ...]

    def summary(self) -> dict[str, Any]:
        """Plain data for JSON."""
        d = self.diagnosis
        table: dict[str, Any] = {"freedom": self.freedom}
        if d is not None:
            table |= {
                "rows": d.rows, "held": d.held, "joints": d.joints, "free": list(d.free),
                "needed": list(d.needed), "redundant": list(d.redundant), "conflicting": list(d.conflicting),
                "condition": round(d.condition, 2) if np.isfinite(d.condition) else None,
            }  # fmt: skip
        table["second_solutions"] = [
            {
                "angle_deg": round(s.angle_deg, 2), "shift_mm": round(s.shift_mm, 2), "rank": s.rank,
                "reachable": s.reachable, "unseen": list(s.unseen),
            }
            for s in self.search.others
        ]  # fmt: skip
        table["findings"] = [{"level": f.level, "code": f.code, "text": f.text} for f in self.findings]
        return table


def check_up(scenario: Scenario) -> Checkup:
    """Explore and search `scenario` in simulation. Raises `BadInput` when it cannot be set up."""
    if scenario.mode == "impedance":
        from vita.scenario.stereo_check import stereo_findings

        found = sorted(stereo_findings(scenario), key=lambda f: ORDER[f.level])
        return Checkup(FOLLOWS, None, Search(None), tuple(found))
    if not scenario.constraint:
        return Checkup("no constraints: nothing holds the arm", None, Search(None), ())
    twin = Twin(scenario)
    engine, jacobian = _explore(scenario)
    findings = list(_of_drawing(engine))
    names = [joint.name for joint in twin.joints]
    used = list(engine.controller.used)
    diagnosis = None
    if jacobian is None:
        message = f"The exploratory motions did not succeed: {engine.controller.status.message}"
        findings.append(Finding("bad", "not_explored", message))
        freedom = engine.controller.status.message
    else:
        diagnosis = _diagnosed(engine, jacobian, [names[j] for j in used])
        # Contradictions are looked for below in the exact geometry: far from the goal, to first order
        # hardly says anything.
        findings += [f for f in diagnosis.findings if f.code not in ("held", "conflict")]
        freedom = _freedom(diagnosis)
        findings += _too_faint(twin, used, diagnosis)
    search = find_second_solutions(twin)
    findings += _of_search(twin, search)
    at = twin.q0 if search.first is None or search.first.q is None else search.first.q
    findings += view_findings(point_views(twin, at))
    findings.sort(key=lambda f: ORDER[f.level])
    return Checkup(freedom, diagnosis, search, _once(findings))


def degrees_of_freedom(scenario: Scenario) -> str:
    """A sentence on how many joint motions the task holds, found by exploring in simulation."""
    if scenario.mode == "impedance":
        return FOLLOWS
    if not scenario.constraint:
        return "no constraints: nothing holds the arm"
    engine, jacobian = _explore(scenario)
    if jacobian is None:
        return engine.controller.status.message
    names = [joint.name for joint in engine.controller.joints]
    return _freedom(_diagnosed(engine, jacobian, [names[j] for j in engine.controller.used]))


def _explore(scenario: Scenario) -> tuple[Engine, Array | None]:
    """The engine after exploring, and the Jacobian (m, n) that a run would learn first [px/rad]; None with
    the reason in the controller. Uses the trackers on rendered images, as a run would."""
    from vita.sim.lockstep import LockstepRig

    with LockstepRig(scenario) as rig:
        engine = Engine(rig, scenario)
        engine.controller.start(even_if_met=True)
        for _ in range(LONGEST_TICKS):
            engine.tick()
            if engine.controller.status.state != "learning":
                break
    jacobian = engine.controller.jacobian
    return engine, jacobian if jacobian.size else None


def _of_drawing(engine: Engine) -> tuple[Finding, ...]:
    slots = engine.editor.task.slots
    fixed = [slot.spec.name for slot in slots if slot.spec.kind == "fixed"]
    return examine_task(engine.editor.task.terms(), engine.editor.features, fixed)


def _diagnosed(engine: Engine, jacobian: Array, names: Sequence[str]) -> Diagnosis:
    controller, error = engine.controller, engine.error
    weighted = error.weights[:, None] * jacobian[:, list(controller.used)]
    known = controller.insight
    # The servo's own figures, so that the page, this check and the servo agree.
    deviation = UNKNOWN if known is None else known.uncertainty
    variance = max(deviation**2 * float(np.mean(weighted**2)), 1e-12)
    sigma = controller.sigma_px if np.isfinite(controller.sigma_px) else SIGMA_PX
    rank = None if known is None else known.held
    return diagnose(weighted, variance, error.labels, error.weights * error.values, names, sigma, rank)


def _freedom(found: Diagnosis) -> str:
    text = f"{found.rows} error rows hold {found.held} of {found.joints} joint motions"
    if found.held < found.joints:
        text += "; the others stay free (the smallest motion is taken)"
    if found.rows > found.held:
        text += f"; {found.rows - found.held} more than it takes"
    return text


def _too_faint(twin: Twin, used: Sequence[int], found: Diagnosis) -> list[Finding]:
    """Directions that the exact geometry holds, but the trackers could not tell from noise."""
    values = np.linalg.svd(twin.weights[:, None] * twin.joint_jacobian(twin.q0)[:, used], compute_uv=False)
    exact = int(np.count_nonzero(values > values[0] / CONDITION)) if values.size else 0
    if exact <= found.held:
        return []
    more = exact - found.held
    text = (
        f"The geometry holds {exact} joint motions, {more} more than the trackers could tell from noise by "
        "exploring: the servo finds them on the way. Larger exploratory motions (servo.explore_deg) or "
        "points farther apart show them at once."
    )
    return [Finding("info", "faint", text)]


def _of_search(twin: Twin, search: Search) -> list[Finding]:
    findings = []
    first = search.first
    if first is not None and "cannot be met" in search.skipped:
        state = twin.bodies_of_hand(first.T_world_tool) if first.q is None else twin.bodies(first.q)
        error = np.abs(twin.error(state))
        worst = dict.fromkeys(twin.labels[i].constraint for i in np.argsort(-error)[:3])
        text = (
            f"No pose of the hand meets everything: at best {error.max():.1f} px are left, most at "
            f"{' and '.join(repr(name) for name in list(worst)[:2])}. Move their goals, or delete one."
        )
        findings.append(Finding("bad", "conflict", text))
    elif search.skipped:
        findings.append(Finding("info", "many_ends", f"No second solution was looked for: {search.skipped}."))
    elif first is not None and first.q is None:
        text = "The arm cannot bring the hand where the task is met: out of reach, or beyond a joint's limit."
        findings.append(Finding("bad", "out_of_reach", text))
    if first is not None and not search.skipped and not search.others:
        findings.append(Finding("good", "one_solution", "The search found no second way to meet the task."))
    findings += [_second(search, other) for other in search.others[:3]]
    return findings


def _second(search: Search, other: Solution) -> Finding:
    where = f"turned by {other.angle_deg:.0f} degrees about the tool's {axis_words(other.axis)}"
    if other.shift_mm >= 1.0:
        where += f" and {other.shift_mm:.0f} mm aside"
    text = f"The task is also met with the hand {where} (it holds {other.rank} motions there, too)"
    if not other.reachable:
        return Finding("info", "second_solution", f"{text}; the arm cannot reach that.")
    if other.unseen:
        text += f"; {len(other.unseen)} trackers would be hidden there"
    if search.farthest_px < 1.0:
        advice = ": all drawn features look the same there. Add another point of the hand, or a second view."
    else:
        advice = (
            f". The start decides which one it is. Add a constraint: {search.farthest!r} would be "
            f"{search.farthest_px:.0f} px elsewhere, so tie it to a point."
        )
    return Finding("warning", "second_solution", text + advice)


def axis_words(axis: Array) -> str:
    """A unit axis (3,) of the tool's frame: `y axis` when it is within ten degrees, else its components."""
    k = int(np.argmax(np.abs(axis)))
    if abs(axis[k]) > np.cos(np.radians(10.0)):
        return f"{'xyz'[k]} axis"
    return "axis [" + ", ".join(f"{value:.2f}" for value in axis) + "]"


def _once(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    return tuple(dict.fromkeys(findings))
