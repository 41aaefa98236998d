"""The laws of the gate, worked out anew: nothing in here is taken from the gate but its numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from vita.servo.gate import MAX_FRAME_AGE_S, Gate
from vita.servo.keep_off import CLOSEST_M, NEARER_M, OLD_S, SLOPE, TOUCH_M, Nearness, Pair
from vita.types import Array, Joint, JointStep

SLACK = 1e-9
LEASE_S = 0.1


class Laws:
    """What is allowed in the next cycle, from all that was said to a gate."""

    def __init__(self, joints: Sequence[Joint], a: float, dt: float, margin: float, guarded: bool) -> None:
        self._dt, self._margin, self._guarded = dt, margin, guarded
        self._n = len(joints)
        self.checked: Counter[str] = Counter()
        self.limited(joints, a, np.zeros(self._n), np.zeros(self._n))
        self.begin(np.zeros(self._n))

    # ---- what was said -------------------------------------------------------------------------

    def begin(self, q: Array, now: float = -np.inf) -> None:
        """The arm is at q, at rest; what was commanded before `now` is void, and so are distances."""
        self._target: Array | None = None
        self._newest, self._expires = now, -np.inf
        self._near: Nearness | None = None
        self._known: dict[Pair, float] = {}
        self._fault = False
        self._safe = (q >= self._low - SLACK) & (q <= self._high + SLACK)
        self._rest_by = 0
        if not hasattr(self, "_stopped"):
            self._stopped = False

    def limited(self, joints: Sequence[Joint], a: float, q: Array, v: Array) -> None:
        """New limits, with the arm at q moving at v."""
        lower, upper = (np.array([getattr(j, name) for j in joints]) for name in ("lower", "upper"))
        margin = np.minimum(self._margin, (upper - lower) / 4)
        self._low, self._high = lower + margin, upper - margin
        self._speed = np.array([j.max_speed for j in joints])
        self._a = a
        rest = self.stopping_point(q, v)
        self._safe = (np.minimum(q, rest) >= self._low - SLACK) & (np.maximum(q, rest) <= self._high + SLACK)
        self._rest_by = self._cycles_to_rest(v)

    def commanded(self, step: JointStep, now: float, gate: Gate) -> None:
        if self._stopped or self._fault:
            return
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                dq, q = np.asarray(step.dq, dtype=float), np.asarray(step.q_from, dtype=float)
                target, rest = q + dq, np.array([step.stamp, step.speed_scale, step.arrive_s], dtype=float)
            good = dq.shape == q.shape == (self._n,) and np.isfinite(target).all() and np.isfinite(rest).all()
        except (TypeError, ValueError):
            good = False
        if not good:
            self._target = None
        elif step.stamp >= self._newest:
            self._target, self._newest = target, float(step.stamp)
            self._expires = min(now + LEASE_S, step.stamp + MAX_FRAME_AGE_S)
            self._share = min(max(float(step.speed_scale), 0.0), 1.0)
            self._arrive = float(step.stamp + step.arrive_s)

    def halted(self) -> None:
        self._target = None

    @property
    def at_a_loss(self) -> bool:
        """Whether nothing moves until somebody releases the gate."""
        return self._stopped or self._fault

    def stopped(self) -> None:
        self._target, self._stopped = None, True

    def released(self) -> None:
        self._target, self._stopped, self._fault = None, False, False
        if self._near is not None:
            known = zip(self._near.pairs, self._near.distances, strict=True)
            self._known = {pair: d for pair, d in known if d < TOUCH_M}

    def seen(self, near: Nearness | None) -> None:
        """New distances; None for some that are no numbers."""
        self._guarded = True
        if near is None:
            return
        self._near = near
        for pair, d in zip(near.pairs, near.distances, strict=True):
            if d > CLOSEST_M:
                self._known.pop(pair, None)
            if d < min(TOUCH_M, self._known.get(pair, np.inf) - NEARER_M):
                self._fault, self._target = True, None

    # ---- what is allowed -----------------------------------------------------------------------

    def broken(self, now: float, q: Array, v: Array, q_next: Array, v_next: Array, fault: str) -> str:
        """The law that a cycle from (q, v) to (q_next, v_next) broke, or nothing."""
        a, dt = self._a, self._dt
        if not (np.isfinite(q_next).all() and np.isfinite(v_next).all()):
            return "a set point is no number"
        if np.abs(q_next - q - v_next * dt).max() > 1e-12:
            return "position and speed do not fit together"
        if np.abs(v_next - v).max() > a * dt + SLACK:
            return "the acceleration is exceeded"
        if (np.abs(v_next) > np.maximum(self._speed, np.abs(v) - a * dt) + SLACK).any():
            return "the speed is exceeded"
        outside = (q_next < self._low - SLACK) | (q_next > self._high + SLACK)
        if (outside & self._safe).any():
            return "the position is exceeded"
        # Beyond a limit that moved, a joint that still goes out brakes as hard as it may.
        out = np.where(q_next > self._high, v_next, np.where(q_next < self._low, -v_next, 0.0))
        if (out > np.maximum(np.abs(v) - a * dt, 0.0) + SLACK).any():
            return "a joint goes on outwards"
        self.checked["position, speed and acceleration"] += 1
        broken = self._stopping(now, v, v_next, fault) or self._direction(now, q, v, v_next)
        broken = broken or self._approach(now, q, v, v_next)
        if not self._safe.all():
            rest = self.stopping_point(q_next, v_next)
            lowest, highest = np.minimum(q_next, rest), np.maximum(q_next, rest)
            self._safe |= (lowest >= self._low - SLACK) & (highest <= self._high + SLACK)
        return broken

    def _permitted(self, now: float) -> bool:
        blind = self._guarded and (self._near is None or now - self._near.stamp > OLD_S + 2e-9)
        late = now > self._expires + 2e-9
        return self._target is not None and not (self._stopped or self._fault or late or blind)

    def _stopping(self, now: float, v: Array, v_next: Array, fault: str) -> str:
        """Without permission the arm brakes as hard as it may, and is at rest when it can be."""
        if self._fault and not fault:
            return "a contact was not noticed"
        if self._permitted(now):
            self._rest_by = self._cycles_to_rest(v_next)
            return ""
        if self._guarded and self._target is not None and fault:
            self._fault, self._target = True, None  # The distances are missing; it says so and stays.
        self.checked["stopping"] += 1
        if np.abs(v_next).max() > max(np.abs(v).max() - self._a * self._dt, 0.0) + SLACK:
            return "it does not brake at once"
        self._rest_by -= 1
        return "it does not come to rest in time" if self._rest_by <= 0 and v_next.any() else ""

    def _direction(self, now: float, q: Array, v: Array, v_next: Array) -> str:
        """From rest, and on a straight way that it can stop on, the arm moves straight to its target."""
        if not self._permitted(now) or not self._safe.all() or not self._speed.all():
            return ""
        assert self._target is not None
        aim = np.clip(self._target, np.minimum(self._low, q), np.maximum(self._high, q))
        way = np.where(np.abs(aim - q) < 1e-12, 0.0, self._target - q)
        size = float(np.abs(way).max())
        top = self._speed * self._share
        if size < 1e-9 or (np.abs(v) > top).any():
            return ""
        unit = way / size  # In two steps, or a far target would overflow.
        unit /= np.linalg.norm(unit)
        if v.any():
            straight = np.abs(v - (v @ unit) * unit).max() < 1e-12 and v @ unit > 0.0
            # The straight way ends where it leaves the limits; all joints are to rest there together.
            goes = way != 0.0
            room = float((np.abs(aim - q)[goes] / np.abs(way)[goes]).min())
            fastest = np.array([float(np.abs(v).max())])
            rest = v * (self.stopping_point(np.zeros(1), fastest)[0] / fastest[0])
            if not straight or (np.abs(rest) > room * np.abs(way)).any():
                return ""
        self.checked["direction"] += 1
        if (np.abs(v_next) > top + SLACK).any():
            return "more than the share of the speed is used"
        left = self._arrive - now
        pace = max(size / left, float(np.abs(v).max())) if left > self._dt else np.inf
        if float(np.abs(v_next).max()) > pace + SLACK:
            return "it would arrive too early"
        aside = np.abs(v_next - (v_next @ unit) * unit).max()
        return "the direction is not kept" if aside > SLACK or v_next @ unit < -SLACK else ""

    def _approach(self, now: float, q: Array, v: Array, v_next: Array) -> str:
        """What is near is approached as slowly as its distance asks, or the arm brakes."""
        near = self._near
        if near is None or not self._permitted(now) or not self._safe.all():
            return ""
        if (np.abs(v) > self._speed).any():
            return ""
        a, dt = self._a, self._dt
        left = np.maximum(near.distances + near.gradients @ (q - near.q) - CLOSEST_M, 0.0)
        fastest = float(np.abs(v_next).max())
        # The way of braking hard, all joints together, down to a speed from which the slow rest is possible.
        turn = a / SLOPE - 0.5 * a * dt
        per_speed = 1.0 / SLOPE
        if fastest > turn:
            per_speed = (fastest**2 + a * dt * fastest + turn**2) / (2 * a * fastest)
        before = float(np.abs(v).max())
        braked = v * max(1.0 - a * dt / before, 0.0) if before > 0.0 else v
        self.checked["approach"] += 1
        most = np.maximum(left / per_speed, -(near.gradients @ braked))
        too_fast = -(near.gradients @ v_next) > most + 1e-8
        return "something is approached too fast" if too_fast.any() else ""

    # ---- parts ---------------------------------------------------------------------------------

    def stopping_point(self, q: Array, v: Array) -> Array:
        """(n,) where each joint rests when it brakes as hard as it may from the next cycle on [rad]."""
        step = self._a * self._dt
        m = np.ceil(np.abs(v) / step - 1e-12) - 1.0
        m = np.maximum(m, 0.0)
        return q + np.sign(v) * self._dt * (m * np.abs(v) - 0.5 * step * m * (m + 1.0))

    def _cycles_to_rest(self, v: Array) -> int:
        return int(np.ceil(float(np.abs(v).max(initial=0.0)) / (self._a * self._dt) - 1e-9)) + 1
