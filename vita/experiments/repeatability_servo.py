"""Visual servoing with an arm that stops short: many trials at once."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vita.experiments.repeatability_arm import Joints, away, tip_error
from vita.experiments.repeatability_setups import Setup
from vita.experiments.trial import Method
from vita.servo.estimators import Estimate, Tuning, estimator_of, first_estimate
from vita.servo.noise import measured_sigma
from vita.servo.policies import Situation, policy_of
from vita.servo.policies.base import Mask
from vita.types import Array

PLAIN = Method("plain", estimator="thesis", policy="fixed", tuning=Tuning(alpha=0.0))
"""The thesis' algorithm: the Jacobian of the exploration, a fixed lambda and the pseudo-inverse."""
DEFAULT = Method("default")
GAIN = 0.5
"""The thesis' lambda in these experiments."""
STEPS, DOUBLED_STEPS = 60, 4
"""Control periods with lambda, and those with twice of it that the thesis added at the end."""
PATIENCE, BOOST = 10, 1.5
"""The default's answer to a dead band, as in `vita.servo.controller`: a run that stood still for so many
periods although it wants to move has its lambda raised by this factor, up to 1, where the residual
TOL / lambda is least. Standing still with that, it has ended as near as the arm can come."""
GOAL_FRAMES, STILL_FRAMES = 30, 10
"""The goal is the mean of one second of tracker readings at the goal pose; the noise that the default
assumes is measured from some readings at the start."""


@dataclass(frozen=True, eq=False)
class Ends:
    """Where the trials ended, (trials,) each."""

    still: Array
    """Tool error when the arm did not move with lambda as it was set [m]."""
    final: Array
    """Tool error in the end [m]."""
    space: Array
    """The same as a distance in space, where `final` is what a dial shows [m]."""
    image: Array
    """Largest true image error in the end [px]."""
    periods: Array
    """Control periods until nothing moved any more."""
    in_view: float
    """Share of poses, at the start and in exploring, with all points inside all images."""


@dataclass(eq=False)
class _Scene:
    """The set-up as the servo meets it: trackers and encoders, and an arm to be moved."""

    setup: Setup
    joints: Joints
    noise_px: float
    bias_rad: float
    push: Array
    random: np.random.Generator
    in_view: list[float] = field(default_factory=list)

    def see(self, q: Array) -> Array:
        """(trials, m) pixels as the trackers report them."""
        pixels = self.setup.features(q, self.push)
        return pixels + self.noise_px * self.random.standard_normal(pixels.shape)

    def read(self, q: Array) -> Array:
        """(trials, n) joints as the encoders report them [rad]."""
        return q + self.bias_rad

    def move(self, q: Array, dq: Array) -> Array:
        return self.joints.move(q, dq, self.random)


def servo(
    setup: Setup,
    joints: Joints,
    method: Method,
    *,
    trials: int,
    seed: int,
    noise_px: float,
    gain: float = GAIN,
    start: Array | None = None,
    bias_rad: float = 0.0,
    push: Array | None = None,
) -> Ends:
    """Take the goal, move away, explore, and servo until nothing moves.

    `start` (trials, n) are other start poses than the thesis' [rad]. After the goal was taken, `bias_rad`
    is added to every encoder and the tool is pushed aside by `push` (3,) [m]: a calibration that is off
    and a force on the arm (thesis 5.3).
    """
    random = np.random.default_rng(seed)
    goal = np.broadcast_to(setup.goal, (trials, setup.arm.n))
    free = _Scene(setup, joints, noise_px, 0.0, np.zeros(3), random)
    wanted = np.mean([free.see(goal) for _ in range(GOAL_FRAMES)], axis=0)
    push = np.zeros(3) if push is None else push
    scene = _Scene(setup, joints, noise_px, bias_rad, push, random)
    q = away(goal, trials, random) if start is None else start
    q, first = _explored(scene, q)
    doubles = method.policy == "fixed"
    estimator = estimator_of(method.estimator)(first, None, method.tuning)
    policy = policy_of(method.policy)()
    patience = _Patience(trials, gain)
    periods, still = np.zeros(trials, int), np.full(trials, np.nan)
    for number in range(STEPS + DOUBLED_STEPS):
        if doubles:
            now_gain = np.full(trials, gain if number < STEPS else 2.0 * gain)
        else:
            now_gain = patience.gain
        e, read = scene.see(q) - wanted, scene.read(q)
        estimator.observe(read, e)
        everything = np.ones(q.shape, bool)
        now = Situation(read, e, estimator.estimate, everything, now_gain, method.damping)
        dq = policy.step(now).dq
        if not doubles:
            dq = np.where(patience.ended[:, None], 0.0, dq)
        new = scene.move(q, dq)
        moved = (new != q).any(-1)
        q, periods = new, np.where(moved, number + 1, periods)
        if doubles and number == STEPS - 1:
            still = tip_error(setup.arm, q, goal, push)
        if not doubles:
            stuck = patience.update(moved)
            still = np.where(stuck & np.isnan(still), tip_error(setup.arm, q, goal, push), still)
    final = tip_error(setup.arm, q, goal, push)
    apart = setup.arm.pose(q)[..., :3, 3] + push - setup.arm.pose(goal)[..., :3, 3]
    image = np.abs(setup.features(q, push) - setup.features(goal)).max(-1)
    still = np.where(np.isnan(still), final, still)
    return Ends(still, final, np.linalg.norm(apart, axis=-1), image, periods, float(np.mean(scene.in_view)))


def _explored(scene: _Scene, q: Array) -> tuple[Array, Estimate]:
    """Where the arm is after the exploratory motions (thesis eq. 2.17), and what they told.

    Every joint goes out and back. Both ends are measured anew, since neither move ends where it should.
    """
    trials, n = q.shape
    rest = np.stack([scene.see(q) for _ in range(STILL_FRAMES)])
    sigma = measured_sigma(rest.reshape(STILL_FRAMES, -1))
    scene.in_view.append(scene.setup.in_view(q))
    columns, sizes = [], np.zeros(q.shape)
    for j in range(n):
        sizes[:, j] = away(np.zeros(1), trials, scene.random)[:, 0]
        step = np.where(np.arange(n) == j, sizes, 0.0)
        before, begun = scene.see(q), q
        q = scene.move(q, step)
        moved = scene.read(q) - scene.read(begun)
        columns.append((scene.see(q) - before) / moved[:, j, None])
        scene.in_view.append(scene.setup.in_view(q))
        q = scene.move(q, -moved)
    return q, first_estimate(np.stack(columns, axis=-1), sizes.mean(axis=-1), sigma)


class _Patience:
    """Raises lambda when the arm stands still, and knows when that is of no more use."""

    def __init__(self, trials: int, gain: float) -> None:
        self.gain = np.full(trials, gain)
        self.ended = np.zeros(trials, bool)
        """(trials,) whether the run is over: as near as the arm can come."""
        self._waiting = np.zeros(trials, int)

    def update(self, moved: Mask) -> Mask:
        """Take (trials,) whether the arm has moved; returns which runs have met the dead band."""
        self._waiting = np.where(moved | self.ended, 0, self._waiting + 1)
        stuck = self._waiting >= PATIENCE
        self.ended = self.ended | (stuck & (self.gain >= 1.0))
        self.gain = np.where(stuck, np.minimum(BOOST * self.gain, 1.0), self.gain)
        self._waiting = np.where(stuck, 0, self._waiting)
        return stuck
