"""The bench on which the rows of the catalogue are tried: physics, gate and engine, stepped by hand.

Six points of the tool, three in each of two views, are driven to where they are at `GOAL_DEG`. The
trackers are projected with noise, so that a run costs little; the pictures are really drawn, small.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from vita import commands as cmd
from vita.engine import Engine
from vita.faults import CATALOGUE, inject
from vita.scenario.schema import (
    AttachSpec,
    CameraSpec,
    ConstraintSpec,
    NoiseSpec,
    Scenario,
    SceneSpec,
    ServoConfig,
    TrackerSpec,
)
from vita.sim.lockstep import LockstepRig
from vita.snapshot import Snapshot
from vita.types import Array

START_DEG = (0.0, 40.0, 0.0, 90.0, 0.0, 45.0, 0.0)
GOAL_DEG = (14.0, 50.0, 0.0, 76.0, 0.0, 45.0, 0.0)
POINTS = ((0.0, 0.0, 0.12), (0.03, 0.0, 0.06), (0.0, 0.03, 0.06))
"""In the frame of the tool [m]."""
NOISE_PX = 0.2


def row(name: str) -> pytest.MarkDecorator:
    """Marks a test as the proof of one row of the catalogue."""
    assert name in CATALOGUE, name
    return pytest.mark.fault(name)


@lru_cache
def task() -> Scenario:
    """Three points in each of two views, on four joints."""
    cameras = tuple(
        CameraSpec(name, look_from=(1.4, y, 0.75), look_at=(0.62, 0.0, 0.42), fov_deg=36, size=(320, 240))
        for name, y in (("left", -0.75), ("right", 0.75))
    )
    scene = SceneSpec(robot="wam7", q0_deg=START_DEG, tool="none")
    with LockstepRig(Scenario(title="goal", scene=replace(scene, q0_deg=GOAL_DEG), camera=cameras)) as rig:
        rig.observe()
        goals = [tuple(rig.locate("flange", point).tolist()) for point in POINTS]
    trackers, constraints = [], []
    for camera in ("left", "right"):
        side = camera[0]
        for i, (point, goal) in enumerate(zip(POINTS, goals, strict=True)):
            noise = NoiseSpec("gaussian", sigma_px=NOISE_PX)
            trackers += [
                TrackerSpec(
                    f"tip{i}_{side}", camera, "projected", attach=AttachSpec("flange", point), noise=noise
                ),
                TrackerSpec(f"goal{i}_{side}", camera, "projected", attach=AttachSpec("world", goal)),
            ]
            names = (f"tip{i}_{side}", f"goal{i}_{side}")
            constraints.append(ConstraintSpec(f"meet {i} {camera}", "point_to_point", names))
    return Scenario(
        title="bench", seed=3, scene=scene, camera=cameras, tracker=tuple(trackers),
        constraint=tuple(constraints), servo=ServoConfig(joints=(0, 1, 2, 3)),
    )  # fmt: skip


class Bench:
    """An engine on a lockstep rig; every step of time is asked for."""

    def __init__(self, scenario: Scenario | None = None) -> None:
        self.rig = LockstepRig(scenario or task())
        self.engine = Engine(self.rig, scenario or task())

    def close(self) -> None:
        self.rig.close()

    def tick(self, count: int = 1) -> Snapshot:
        """So many control periods."""
        snapshot = self.engine.snapshot()
        for _ in range(count):
            snapshot = self.engine.tick()
        return snapshot

    def until(self, wanted: Callable[[Snapshot], bool] | str, most: int = 400) -> tuple[Snapshot, int]:
        """Tick until a state is reached or a condition holds; the snapshot, and how many ticks it took."""
        reached = (lambda s: s.status.state == wanted) if isinstance(wanted, str) else wanted
        for count in range(1, most + 1):
            snapshot = self.engine.tick()
            if reached(snapshot):
                return snapshot, count
        raise AssertionError(f"{wanted} was not reached in {most} ticks: {self.engine.status}")

    def start(self, servoing: int = 3) -> Snapshot:
        """Start, learn, and servo for a few periods."""
        self.engine.apply(cmd.Start())
        self.until("servoing")
        return self.tick(servoing)

    def inject(self, name: str) -> None:
        inject(name, self.engine.site)

    def rests_after(self, ticks: int = 4) -> None:
        """The arm comes to rest within `ticks` periods, and stays."""
        self.tick(ticks)
        before: Array = self.tick().q
        assert self.rig.gate_state()["at_rest"]
        assert np.allclose(self.tick(5).q, before, atol=1e-4)


@pytest.fixture
def bench():
    made = Bench()
    yield made
    made.close()
