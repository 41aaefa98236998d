"""How long the live arm takes to rest after Stop, from the call that the page's button makes.

    python benchmarks/stop.py [TIMES]

Starts the task `point_to_point` in the app's arrangement (simulation in its own process), stops it at random
in motion, and takes the time until the measured joints no longer change.
"""

from __future__ import annotations

import random
import sys
import time

import numpy as np

import vita
from vita import commands as cmd
from vita.runner import Runner, live_runner


def until(runner: Runner, states: tuple[str, ...]) -> None:
    while runner.snapshot().status.state not in states:
        time.sleep(0.002)


def seconds_to_rest(runner: Runner) -> float:
    """Stop now; the arm rests from the first of three equal measurements on."""
    runner.stop()
    began = time.perf_counter()
    seen: list[tuple[float, np.ndarray]] = []
    while len(seen) < 4 or np.abs(np.ptp([q for _, q in seen[-3:]], axis=0)).max() > 1e-6:
        tick = runner.snapshot().tick
        newer = runner.wait_newer(tick, 1.0)
        if newer is not None:
            seen.append((time.perf_counter() - began, newer.q))
    return seen[-3][0]


def main() -> None:
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    random.seed(1)
    runner = live_runner(vita.load("point_to_point"))
    rests = []
    try:
        for _ in range(times):
            runner.submit(cmd.ResetArm())
            until(runner, ("idle",))
            runner.submit(cmd.Start())
            until(runner, ("learning", "servoing"))
            time.sleep(random.uniform(0.3, 4.0))
            if runner.snapshot().status.state in ("learning", "servoing"):
                rests.append(seconds_to_rest(runner))
    finally:
        runner.close()
    print(f"{len(rests)} stops: median {np.median(rests):.3f} s, largest {max(rests):.3f} s to rest")


if __name__ == "__main__":
    main()
