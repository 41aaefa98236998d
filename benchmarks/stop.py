"""How long the live arm takes to rest after Stop, from the call that the page's button makes.

    python benchmarks/stop.py [STOPS]

The app's arrangement (simulation and gate in their own process) with an arm that is kept moving at full
speed, stopped at random: on an idle machine, under a flood of clicks, and while large pictures are drawn. The
gate's set points (counted in its cycles) and the measured joints (less than `STILL_RAD` from one picture to
the next) are to stand still. Under the flood, threads submit commands without a pause, and pages click over
their sockets as fast as these take it.
"""

from __future__ import annotations

import random
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

import numpy as np

import vita
from vita import commands as cmd
from vita.faults.attacks import HARMLESS
from vita.fuzz.client import CLICKED, Client
from vita.runner import Runner
from vita.scenario.schema import Scenario
from vita.sim.live import LiveRig
from vita.sim.world import GATE_HZ
from vita.types import JointStep
from vita.ui.app import App

STILL_RAD = 1e-5
SPEED_RAD_S = 0.6
AWAY_RAD = 0.5
"""How far from where it started the arm is led, to and fro [rad]."""
FLOODERS = 4
LARGE = (1280, 960)


@dataclass(frozen=True)
class Rest:
    """One stop."""

    told_ms: float
    """Until the call returned."""
    gate_ms: float
    """Until the gate's set points rested, by the clock on the wall."""
    arm_ms: float
    """Until the period after which the measured joints no longer moved, by the clock on the wall."""
    gate_sim_ms: float
    """Until the gate's set points rested, in cycles of simulated time."""
    arm_sim_ms: float
    """Until the measured joints rested, in simulated time: from the last picture before the call, so that
    up to a period of it was before."""


class Swaying:
    """A runner whose servo leads the arm to and fro at full speed."""

    def __init__(self, scenario: Scenario) -> None:
        self.rig = LiveRig(scenario)
        self.runner = Runner(lambda s: self.rig, scenario)
        self._start = self.runner.snapshot().q
        self.on = threading.Event()
        engine = self.runner._engine
        decide = engine._decide

        def sway() -> JointStep | None:
            if not self.on.is_set():
                return decide()
            seen = engine.observation
            side = 1.0 if int(seen.stamp / 1.5) % 2 else -1.0
            goal = self._start + side * AWAY_RAD * np.ones(len(seen.q))
            return JointStep(goal - seen.q, seen.q, seen.stamp)

        engine._decide = sway

    def go(self) -> None:
        """Move, and be at full speed for a moment."""
        self.rig.release()
        self.on.set()
        tick = self.runner.snapshot().tick
        until = time.monotonic() + 10.0
        speeds = 0
        last = self.runner.snapshot()
        while speeds < 3:
            newer = self.runner.wait_newer(tick, 1.0)
            if time.monotonic() > until:
                raise RuntimeError("the arm does not come up to speed")
            if newer is None or newer.stamp <= last.stamp:
                continue
            speed = np.abs(newer.q - last.q).max() / (newer.stamp - last.stamp)
            speeds, last, tick = (speeds + 1 if speed > 0.95 * SPEED_RAD_S else 0), newer, newer.tick

    def stop(self) -> Rest:
        shared = self.rig._shared
        stamp, cycles = self._newest()[0], shared.cycles
        began = time.perf_counter()
        self.runner.stop()
        told = time.perf_counter() - began
        self.on.clear()
        gate = arm = None
        number = shared.newest
        seen = [(time.perf_counter() - began, *self._newest())]
        while arm is None:
            now = time.perf_counter() - began
            if now > 10.0:
                raise RuntimeError("the arm does not come to rest")
            if gate is None and shared.at_rest:
                gate, cycles = now, shared.rested - cycles
            # A look at the counter costs nothing; copying pictures without a pause would load the machine.
            if shared.newest != number:
                number = shared.newest
                seen.append((now, *self._newest()))
                moved = [float(np.abs(b[2] - a[2]).max()) for a, b in zip(seen, seen[1:], strict=False)]
                if len(moved) >= 3 and max(moved[-3:]) < STILL_RAD:
                    last = max((i for i, way in enumerate(moved) if way >= STILL_RAD), default=-1)
                    arm = seen[last + 1]
            time.sleep(0.001)
        simulated = 1e3 * max(arm[1] - stamp, 0.0)
        return Rest(1e3 * told, 1e3 * (gate or arm[0]), 1e3 * arm[0], 1e3 * cycles / GATE_HZ, simulated)

    def _newest(self) -> tuple[float, np.ndarray]:
        while (seen := self.rig._shared.read(len(self.rig.joints), self.rig._bodies)) is None:
            pass
        return float(seen.numbers["stamp"]), np.array(seen.q)


def measure(scenario: Scenario, stops: int, load: Callable[[Runner], object] | None = None) -> list[Rest]:
    chance = random.Random(1)
    arm = Swaying(scenario)
    with ExitStack() as stack:
        stack.callback(arm.runner.close)
        if load is not None:
            stack.enter_context(load(arm.runner))  # type: ignore[arg-type]
        rests = []
        for _ in range(stops):
            arm.go()
            time.sleep(chance.uniform(0.0, 0.1))
            rests.append(arm.stop())
        return rests


@contextmanager
def flood(runner: Runner) -> Iterator[None]:
    """Threads that submit without a pause, and pages that click as fast as their sockets take it."""
    over = threading.Event()
    app = App(runner, port=0)

    def submit() -> None:
        while not over.is_set():
            runner.submit(cmd.SetServo("gain", 0.2))
            time.sleep(0.0002)

    def click() -> None:
        try:
            with Client(app.door.own_address, headers=app.door.badge) as page:
                button = page.widget(HARMLESS, *CLICKED).uuid
                while not over.is_set() and page.open:
                    page.send_value(button, True)
        except OSError:
            pass  # It was shown out for flooding, as it should be.

    threads = [threading.Thread(target=work, daemon=True) for work in [submit] * FLOODERS + [click] * 2]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        over.set()
        for thread in threads:
            thread.join(timeout=5.0)
        app.close()


def large(scenario: Scenario) -> Scenario:
    return replace(scenario, camera=tuple(replace(camera, size=LARGE) for camera in scenario.camera))


def row(name: str, rests: list[Rest]) -> str:
    cells = [f"{name:26}", f"{len(rests):5}"]
    for field in ("told_ms", "gate_ms", "arm_ms", "gate_sim_ms", "arm_sim_ms"):
        values = [getattr(rest, field) for rest in rests]
        cells.append(f"{np.percentile(values, 50):8.2f} /{np.percentile(values, 99):7.2f}")
    return "  ".join(cells)


def main() -> None:
    stops = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    scenario = replace(vita.load("point_to_point"), tracker=(), constraint=())
    print("Stop to rest [ms], p50 / p99; the arm at full speed")
    names = ("call returns", "gate, wall", "arm, wall", "gate, simulated", "arm, simulated")
    print(f"{'':26}  stops  " + "  ".join(f"{name:>17}" for name in names))
    print(row("idle", measure(scenario, stops)), flush=True)
    print(row("under a flood", measure(scenario, stops, flood)), flush=True)
    print(row(f"drawing {LARGE[0]}x{LARGE[1]}", measure(large(scenario), stops)), flush=True)


if __name__ == "__main__":
    main()
