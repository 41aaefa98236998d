"""Many servo runs at once: the estimators and policies of `vita.servo` on a kinematic world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from vita.experiments.arms import Arm
from vita.experiments.cameras import Cameras, Reading
from vita.servo.estimators import Tuning, estimator_of, first_estimate
from vita.servo.estimators.base import Mask
from vita.servo.policies import Situation, policy_of
from vita.types import Array

JUMP_PX = 100.0
"""The thesis' rule: a run whose summed error grows by more in one step has diverged."""


@dataclass(frozen=True, eq=False)
class World:
    """`runs` copies of a task: the arm's tool points are to meet the same points at the goal pose."""

    arm: Arm
    cameras: Cameras
    """Of each run (runs, c, 4, 4), or one rig for all (c, 4, 4)."""
    local: Array
    """(k, 3) points fixed to the tool [m]."""
    q0: Array
    """(runs, n) where each run starts [rad]."""
    goal: Array
    """(runs, n) joints at which the task is met [rad]."""
    reading: Reading = Reading()
    limited: bool = False
    """Whether the arm's joint limits hold."""

    def features(self, q: Array) -> Array:
        """(runs, c k 2) true pixels of the points at joints `q` (runs, n)."""
        pixels = self.cameras.project(self.arm.points(q, self.local))
        return pixels.reshape(*q.shape[:-1], -1)

    def measure(self, q: Array, random: np.random.Generator) -> Array:
        """(runs, m) e = s - s* as trackers report it; both are read anew in every frame."""
        moving = self.reading.of(self.features(q), random)
        return moving - self.reading.of(self.features(self.goal), random)

    def distance(self, q: Array) -> Array:
        """(runs,) sum over the points of the absolute coordinate errors [m], the thesis' 3D error."""
        apart = self.arm.points(q, self.local) - self.arm.points(self.goal, self.local)
        return np.abs(apart).sum((-1, -2))

    def true_jacobian(self, q: Array) -> Array:
        """(runs, m, n) by central differences [px/rad]; for judging and for the ideal servo only."""
        step, columns = 1e-6, []
        for i in range(self.arm.n):
            dq = np.zeros(self.arm.n)
            dq[i] = step
            columns.append((self.features(q + dq) - self.features(q - dq)) / (2 * step))
        return np.stack(columns, axis=-1)


@dataclass(frozen=True)
class Method:
    """A way to servo."""

    name: str
    estimator: str = "kalman"
    policy: str = "uncertainty"
    tuning: Tuning = field(default_factory=Tuning)
    sigma_px: float = 0.3
    """The tracker noise that it assumes."""
    damping: float = 0.0


@dataclass(frozen=True, eq=False)
class Runs:
    """What happened, one entry for each run. Steps are counted from 0, the start."""

    error: Array
    """(runs, steps + 1) sum of absolute true image errors [px]."""
    distance: Array
    """(runs, steps + 1) true 3D error [m]."""
    condition: Array
    """(runs,) condition number of the first Jacobian."""
    q: Array
    """(runs, n) where it ended."""

    @property
    def diverged(self) -> Mask:
        """(runs,) bool by the thesis' rule, on the true error."""
        grew = (self.error[..., 1:] > self.error[..., :-1] + JUMP_PX).any(-1)
        return np.asarray(grew | ~np.isfinite(self.error).all(-1))

    def steps_to(self, bound: Array | float) -> Array:
        """(runs,) first step at which the error is below `bound` [px]; NaN for never."""
        below = self.error < np.asarray(bound, float)[..., None]
        return np.where(below.any(-1), below.argmax(-1), np.nan)


def explore(world: World, delta: float | Array, random: np.random.Generator) -> Array:
    """(runs, m, n) Jacobian by forward differences of `delta` (one or (runs,)) [rad] (thesis eq. 2.17)."""
    size = np.broadcast_to(np.asarray(delta, float), world.q0.shape[:-1])
    start, columns = world.measure(world.q0, random), []
    for i in range(world.arm.n):
        q = world.q0.copy()
        q[..., i] += size
        columns.append((world.measure(q, random) - start) / size[..., None])
    return np.stack(columns, axis=-1)


def run(
    world: World,
    method: Method,
    *,
    gain: float | Array,
    delta: float | Array,
    steps: int,
    seed: int,
    each: Callable[[int], None] | None = None,
) -> Runs:
    """Explore by `delta` [rad], then servo for `steps` steps with lambda = `gain`.

    Both may be one for all or one for each run (runs,).
    A run that has diverged stands still from then on: its user would have stopped the robot.
    """
    random = np.random.default_rng(seed)
    q = world.q0.copy()
    start = first_estimate(explore(world, delta, random), delta, method.sigma_px)
    values = np.linalg.svd(start.jacobian, compute_uv=False)[..., : min(6, world.arm.n)]
    estimator = estimator_of(method.estimator)(start, None, method.tuning)
    policy = policy_of(method.policy)()
    error, distance = [_summed(world, q)], [world.distance(q)]
    limits = world.arm.limits.T if world.limited else (-np.inf, np.inf)
    stopped = np.zeros(q.shape[:-1], bool)
    gone = stopped.copy()
    for number in range(steps):
        # A run may leave every sensible range before it is stopped: that is a result, not a mistake.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            e = world.measure(q, random)
            gone = gone | ~np.isfinite(e).all(-1)
            e = np.where(gone[..., None], 0.0, e)
            estimator.observe(q, e)
            e = estimator.believed(e)
            now = Situation(
                q, e, estimator.estimate, np.ones(q.shape, bool), gain, method.damping, *limits
            )  # fmt: skip
            dq = policy.step(now).dq
        gone = gone | ~np.isfinite(dq).all(-1)
        dq = np.where((stopped | gone)[..., None], 0.0, dq)
        q = q + (_inside(q, dq, world.arm.limits) if world.limited else dq)
        error.append(np.where(gone, np.inf, _summed(world, q)))
        distance.append(world.distance(q))
        stopped = stopped | (error[-1] > error[-2] + JUMP_PX)
        if each is not None:
            each(number)
    condition = values[..., 0] / np.maximum(values[..., -1], 1e-12)
    return Runs(np.stack(error, -1), np.stack(distance, -1), condition, q)


def _summed(world: World, q: Array) -> Array:
    """(runs,) sum of the absolute true errors [px]; a point in a camera's own plane is infinitely far."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        total = np.abs(world.features(q) - world.features(world.goal)).sum(-1)
    return np.where(np.isfinite(total), total, np.inf)


def _inside(q: Array, dq: Array, limits: Array) -> Array:
    """`dq` scaled as a whole so that no joint passes its limit."""
    room = np.where(dq > 0, limits[:, 1] - q, q - limits[:, 0])
    share = np.min(np.where(dq != 0.0, np.maximum(room, 0.0) / np.maximum(np.abs(dq), 1e-300), 1.0), axis=-1)
    return np.minimum(share, 1.0)[..., None] * dq
