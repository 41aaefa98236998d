"""How fast the simulated rigs are: the live loop with two 640x480 views, and the lockstep rig.

    python benchmarks/live_loop.py [SECONDS]

The arm moves all the time, since a scene at rest is not drawn again. Medians; trust ratios rather
than absolute times on a machine that does other things as well.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from vita.scenario.schema import CameraSpec, ObjectSpec, Scenario, SceneSpec
from vita.sim.live import LiveRig
from vita.sim.lockstep import LockstepRig
from vita.types import JointStep

SCENARIO = Scenario(
    scene=SceneSpec(objects=(ObjectSpec("card", "card", (0.55, 0.1, 0.02)),), image_noise=1.0),
    camera=(
        CameraSpec("left", look_from=(1.2, -0.9, 0.7), look_at=(0.45, 0.0, 0.25)),
        CameraSpec("right", look_from=(1.2, 0.9, 0.7), look_at=(0.45, 0.0, 0.25)),
    ),
)


def sway(rig, seen, start) -> None:
    """Keep the arm moving to and fro, well within its limits."""
    goal = start + 0.3 * np.sin(2.0 * seen.stamp) * np.ones(len(start))
    rig.command(JointStep(goal - seen.q, seen.q, seen.stamp))


def loop(rig, seconds: float) -> tuple[float, dict[str, float]]:
    """Observations a second, and the median of each timing; `tick` is from one to the next [ms]."""
    start = rig.observe().q
    history: dict[str, list[float]] = {}
    times = []
    until = time.perf_counter() + seconds
    while (now := time.perf_counter()) < until:
        times.append(now)
        sway(rig, rig.observe(), start)
        for name, value in rig.timings().items():
            history.setdefault(name, []).append(value)
    half = len(times) // 4  # The first quarter is warming up.
    hz = (len(times) - 1 - half) / (times[-1] - times[half])
    history["tick"] = list(1e3 * np.diff(times))
    return hz, {name: float(np.median(values[half:])) for name, values in history.items()}


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    with LiveRig(SCENARIO) as live:
        hz, ms = loop(live, seconds)
    print(
        f"live:     {hz:5.1f} Hz   physics {ms['physics']:.1f} ms   render {ms['render']:.1f} ms   "
        f"hand-over {ms['hand_over']:.1f} ms   real-time factor {ms['real_time_factor']:.2f}"
    )
    with LockstepRig(SCENARIO) as lockstep:
        hz, ms = loop(lockstep, seconds)
    print(
        f"lockstep: {hz:5.1f} Hz   {ms['tick']:.1f} ms a tick   physics {ms['physics']:.1f} ms   "
        f"render {ms['render']:.1f} ms"
    )


if __name__ == "__main__":
    main()
