"""What `vita check` says of a scenario of the stereo-impedance mode, before anything moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vita.engine import Engine
from vita.impedance.inverse import solve
from vita.poses import pose_matrix
from vita.scenario.schema import Scenario
from vita.servo.insight import Finding
from vita.servo.limits import within_gate

LOOKS = 4
"""Pictures that are looked at."""
SMALL_PX = 25.0
"""A marker whose side is shorter than this is read unreliably [px]."""
NEAR_M, NEAR_RAD = 2e-3, np.radians(1.0)
"""A goal that the arm comes as near to as this is reached."""


def stereo_findings(scenario: Scenario) -> tuple[Finding, ...]:
    """What both cameras see of both markers, how well, and whether the arm reaches the goal at the start.

    Raises `BadInput` when the scenario cannot be set up.
    """
    from vita.sim.lockstep import LockstepRig

    with LockstepRig(scenario) as rig:
        engine = Engine(rig, scenario)
        for _ in range(LOOKS):
            engine.tick()
        return (*_markers(engine, scenario), *_goal(engine, scenario))


def _markers(engine: Engine, scenario: Scenario) -> list[Finding]:
    config, found = scenario.impedance, []
    corners = engine.snapshot().impedance.corners
    for name, number in (("tool", config.tool_marker), ("target", config.target_marker)):
        for camera in (config.left, config.right):
            seen = corners.get((camera, name))
            what = f"marker {number} of the {name}"
            if seen is None:
                text = f"{what} is not seen by camera {camera!r} at the start: turn it or move the cameras"
                found.append(Finding("bad" if name == "tool" else "warning", "marker_unseen", text))
                continue
            side = float(np.linalg.norm(seen - np.roll(seen, 1, axis=0), axis=1).mean())
            if side < SMALL_PX:
                text = f"{what} is only {side:.0f} px wide for camera {camera!r}, wanted: {SMALL_PX:.0f}"
                found.append(Finding("warning", "marker_small", text))
            else:
                text = f"{what} is seen by camera {camera!r}, {side:.0f} px wide"
                found.append(Finding("good", "marker_seen", text))
    return found


def _goal(engine: Engine, scenario: Scenario) -> list[Finding]:
    """Whether the arm can be where the target wants it; uses the simulation's truth, as only a check may."""
    config = scenario.impedance
    kinds = {spec.name: spec.kind for spec in scenario.scene.objects}
    targets = [name for name, kind in kinds.items() if kind in ("target", "marker")]
    if not targets:
        text = "nothing in the scene carries the target's marker: add an object of kind target"
        return [Finding("warning", "no_target", text)]
    arm, seen = engine.rig.arm_model(), engine.observation
    arm = replace(arm, joints=within_gate(engine.rig.joints))
    T_base_goal = engine.rig.poses()[targets[0]] @ pose_matrix(config.offset_xyz, config.offset_rpy_deg)
    turn = config.turn and arm.n >= 6
    solution = solve(arm, seen.q, T_base_goal, turn=turn)
    if solution.position_error_m > NEAR_M or (turn and solution.angle_error_rad > NEAR_RAD):
        text = (
            f"the arm does not reach its goal at {targets[0]!r} as it stands: "
            f"{1e3 * solution.position_error_m:.0f} mm and "
            f"{np.degrees(solution.angle_error_rad):.0f} deg are left"
        )
        return [Finding("warning", "out_of_reach", text)]
    return [Finding("good", "reachable", f"the arm reaches its goal at {targets[0]!r} as it stands")]
