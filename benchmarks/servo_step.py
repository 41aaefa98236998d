"""What one servo step costs: learn from the last motion, then choose the next one.

    python benchmarks/servo_step.py [--rows 16] [--joints 7] [--steps 2000]

16 error rows (eight points or four lines in two cameras) and 7 joints, the size of a WAM 7 task.
Each registered estimator is run with the default policy, and each policy with the default
estimator, beside one plain pseudo-inverse step, `dq = -lambda pinv(J) e` (thesis eq. 2.15). The two
are timed in turn, so that a busy machine slows both alike: trust the ratio.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from vita.servo.config import ServoConfig
from vita.servo.estimators import ESTIMATORS, Samples, estimator_of, first_estimate
from vita.servo.policies import POLICIES, Situation, policy_of
from vita.types import Array

SIGMA_PX = 0.3
TARGET_US = 100.0
"""What the default may cost on a machine that is doing nothing else."""


class Task:
    """A smooth world without robot or cameras: e = A x + x' B x, noise on top."""

    def __init__(self, rows: int, joints: int, seed: int = 3) -> None:
        random = np.random.default_rng(seed)
        self.linear = 400.0 * random.standard_normal((rows, joints))
        self.bent = 20.0 * random.standard_normal((rows, joints, joints))
        self.noise = SIGMA_PX * random.standard_normal((4096, rows))
        self.start = 0.2 * random.standard_normal(joints)

    def error(self, q: Array, number: int) -> Array:
        return self.linear @ q + q @ self.bent @ q + self.noise[number % len(self.noise)]

    def explored(self, delta: float = np.radians(4.0)) -> tuple[Array, Samples]:
        """The first Jacobian by finite differences (thesis eq. 2.17), and what was measured."""
        q = np.vstack([self.start, self.start + delta * np.eye(self.start.size)])
        e = np.stack([self.error(x, i) for i, x in enumerate(q)])
        return (e[1:] - e[0]).T / delta, Samples(q, e)


def timed(task: Task, estimator: str, policy: str, steps: int) -> tuple[Array, Array]:
    """(steps,) seconds of the servo's step and of the plain one, measured in turn.

    The arm starts anew every 40 periods, so that steps far from the goal, which learn, and steps near
    it, which average, are both in the figures.
    """
    ours, plain = np.zeros(steps), np.zeros(steps)
    jacobian, history = task.explored()
    q = task.start
    for number in range(steps):
        if number % 40 == 0:
            q = task.start
            learner = estimator_of(estimator)(first_estimate(jacobian, np.radians(4.0), SIGMA_PX), history)
            chooser, free = policy_of(policy)(), np.ones(q.shape, bool)
        e = task.error(q, number)
        begin = time.perf_counter()
        learner.observe(q, e)
        dq = chooser.step(Situation(q, e, learner.estimate, free, 0.3, 0.02)).dq
        middle = time.perf_counter()
        -0.3 * np.linalg.pinv(jacobian) @ e
        ours[number], plain[number] = middle - begin, time.perf_counter() - middle
        q = q + dq
    return ours, plain


def pairs() -> list[tuple[str, str]]:
    """The default first, then every other estimator and policy beside the default's other half."""
    default = ServoConfig()
    rest = [(e, default.policy) for e in ESTIMATORS] + [(default.estimator, p) for p in POLICIES]
    first = (default.estimator, default.policy)
    return [first, *(pair for pair in rest if pair != first)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--rows", type=int, default=16)
    parser.add_argument("--joints", type=int, default=7)
    parser.add_argument("--steps", type=int, default=2000)
    args = parser.parse_args()
    task = Task(args.rows, args.joints)
    print(f"One servo step, {args.rows} rows x {args.joints} joints, median and 90 % of {args.steps}.")
    print("| estimator | policy | median us | 90 % us | pinv step us | ratio |")
    print("|---|---|---:|---:|---:|---:|")
    for estimator, policy in pairs():
        timed(task, estimator, policy, 80)  # The first calls pay for imports and caches.
        ours, plain = timed(task, estimator, policy, args.steps)
        ours_us, plain_us = 1e6 * np.median(ours), 1e6 * np.median(plain)
        print(
            f"| {estimator} | {policy} | {ours_us:.0f} | {1e6 * np.quantile(ours, 0.9):.0f} "
            f"| {plain_us:.0f} | {ours_us / plain_us:.2f} |"
        )
    print(f"The default (first line) shall take at most {TARGET_US:.0f} us.")


if __name__ == "__main__":
    main()
