"""The first Jacobian: a look at the noise with the arm at rest, then exploratory motions.

The thesis (5.2.1) asks that the exploratory motions be chosen from the noise of the trackers. The arm
therefore stands still for a few periods first. What comes out is an estimate that knows how good it is.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import NamedTuple

import numpy as np

from vita.servo.config import ServoConfig
from vita.servo.estimators import Estimate, Samples, first_estimate
from vita.servo.explore import Exploring, Sample, explore, sizes_of
from vita.servo.noise import explore_size, measured_sigma
from vita.types import Array, Joint

REST_READINGS = 6
STILL_RAD = 1e-4
"""An arm that moves by more between two readings is not at rest yet [rad]."""
LONGEST_REST = 30
"""Readings after which it is taken as it is: some arms tremble."""


class Learned(NamedTuple):
    """What the exploration found."""

    estimate: Estimate
    samples: Samples
    idle: tuple[int, ...] = ()
    """Joints whose motion moved nothing in the images."""


class Resting(NamedTuple):
    """What the generator asks for first: stay at `target` (n,) [rad]."""

    target: Array


Learning = Generator[Exploring | Resting, Sample, Learned]


def learn(start: Sample, joints: Sequence[Joint], use: Sequence[int], config: ServoConfig) -> Learning:
    """Rest, then explore the joints of `use` as `config` says. Raises `JointStuck`."""
    here, readings = start, [start.e]
    for _ in range(LONGEST_REST):
        if len(readings) >= REST_READINGS:
            break
        before = here
        here = yield Resting(start.q)
        if np.abs(here.q - before.q).max() > STILL_RAD:
            readings = []
        readings.append(here.e)
    sigma = noise_of(readings, config.tolerance_px)
    log: list[Sample] = []
    # A joint without effect is no trouble where motions may be free; looking closer would take time then.
    closer = sigma if config.free_motions == "hold" else 0.0
    idle: list[int] = []
    jacobian = yield from explore(
        here, joints, use, size_of(config, sigma), want_px=config.explore_px, log=log, sigma=closer, idle=idle
    )
    moved = sizes_of(log, len(joints))
    sizes = np.where(moved > 0.0, moved, size_of(config, sigma))
    samples = Samples(np.array([s.q for s in log]), np.array([s.e for s in log]))
    return Learned(first_estimate(jacobian, sizes, sigma), samples, tuple(idle))


def noise_of(readings: Sequence[Array], tolerance_px: float) -> float:
    """Noise of an error row [px]. Never below a small share of what counts as done: an arm at rest shows
    nothing of a tracker's systematic errors, and errors in other units than pixels have other floors."""
    if len(readings) < 2:
        return 0.1 * tolerance_px
    return max(measured_sigma(np.array(readings), floor=0.04 * tolerance_px), 1e-9)


def size_of(config: ServoConfig, sigma: float) -> float:
    """Exploratory joint motion [rad]: the setting, or by the noise where that is 0."""
    if config.explore_deg > 0.0:
        return float(np.radians(config.explore_deg))
    return float(explore_size(sigma))
