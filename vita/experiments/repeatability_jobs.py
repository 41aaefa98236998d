"""The measurements of the repeatability experiment, each a job of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vita.experiments.repeatability_arm import (
    DEAD_BAND_RAD,
    Joints,
    calibrated,
    commanded,
    reported,
    tip_error,
)
from vita.experiments.repeatability_servo import DEFAULT, PLAIN, Ends, servo
from vita.experiments.repeatability_setups import ELBOW_M, Setup, setup_of
from vita.types import Array

NOISE_PX = 0.03
"""Trackers of the tables: the best that the thesis measured (0.03 to 0.43 px); vita's template trackers
have 0.01 to 0.03 px."""
METHODS = {"plain": PLAIN, "default": DEFAULT}
JOINT_TRIALS = 2000
"""Joint control costs next to nothing, and its means must be exact enough to be compared."""
BIAS_RAD = np.radians(1.0)
PUSH_M = np.array([0.0, 0.0, 1e-3])
"""A calibration that is off by this in every joint, and a force that moves the tool by this."""


@dataclass(frozen=True, eq=False)
class Measured:
    """One set-up at one level of tracker noise."""

    key: str
    noise_px: float
    joints: Joints
    reported: Array
    """(JOINT_TRIALS,) errors under joint control, on other random numbers than it was calibrated with [m]."""
    commanded: Array
    servo: dict[str, Ends]
    """Method to how it ended."""


@dataclass(frozen=True)
class Residual:
    """What a dead band alone leaves of the error."""

    method: str
    gain: float
    largest: float
    """Largest error of the joint, as a multiple of the dead band."""


@dataclass(frozen=True)
class Doubled:
    """What a doubled lambda makes of the plain algorithm's end."""

    key: str
    noise_px: float
    dead_band_rad: float
    before: float
    """Mean tool error with lambda [m]."""
    after: float
    """Mean tool error after some steps with twice of it [m]."""
    default: float
    """Mean tool error of the default [m]."""


@dataclass(frozen=True)
class Biased:
    """The goal was taken, then the encoders went off and a force pushed the tool."""

    joint_control: float
    """Mean tool error under joint control to the reported pose [m]."""
    tool: dict[str, float]
    """Method to mean tool error [m]."""
    image: dict[str, float]
    """Method to largest image error of all trials [px]."""


def measure(key: str, noise_px: float, trials: int, seed: int) -> Measured:
    """Calibrate the arm's joints on the thesis' joint control, then measure everything on that arm."""
    setup = setup_of(key)
    joints = joints_of(setup, seed)
    ends = {
        name: servo(setup, joints, method, trials=trials, seed=seed + 1, noise_px=noise_px)
        for name, method in METHODS.items()
    }
    return Measured(
        key, noise_px, joints,
        reported(setup.arm, joints, setup.goal, JOINT_TRIALS, seed + 2),
        commanded(setup.arm, joints, setup.goal, JOINT_TRIALS, seed + 3), ends,
    )  # fmt: skip


def dead_band(gains: tuple[float, ...], trials: int, seed: int) -> list[Residual]:
    """One joint that is exact but for its dead band, perfect trackers, starts from all about the goal.

    The plain algorithm stops where lambda times the error is below the dead band (thesis 5.1.3).
    """
    setup, joints = setup_of("one"), Joints()
    starts = np.random.default_rng(seed).uniform(-8.0, 8.0, (trials, 1)) * DEAD_BAND_RAD
    found = []
    for gain in gains:
        for name, method in METHODS.items():
            ends = servo(
                setup, joints, method, trials=trials, seed=seed, noise_px=0.0, gain=gain, start=starts
            )
            worst = (ends.still if name == "plain" else ends.final).max() / ELBOW_M
            found.append(Residual(name, gain, float(worst / DEAD_BAND_RAD)))
    return found


def doubled(key: str, noise_px: float, dead_band_rad: float, trials: int, seed: int) -> Doubled:
    """Thesis 5.2.3: some steps with twice the lambda once the arm no longer follows."""
    setup = setup_of(key)
    joints = replace(joints_of(setup, seed), dead_band_rad=dead_band_rad)
    plain, default = (
        servo(setup, joints, method, trials=trials, seed=seed + 1, noise_px=noise_px)
        for method in (PLAIN, DEFAULT)
    )
    before, after = float(plain.still.mean()), float(plain.final.mean())
    return Doubled(key, noise_px, dead_band_rad, before, after, float(default.final.mean()))


def biased(trials: int, seed: int) -> Biased:
    """Thesis 5.3: visual servoing does not mind a bad calibration nor a force on the arm."""
    setup = setup_of("four")
    joints = joints_of(setup, seed)
    # The encoders read 1 degree too much, so that going back to what they read ends 1 degree short.
    blind = np.broadcast_to(setup.goal - BIAS_RAD, (trials, setup.arm.n))
    tool, image = {}, {}
    for name, method in METHODS.items():
        ends = servo(
            setup, joints, method, trials=trials, seed=seed + 1, noise_px=NOISE_PX, bias_rad=BIAS_RAD,
            push=PUSH_M,
        )  # fmt: skip
        tool[name], image[name] = float(ends.final.mean()), float(ends.image.max())
    return Biased(float(tip_error(setup.arm, blind, setup.goal, PUSH_M).mean()), tool, image)


def joints_of(setup: Setup, seed: int) -> Joints:
    """The arm whose joint control is as good as the thesis'."""
    return calibrated(setup.arm, setup.goal, 1e-3 * setup.reported_mm, 1e-3 * setup.commanded_mm, seed)
