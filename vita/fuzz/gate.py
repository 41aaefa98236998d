"""Hostile input for the gate, and an account of its own that says in each cycle whether a law was broken.

The laws: positions keep the limits, speeds and accelerations their bounds, braking is as hard as allowed and
begins at once, the direction is kept, and what is near is approached no faster than its distance allows.
Random input hides naive gates; so most of it lies at the borders: joints within a hair of a limit, targets
just beyond, limits that move to where the arm is just able to stop.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from vita.fuzz.base import Report
from vita.fuzz.gate_laws import Laws
from vita.servo.gate import MARGIN_RAD, Gate
from vita.servo.keep_off import Nearness, Pair
from vita.types import Array, Joint, JointStep

DT = 1 / 240
RUN_CYCLES = 400
"""Cycles with one gate."""
MOST_TOLD = 5
BAD_NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308)
ACCELERATIONS = (0.5, 2.0, 8.0, 8.0, 8.0, 50.0)
WALLS = 3


def run(seconds: float, seed: int) -> Report:
    """Try the gate for so long. Each run of `RUN_CYCLES` has a seed of its own, which reproduces it."""
    began, cycles, runs = time.perf_counter(), 0, 0
    violations: list[str] = []
    checked: dict[str, int] = {}
    while time.perf_counter() - began < seconds and len(violations) < MOST_TOLD:
        found, counts = one_run(seed * 1_000_003 + runs)
        violations += found
        cycles, runs = cycles + RUN_CYCLES, runs + 1
        for law, count in counts.items():
            checked[law] = checked.get(law, 0) + count
    took = time.perf_counter() - began
    figures = {"cycles/s": cycles / took, "runs": float(runs)}
    figures |= {f"checks of {law}": float(count) for law, count in checked.items()}
    return Report("gate", cycles, "control cycles", tuple(violations[:MOST_TOLD]), figures)


def one_run(seed: int, cycles: int = RUN_CYCLES) -> tuple[list[str], dict[str, int]]:
    """One gate from start to end: what it did wrong, if anything, and how often each law was checked."""
    foe = Foe(seed)
    for cycle in range(cycles):
        foe.act()
        broken = foe.cycle()
        if broken:
            return [f"{broken} in cycle {cycle} of the run with seed {seed}"], foe.laws.checked
    return [], foe.laws.checked


@dataclass
class Foe:
    """Somebody who means ill, with a gate and an arm that follows perfectly."""

    seed: int

    def __post_init__(self) -> None:
        rng = self._rng = np.random.default_rng(self.seed)
        self._n = int(rng.choice([1, 2, 4, 7, 10]))
        self._a = float(rng.choice(ACCELERATIONS))
        self._now = float(rng.choice([0.0, 1e3, 1e7]))
        limits = self._limits()
        guarded = bool(rng.random() < 0.5)
        self._gate = Gate(limits, self._a, dt=DT, guarded=guarded)
        self._q, self._v = self._near_limits(limits), np.zeros(self._n)
        self._goal = self._q
        self.laws = Laws(limits, self._a, DT, MARGIN_RAD, guarded)
        self.laws.begin(self._q)
        # Input comes in bursts: long quiet stretches let the arm get up to speed.
        self._haste = float(rng.choice([0.02, 0.1, 0.5]))
        self._acts = (
            self._go, self._go, self._go, self._go, self._creep, self._change_limits, self._change_limits,
            self._nonsense, self._change_acceleration, self._stale, self._halt, self._stop, self._release,
            self._reset,
            self._walls, self._walls,
        )  # fmt: skip

    # ---- what it does --------------------------------------------------------------------------

    def act(self) -> None:
        """Something or nothing; the step in force and the distances are renewed as a servo would."""
        rng = self._rng
        if rng.random() < self._haste:
            self._acts[int(rng.integers(len(self._acts)))]()
        elif self.laws.at_a_loss:
            if rng.random() < 0.05:
                self._release()
        elif rng.random() < 0.2:
            self._command(self._goal)
        if self._gate.guarded and rng.random() < 0.2:
            self._see()

    def cycle(self) -> str:
        """Let the gate have its cycle; the law that it broke, or nothing."""
        q, v = self._gate.cycle(self._now, self._q)
        broken = self.laws.broken(self._now, self._q, self._v, q, v, self._gate.fault)
        self._q, self._v = q, v
        self._now += DT
        return broken

    def _command(
        self, target: Array, stamp: float | None = None, scale: float = 1.0, lead: float = 0.0
    ) -> None:
        stamp = self._now if stamp is None else stamp
        step = JointStep(target - self._q, self._q, stamp, scale, lead)
        self._gate.command(step, self._now)
        self.laws.commanded(step, self._now, self._gate)

    def _go(self) -> None:
        """A new target: at a limit, just beyond one, far beyond, where the arm is, or just past where it can
        stop."""
        rng, gate = self._rng, self._gate
        kind = rng.integers(6)
        self._goal = self._near_limits(gate.joints)
        if kind == 1:
            self._goal = self._goal + rng.choice([1e-9, 1e-7, 0.3, -5.0, 1e6])
        elif kind == 2:
            self._goal = self._q + rng.choice([0.0, 1e-12, 1e-6, 1e-3]) * rng.normal(size=self._n)
        elif kind == 3:
            self._goal = self.laws.stopping_point(self._q, self._v) + 1e-6 * rng.normal(size=self._n)
        elif kind == 4:
            self._goal = self._q + 0.5 * rng.normal(size=self._n)
        self._command(self._goal, scale=float(rng.choice([0.01, 0.5, 1.0, 1.0, 1.0, 100.0, -1.0])))

    def _creep(self) -> None:
        """A target that is not to be reached too early."""
        self._goal = self._q + 0.1 * self._rng.normal(size=self._n)
        self._command(self._goal, lead=float(self._rng.choice([1e-6, 0.03, 0.3, 1e9])))

    def _change_limits(self) -> None:
        limits = self._limits(around=bool(self._rng.random() < 0.8))
        self._gate.set_limits(limits)
        self.laws.limited(limits, self._a, self._q, self._v)

    def _change_acceleration(self) -> None:
        self._a = float(self._rng.choice(ACCELERATIONS))
        self._gate.set_limits(self._gate.joints, self._a)
        self.laws.limited(self._gate.joints, self._a, self._q, self._v)

    def _nonsense(self) -> None:
        """A step that is none."""
        rng, n = self._rng, self._n
        good = JointStep(np.zeros(n), self._q, self._now)
        bad = rng.choice(BAD_NUMBERS)
        spoiled = self._q.copy()
        spoiled[rng.integers(n)] = bad
        steps = (
            replace(good, dq=spoiled), replace(good, q_from=spoiled),
            replace(good, dq=np.zeros(n + 1)),
            replace(good, dq=np.zeros((n, 1))), replace(good, q_from=None), replace(good, dq="zero"),
            replace(good, stamp=float(bad)), replace(good, speed_scale=np.nan), replace(good, stamp=None),
            replace(good, dq=np.full(n, 1e308), q_from=np.full(n, 1e308)), replace(good, arrive_s=np.inf),
        )  # fmt: skip
        step = steps[int(rng.integers(len(steps)))]
        self._gate.command(step, self._now)
        self.laws.commanded(step, self._now, self._gate)

    def _stale(self) -> None:
        """A step that answers an old picture, or one of the future."""
        late = float(self._rng.choice([-1.0, -0.2, -0.16, 0.05]))
        self._command(self._near_limits(self._gate.joints), self._now + late)

    def _halt(self) -> None:
        self._gate.command(None, self._now)
        self.laws.halted()

    def _stop(self) -> None:
        self._gate.stop()
        self.laws.stopped()
        if self._rng.random() < 0.5:
            self._command(self._goal)  # Refused, for it is stopped.

    def _release(self) -> None:
        self._gate.release()
        self.laws.released()

    def _reset(self) -> None:
        """The arm is put elsewhere."""
        self._q, self._v = self._near_limits(self._gate.joints), np.zeros(self._n)
        self._gate.reset(self._q, self._now)
        self.laws.begin(self._q, self._now)

    # ---- what is near --------------------------------------------------------------------------

    def _walls(self) -> None:
        """New things beside the arm; they may be anywhere, also where it is."""
        rng = self._rng
        distances = rng.choice([-0.01, 0.0, 0.0049, 0.0051, 0.01, 0.011, 0.02, 0.05, 0.3], size=WALLS)
        gradients = rng.normal(size=(WALLS, self._n)) * rng.choice([0.0, 0.01, 0.5, 2.0], size=(WALLS, 1))
        self._wall = (distances, gradients, self._q.copy())
        self._see()

    def _see(self) -> None:
        """The distances of now, of the same things; sometimes they are no numbers."""
        if not hasattr(self, "_wall"):
            self._wall = (np.full(1, 1.0), np.zeros((1, self._n)), self._q.copy())
        d, g, q0 = self._wall
        near = Nearness(self._now, self._q, d + g @ (self._q - q0), g, _PAIRS[: len(d)])
        kind = self._rng.integers(40)
        if kind == 0:
            near = replace(near, distances=np.full(len(d), np.nan))
        elif kind == 1:
            near = replace(near, gradients=g[:, :-1])
        elif kind == 2:
            near = replace(near, stamp=float(self._now - 0.09))
        self._gate.keep_off(near)
        self.laws.seen(near if kind not in (0, 1) else None)

    # ---- numbers at the borders ----------------------------------------------------------------

    def _limits(self, around: bool = False) -> tuple[Joint, ...]:
        """Random limits; `around` leaves the arm just enough room to stop, or a little more."""
        rng, n = self._rng, self._n
        middle, half = rng.uniform(-1, 1, n), 10.0 ** rng.uniform(-2, 0.5, n)
        low, high = middle - half, middle + half
        if around:
            rest = self.laws.stopping_point(self._q, self._v)
            hair = MARGIN_RAD + 10.0 ** rng.uniform(-9, -1, n)
            low, high = np.minimum(self._q, rest) - hair, np.maximum(self._q, rest) + hair
            wide = rng.random(n) < 0.5
            low, high = np.where(wide, low - half, low), np.where(wide, high + half, high)
        speed = 10.0 ** rng.uniform(-2, 0.5, n) if rng.random() < 0.5 else np.full(n, 0.6)
        return tuple(Joint(str(i), float(low[i]), float(high[i]), float(speed[i])) for i in range(n))

    def _near_limits(self, joints: tuple[Joint, ...]) -> Array:
        """(n,) positions, most of them within a hair of a limit."""
        rng, n = self._rng, self._n
        low, high = (np.array([getattr(j, name) for j in joints]) for name in ("lower", "upper"))
        margin = np.minimum(MARGIN_RAD, (high - low) / 4)
        low, high = low + margin, high - margin
        hair = (high - low) * 10.0 ** rng.uniform(-6, -1, n)
        choices = np.stack([low + hair, high - hair, low + rng.random(n) * (high - low), low, high])
        return choices[rng.integers(0, 5, n), np.arange(n)]


_PAIRS = tuple(Pair("the arm", f"wall {i}") for i in range(WALLS))
