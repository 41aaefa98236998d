"""What one control period costs, headless and in the app's arrangement, with two 640x480 views.

    python benchmarks/loop.py [SECONDS] [SCENARIO]

Runs the task `point_to_point`, or another such as `follow_target`, over and over for SECONDS in lockstep
(everything in this process) and then live (simulation and drawing in a process of their own), and prints
medians. `observe` is physics and drawing headless, and the wait for the next picture live.
"""

from __future__ import annotations

import sys
import time
from statistics import median

import vita
from vita import commands as cmd
from vita.engine import Engine
from vita.rig import SimulatedRig
from vita.scenario.schema import Scenario
from vita.sim.live import LiveRig
from vita.sim.lockstep import LockstepRig

PHASES = ("observe", "track", "servo", "publish")


def measure(rig: SimulatedRig, scenario: Scenario, seconds: float) -> dict[str, float]:
    """Medians over ticks in motion [ms], and the rate of the loop [Hz]."""
    engine = Engine(rig, scenario)
    rows, times = [], []
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        if not engine.moving:
            engine.apply(cmd.ResetArm())
            engine.apply(cmd.Start())
            times.append(None)  # What lies between two runs is no period of the loop.
        snapshot = engine.tick()
        times.append(time.perf_counter())
        rows.append(snapshot.timing.ms)
    periods = [b - a for a, b in zip(times, times[1:], strict=False) if a is not None and b is not None]
    result = {phase: median(row[phase] for row in rows[len(rows) // 4 :]) for phase in PHASES}
    return result | {"hz": 1.0 / median(periods), "mean_hz": len(periods) / sum(periods)}


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    scenario = vita.load(sys.argv[2] if len(sys.argv) > 2 else "point_to_point")
    print(f"{'rig':<10} {'loop Hz':>8} {'mean':>6}  " + "  ".join(f"{p + ' ms':>11}" for p in PHASES))
    for name, make in (("lockstep", LockstepRig), ("live", LiveRig)):
        rig = make(scenario)
        try:
            m = measure(rig, scenario, seconds)
            parts = "  ".join(f"{m[p]:>11.2f}" for p in PHASES)
            print(f"{name:<10} {m['hz']:>8.1f} {m['mean_hz']:>6.1f}  {parts}")
            child = {k: round(v, 2) for k, v in rig.timings().items()}
            print(f"{'':<10} the rig itself: {child}")
        finally:
            rig.close()


if __name__ == "__main__":
    main()
