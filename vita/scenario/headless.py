"""Runs a scenario without a browser: the same engine, a lockstep simulation, a script of events."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from vita import commands as cmd
from vita.engine import Engine
from vita.evidence import told
from vita.rig import SimulatedRig
from vita.scenario.judge import final_distance_mm, judged
from vita.scenario.record import RunRecord
from vita.scenario.schema import Scenario, ScriptSpec
from vita.scenario.truth_log import TruthLog
from vita.servo import outcome_of
from vita.snapshot import Snapshot
from vita.types import Array, JointStep, frozen

REST_TICKS = 15
"""Ticks after the end, to see that the arm rests and stays [frame periods]."""
DEFAULT_END_S = 120.0


@dataclass
class _Recorder:
    """Collects what every tick leaves."""

    truth: TruthLog
    snapshots: list[Snapshot] = field(default_factory=list)
    commands: list[JointStep | None] = field(default_factory=list)

    def add(self, snapshot: Snapshot, step: JointStep | None) -> None:
        self.snapshots.append(replace(snapshot, frames={}))  # Images would fill the memory.
        self.commands.append(step)
        self.truth.note(snapshot)


def run_scenario(
    scenario: Scenario,
    *,
    realtime: bool = False,
    progress: Callable[[Snapshot], None] | None = None,
    name: str = "",
    rig: SimulatedRig | None = None,
) -> RunRecord:
    """Run `scenario` to its end and judge it. Deterministic unless `realtime`, which only waits.

    Raises `BadInput` for a scenario that cannot be set up, `MissingDependency` without a simulator.
    """
    if rig is None:
        from vita.sim.lockstep import LockstepRig

        rig = LockstepRig(scenario)
    try:
        engine = Engine(rig, scenario)
        recorder = _Recorder(TruthLog(rig, scenario))
        began = time.perf_counter()
        _loop(engine, scenario, recorder, lambda s: _pace(s, began, realtime, progress))
        return _record(engine, scenario, recorder, name)
    finally:
        rig.close()


def _loop(engine: Engine, scenario: Scenario, recorder: _Recorder, each: Callable[[Snapshot], None]) -> None:
    """Tick until the script is over and the servo has come to an end, then a few ticks of rest."""
    entries = sorted(scenario.script, key=lambda entry: entry.at_s)
    if not any(entry.do == "start" for entry in entries):
        entries.insert(0, ScriptSpec(0.0, "start"))
    last_s = max(entry.at_s for entry in entries)
    within = scenario.expect.within_s if scenario.expect and scenario.expect.within_s else 0.0
    longest_s = scenario.servo.timeout_s if scenario.mode == "uvs" else scenario.impedance.timeout_s
    give_up_s = last_s + max(within, min(longest_s, DEFAULT_END_S)) + 1.0
    rest = 0
    while rest < REST_TICKS:
        now = engine.observation.stamp
        while entries and entries[0].at_s <= now + 1e-9:
            engine.apply(command_of(entries.pop(0)))
        snapshot = engine.tick()
        recorder.add(snapshot, engine.last_step)
        each(snapshot)
        if snapshot.stamp > give_up_s and engine.moving:
            engine.stop("timeout")
        rest = 0 if engine.moving or entries else rest + 1


def command_of(entry: ScriptSpec) -> cmd.Command:
    """The command that a script entry stands for; what is none of ours goes to the simulation."""
    if entry.do == "start":
        return cmd.Start()
    if entry.do == "stop":
        return cmd.Halt()
    if entry.do == "set":
        table, _, name = str(entry.arguments["field"]).partition(".")
        value = entry.arguments["value"]
        change = {"servo": cmd.SetServo, "limits": cmd.SetLimits, "impedance": cmd.SetImpedance}[table]
        return change(name, value)
    return cmd.Perform(entry.do, dict(entry.arguments))


def _pace(
    snapshot: Snapshot, began: float, realtime: bool, progress: Callable[[Snapshot], None] | None
) -> None:
    if progress is not None:
        progress(snapshot)
    if realtime:
        time.sleep(max(0.0, began + snapshot.stamp - time.perf_counter()))


def _record(engine: Engine, scenario: Scenario, recorder: _Recorder, name: str) -> RunRecord:
    snapshots = recorder.snapshots
    end = len(snapshots) - REST_TICKS  # The tick at which the end was declared comes just before.
    last = snapshots[-1]
    ticks, n, m = len(snapshots), last.q.size, last.error.values.size
    trackers = tuple(last.features)
    distance = final_distance_mm(engine.rig, scenario)
    states = tuple(s.status.state for s in snapshots)
    ended_s = snapshots[max(end, 0)].stamp
    q = np.array([s.q for s in snapshots])
    motion_after = float(np.rad2deg(np.ptp(q[max(end, 0) :], axis=0).max()))
    verdict = judged(
        scenario, last.status, ended_s, last.error.largest, distance, motion_after, recorder.truth
    )
    outcome = outcome_of(last.status)
    blank = np.full((m, n), np.nan)
    return RunRecord(
        scenario=scenario,
        outcome=outcome,
        reason=last.status.reason,
        message=last.status.message,
        ticks=ticks,
        sim_time_s=ended_s,
        final_error_px=last.error.largest,
        expect=verdict,
        # A file that expects nothing is still expected to get there.
        passed=all(verdict.values()) if verdict else outcome in ("converged", "limited"),
        stamp=np.array([s.stamp for s in snapshots]),
        q=q,
        error=np.array([s.error.values for s in snapshots]),
        labels=last.error.labels,
        weights=last.error.weights,
        command=np.array([np.zeros(n) if step is None else step.dq for step in recorder.commands]),
        state=states,
        trackers=trackers,
        uv=np.array([[s.features[t].uv for t in trackers] for s in snapshots]).reshape(ticks, -1, 2),
        seen=np.array([[s.features[t].ok for t in trackers] for s in snapshots]).reshape(ticks, -1),
        jacobian=np.array([s.jacobian if s.jacobian.shape == (m, n) else blank for s in snapshots]),
        final_distance_mm=distance,
        name=name,
        joints=last.joints,
        events=told(engine.ring.take()[1]),
        series=recorder.truth.series() | _seen_series(snapshots) if scenario.mode == "impedance" else {},
    )


def _seen_series(snapshots: list[Snapshot]) -> dict[str, Array]:
    """What the stereo-impedance mode said of itself, tick by tick."""
    views = [snapshot.impedance for snapshot in snapshots]
    blank = np.full(3, np.nan)
    return {
        "error_mm": frozen([view.error_mm for view in views]),
        "error_deg": frozen([view.error_deg for view in views]),
        "energy_j": frozen([view.energy_j for view in views]),
        "mass": frozen([blank if v.T_base_mass is None else v.T_base_mass[:3, 3] for v in views]),
        "goal": frozen([blank if v.T_base_goal is None else v.T_base_goal[:3, 3] for v in views]),
        "target": frozen([blank if v.T_base_target is None else v.T_base_target[:3, 3] for v in views]),
    }
