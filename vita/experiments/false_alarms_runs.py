"""Runs of the real engine on random tasks, healthy or with one injected fault, and what became of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vita import commands as cmd
from vita.engine import Engine
from vita.experiments.false_alarms_rig import ArmRig, scenario_of
from vita.experiments.starts import random_starts
from vita.experiments.trial import World
from vita.faults import inject

ROBOT = "wam7"
NOISE_PX = (0.2, 0.43)
"""Tracker noise, drawn anew for each run: the thesis' Gaussian tracker, and a worse one."""
TOLERANCE = 7.0
"""A task is done at so many times the noise: below about five, noise alone keeps it from being done."""
LONGEST = 600
"""Control periods after which a run is ended."""
WAIT, WATCH = 10, 60
"""A fault comes within so many first periods of servoing; for so many it is watched."""


@dataclass(frozen=True)
class Fate:
    """What became of one run."""

    row: str
    """Of the catalogue; empty for a healthy run."""
    run: int
    noise_px: float
    reason: str
    """Why the run ended, or what was said first after the fault came."""
    degraded: bool
    """Whether the arm ever went at half speed, before the end or when the fault was noticed."""
    periods: float
    """From the fault until it was noticed; NaN if it never was."""
    travel_m: float
    """How far the tool came from where it was then, until it was at rest; NaN without a fault."""
    honest_m: float
    """How far it was from the goal then."""


def run_some(row: str, first: int, count: int, seed: int) -> list[Fate]:
    """The runs `first` to `first + count` with the fault of `row`, or healthy ones where it is empty."""
    world = random_starts(ROBOT, first + count, seed)
    return [run_one(world, row, run, seed) for run in range(first, first + count)]


def run_one(world: World, row: str, run: int, seed: int) -> Fate:
    """One run on task `run` of `world`."""
    random = np.random.default_rng([seed, run])
    noise, wait = random.uniform(*NOISE_PX), int(random.integers(1, WAIT))
    scenario = scenario_of(world, run, noise, seed + run)
    config = replace(scenario.servo, tolerance_px=TOLERANCE * noise)
    rig = ArmRig(world, run)
    engine = Engine(rig, replace(scenario, servo=config))
    engine.apply(cmd.Start())
    degraded, servoing = False, 0
    for _ in range(LONGEST):
        snapshot = engine.tick()
        servoing += snapshot.status.state == "servoing"
        degraded |= snapshot.status.degraded
        if not engine.moving:
            break
        if row and servoing >= wait:
            return _with_fault(engine, rig, world, row, run, noise)
    return Fate(row, run, noise, engine.status.reason, degraded, np.nan, np.nan, np.nan)


def _with_fault(engine: Engine, rig: ArmRig, world: World, row: str, run: int, noise: float) -> Fate:
    """Go on with the fault, until the arm is at rest or has gone on without noticing for long enough."""
    inject(row, engine.site)
    start = rig.tool_m
    honest = float(np.linalg.norm(world.arm.pose(world.goal[run])[:3, 3] - start))
    noticed, reason, slow, travel = np.nan, "", False, 0.0
    for period in range(1, WATCH + 1):
        status = engine.tick().status
        travel = max(travel, float(np.linalg.norm(rig.tool_m - start)))
        if np.isnan(noticed) and (status.degraded or status.state in ("hold", "fault")):
            noticed, reason, slow = float(period), status.reason, status.degraded
        if not engine.moving and rig.gate_state()["at_rest"]:
            break
    return Fate(row, run, noise, reason or engine.status.reason, slow, noticed, travel, honest)
