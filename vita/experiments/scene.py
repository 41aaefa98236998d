"""The simulated scene of thesis 5.2.1: a Puma 560 brings three points of its tool to a goal.

The thesis prints neither the cameras' intrinsics nor where the target is, only that it is 0.32 m
away and that the cameras stand 1.0 m behind it and 0.30 m apart. Goal and focal length here were
found by search: of all that fit the words, they reproduce the thesis' tables best.
"""

from __future__ import annotations

import numpy as np

from vita.experiments.arms import ARMS
from vita.experiments.cameras import Cameras, Reading, facing
from vita.experiments.trial import Method, World
from vita.servo.estimators import Tuning
from vita.servo.noise import measured_sigma
from vita.types import Array, frozen

ARM = ARMS["puma560"]
START = frozen([1.5708, 0.7854, 3.1416, 0.0, 0.7854, 0.0])
"""(6,) joints at the start [rad], from thesis listing 2."""
GOALS = {
    "near": frozen(START + np.radians([0.33, 7.18, 23.24, -14.74, 40.27, -0.38])),
    "far": frozen([1.0, 1.9635, 2.7489, 0.0, 0.7854, -np.pi / 4]),
}
"""(6,) joints at the goal [rad]: 0.32 m away as in section 5.2.1; 0.70 m away as in listing 2."""
POINTS = frozen([[0.0, 0.0, 0.1], [0.0, -0.1, -0.1], [0.0, 0.1, -0.1]])
"""(3, 3) the feature points in the tool frame [m], from listing 2."""
FOCAL_PX, BEHIND_M, APART_M = 1200.0, 1.0, 0.30
STEPS = 50
"""Control periods of every run."""
STILL = 20
"""Readings before the first motion from which the noise is measured."""
METHODS = ("plain", "default")


def method(name: str, world: World, seed: int) -> Method:
    """The thesis' algorithm (`plain`) or vita's (`default`), which measures the trackers' noise first."""
    random = np.random.default_rng([seed, STILL])
    still = np.stack([world.measure(world.q0, random).ravel() for _ in range(STILL)])
    sigma = measured_sigma(still)
    if name == "plain":
        return Method(name, "thesis", "fixed", Tuning(alpha=0.0), sigma)
    return Method(name, sigma_px=sigma)


def target(goal: str) -> Array:
    """(3,) the tool point at the goal [m]; the cameras turn about the vertical through it."""
    return ARM.pose(GOALS[goal])[:3, 3]


def stereo_rigs(angles: Array, centre: Array, apart: float = APART_M) -> Cameras:
    """Two parallel cameras behind `centre` (3,), looking along each of `angles` (r,) [rad]; (r, 2) views."""
    forward = _horizontal(angles)
    side = _horizontal(angles + np.pi / 2)
    eyes = [centre - BEHIND_M * forward + sign * apart / 2 * side for sign in (-1, 1)]
    return Cameras(facing(np.stack(eyes, 1), forward[:, None]), FOCAL_PX)


def pair_rigs(first: Array, second: Array, centre: Array) -> Cameras:
    """Two cameras at angles `first` and `second` (r,) [rad] that both look at `centre` (3,); (r, 2) views."""
    forward = np.stack([_horizontal(first), _horizontal(second)], 1)
    return Cameras(facing(centre - BEHIND_M * forward, forward), FOCAL_PX)


def world(cameras: Cameras, goal: str, reading: Reading) -> World:
    """One run for each rig of `cameras`."""
    runs = cameras.T_camera_world.shape[0]
    return World(ARM, cameras, POINTS, np.tile(START, (runs, 1)), np.tile(GOALS[goal], (runs, 1)), reading)


def _horizontal(angles: Array) -> Array:
    return np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], -1)
