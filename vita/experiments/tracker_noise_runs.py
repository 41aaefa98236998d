"""The runs of the tracker-noise experiment: the thesis' algorithm at 500 small steps, and vita's default."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vita.experiments.cameras import Reading
from vita.experiments.tracker_noise_scene import Fading, Scene, scene
from vita.experiments.trial import JUMP_PX, Method, explore, run
from vita.servo.estimators.base import Mask
from vita.servo.estimators.broyden import broyden_update
from vita.servo.noise import measured_sigma
from vita.types import Array

STEPS, DEFAULT_STEPS = 500, 150
"""The thesis' number of steps, and that of the default, which has long settled by then."""
DELTA_DEG = 1.5
"""Size of the exploratory motions. Section 5.2.4 does not tell it. With 1.5 degrees the plain algorithm
first diverges where the thesis says, and with larger ones only from farther away."""
STILL = 20
"""Readings before the first motion from which the default measures the noise."""
NEAR_SHARE = 0.1
"""A run has converged when its image error is below this share of what it was at the start."""


@dataclass(frozen=True)
class Settings:
    """How to servo."""

    alpha: float | None = 0.0
    """Of Broyden's update in every step, with the thesis' algorithm; None is vita's default."""
    gain: float = 0.05
    delta_rad: float = float(np.radians(DELTA_DEG))


@dataclass(frozen=True, eq=False)
class Outcome:
    """How the runs ended, (runs,) each."""

    distance: Array
    """Summed 3D error [m]."""
    image: Array
    """Summed true image error [px]."""
    diverged: Mask
    """Bool: by the thesis' rule, or farther away than at the start."""
    steps: Array
    """Steps to a tenth of the first image error; NaN for never."""


def outcome(
    rig: str, reading: Reading, distances: Array, trials: int, method: Settings, seed: int
) -> Outcome:
    """`trials` runs at each distance, those of the first distance first."""
    if method.alpha is not None:
        if isinstance(reading, Fading):
            reading = replace(reading, distance_m=np.repeat(distances, trials)[:, None])
        return plain(scene(rig, distances, trials, reading, seed), method, STEPS, seed)
    if isinstance(reading, Fading):
        # The default assumes one noise for all runs of a batch: here every distance has its own.
        parts = [
            default(scene(rig, distances[i : i + 1], trials, at, seed), method, DEFAULT_STEPS, seed + i)
            for i, at in enumerate(replace(reading, distance_m=float(d)) for d in distances)
        ]
        return Outcome(
            np.concatenate([part.distance for part in parts]),
            np.concatenate([part.image for part in parts]),
            np.concatenate([part.diverged for part in parts]),
            np.concatenate([part.steps for part in parts]),
        )
    return default(scene(rig, distances, trials, reading, seed), method, DEFAULT_STEPS, seed)


def plain(world: Scene, method: Settings, steps: int, seed: int) -> Outcome:
    """The thesis' algorithm: dq = -lambda J+ e (eq. 2.15), Broyden's update (eq. 2.18) in every step.

    It is what estimator `thesis` and policy `fixed` do, in a form that is fast for thousands of runs:
    without updates the pseudo-inverse is made once, with them it is (J'J)^-1 J'.
    """
    random = np.random.default_rng(seed)
    alpha = method.alpha or 0.0
    q = world.q0.copy()
    jacobian = explore(world, method.delta_rad, random)
    inverse = np.linalg.pinv(jacobian) if alpha == 0.0 else None
    before_q = before_e = None
    first = last = _image(world, q)
    jumped = np.zeros(first.shape, bool)
    reached = np.full(first.shape, np.nan)
    for number in range(steps):
        e = world.measure(q, random)
        if inverse is None:
            if before_q is not None and before_e is not None:
                jacobian = broyden_update(jacobian, q - before_q, e - before_e, alpha)
            before_q, before_e = q, e
            full = _least_squares(jacobian, e)
        else:
            full = (inverse @ e[..., None])[..., 0]
        # Whoever sees a run jump stops the robot.
        q = q - np.where(jumped[:, None], 0.0, method.gain * full)
        image = _image(world, q)
        jumped, last = jumped | ~(image <= last + JUMP_PX), image
        reached = np.where(np.isnan(reached) & (image < NEAR_SHARE * first), number + 1, reached)
    return Outcome(world.distance(q), last, jumped | (last > first), reached)


def default(world: Scene, method: Settings, steps: int, seed: int) -> Outcome:
    """Vita's default, which measures the trackers' noise before it moves."""
    random = np.random.default_rng([seed, STILL])
    still = np.stack([world.measure(world.q0, random).ravel() for _ in range(STILL)])
    servo = Method("default", sigma_px=measured_sigma(still))
    runs = run(world, servo, gain=method.gain, delta=method.delta_rad, steps=steps, seed=seed)
    first, last = runs.error[:, 0], runs.error[:, -1]
    diverged = runs.diverged | (last > first)
    return Outcome(runs.distance[:, -1], last, diverged, runs.steps_to(NEAR_SHARE * first))


def _image(world: Scene, q: Array) -> Array:
    """(runs,) sum of the absolute true errors [px]; infinite for what lies in a camera's plane."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        total = np.abs(world.features(q) - world.features(world.goal)).sum(-1)
    return np.where(np.isfinite(total), total, np.inf)


def _least_squares(jacobian: Array, e: Array) -> Array:
    """(runs, n) J+ e through the normal equations, which are regular as long as the rank is full."""
    turned = jacobian.swapaxes(-1, -2)
    normal = turned @ jacobian
    tiny = 1e-12 * np.einsum("...ii->...", normal)[..., None, None] * np.eye(normal.shape[-1])
    return np.linalg.solve(normal + tiny, turned @ e[..., None])[..., 0]
