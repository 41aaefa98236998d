"""The gate: the only code between a command and the arm.

Nothing runs after it and nothing goes around it. Whatever it is fed, the positions that it hands
out keep the joint limits, the speed and the acceleration; when in doubt it brakes. It integrates
with the nominal period, so a late cycle makes the arm slower, never faster.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vita.errors import BadInput
from vita.types import Array, Joint, JointStep

MARGIN_RAD = 0.02
"""Distance kept from the joint limits [rad]."""
MAX_FRAME_AGE_S = 5 / 30
"""A step that answers an image older than this moves nothing [s]."""
ARRIVED_RAD = 1e-12
"""Nearer to the target than this counts as there, or rounding would keep the arm twitching [rad]."""
FOLLOW_ERROR_RAD = 0.1
"""An arm further than this from its set point does not follow [rad]."""
FOLLOW_CYCLES = 5
"""Cycles in a row that the arm may be away from its set point."""


def braking_speed(distance: Array, acceleration: float, dt: float) -> Array:
    """The highest speed from which one can still stop within `distance` [rad/s].

    Moving at v for one cycle and then losing a*dt in each, the path is dt*(v + (v - a*dt) + ...).
    With m terms it fits into d exactly when v = d/(m*dt) + (m - 1)*a*dt/2, and m is the smallest
    whole number with m*(m + 1)/2*a*dt^2 >= d. (The usual closed form,
    a*dt*(sqrt(1/4 + 2(d - a*dt^2/8)/(a*dt^2)) - 1/2), is a lower bound of this that turns negative
    within a*dt^2/8 of the goal; the exact form comes to rest on it.)

    distance: (n,) at least 0 [rad].
    """
    m = np.maximum(np.ceil(np.sqrt(0.25 + 2.0 * distance / (acceleration * dt * dt)) - 0.5), 1.0)
    return distance / (m * dt) + (m - 1.0) * (0.5 * acceleration * dt)


class Gate:
    """Turns joint steps into set points for the arm, one per cycle of `dt` seconds."""

    def __init__(
        self,
        joints: Sequence[Joint],
        acceleration: float = 8.0,
        margin: float = MARGIN_RAD,
        dt: float = 1 / 240,
        lease_s: float = 0.1,
    ) -> None:
        """
        acceleration: bound of every joint, braking included [rad/s^2].
        margin: distance kept from the joint limits [rad].
        lease_s: how long a step permits motion after it has arrived [s].
        """
        self._margin, self._dt, self._lease_s = margin, dt, lease_s
        self._n = len(joints)
        self._q = np.zeros(self._n)
        self._v = np.zeros(self._n)
        self._anchored = False
        self._target: Array | None = None
        self._scale, self._expires, self._newest = 1.0, -np.inf, -np.inf
        self._arrive = -np.inf
        self._away = 0
        self.stopped = False
        """Latched by `stop()`; only `release()` clears it."""
        self.fault = ""
        """Why the gate stopped by itself, as a sentence; `release()` and `reset()` clear it."""
        self.dropped = 0
        """Steps refused because they were malformed, out of order or not allowed now."""
        self.saturated = np.zeros(self._n, dtype=bool)
        """(n,) joints that a limit keeps from going where the step wants them."""
        self.set_limits(joints, acceleration)

    def set_limits(self, joints: Sequence[Joint], acceleration: float | None = None) -> None:
        """Put limits in force from the next cycle on.

        A limit that is now too near or behind the arm makes it brake as hard as allowed; from
        there only inward motion passes.
        """
        if len(joints) != self._n:
            raise BadInput(f"the gate has {self._n} joints, got limits of {len(joints)}")
        acceleration = self.acceleration if acceleration is None else acceleration
        if not (np.isfinite(acceleration) and acceleration > 0):
            raise BadInput(f"acceleration must be above 0, got {acceleration}")
        for j in joints:
            finite = np.isfinite([j.lower, j.upper, j.max_speed]).all()
            if not (finite and j.lower <= j.upper and j.max_speed >= 0):
                raise BadInput(f"limits of joint {j.name!r} make no sense: {j}")
        lower = np.array([j.lower for j in joints])
        upper = np.array([j.upper for j in joints])
        # A joint with hardly any range keeps half of it rather than getting an empty one.
        margin = np.minimum(self._margin, (upper - lower) / 4)
        self._low, self._high = lower + margin, upper - margin
        self._speed = np.array([j.max_speed for j in joints])
        self.acceleration = float(acceleration)
        self.joints = tuple(joints)

    def command(self, step: JointStep | None, now: float) -> None:
        """Take a step, or None to brake. A malformed one is dropped and brakes as well."""
        if step is None:
            self._target = None
            return
        if self.stopped or self.fault:
            self.dropped += 1
            return
        target = self._target_of(step)
        if target is None:
            self.dropped += 1
            self._target = None
            return
        stamp = float(step.stamp)
        if stamp < self._newest:
            # A late packet: the newer step stays in force until its own lease ends.
            self.dropped += 1
            return
        self._newest = stamp
        self._target = target
        self._scale = min(max(float(step.speed_scale), 0.0), 1.0)
        self._arrive = stamp + float(step.arrive_s)
        # The permission to move expires with the step and with the image that it answers.
        self._expires = min(now + self._lease_s, stamp + MAX_FRAME_AGE_S) + 1e-9

    def _target_of(self, step: JointStep) -> Array | None:
        """(n,) where the step leads [rad]; None when anything about it is malformed."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                dq = np.asarray(step.dq, dtype=float)
                target = np.asarray(step.q_from, dtype=float) + dq
                numbers = np.array([step.stamp, step.speed_scale, step.arrive_s], dtype=float)
            good = dq.shape == target.shape == (self._n,) and np.isfinite(target).all()
            return target if good and np.isfinite(numbers).all() else None
        except (TypeError, ValueError, OverflowError):
            return None

    def cycle(self, now: float, q_measured: Array) -> tuple[Array, Array]:
        """One cycle: the (n,) position and speed to be at when it ends [rad], [rad/s]."""
        self._watch(np.asarray(q_measured, dtype=float))
        if self._target is not None and now > self._expires:
            self._target = None
        q, v, a, dt = self._q, self._v, self.acceleration, self._dt
        if self._target is None:
            wanted = v - np.clip(v, -a * dt, a * dt)
            self.saturated = np.zeros(self._n, dtype=bool)
        else:
            wanted = self._toward(self._target, self._arrive - now)
        # The limits have the last word, each joint for itself: outside them only inward motion.
        up = braking_speed(np.maximum(self._high - q, 0.0), a, dt)
        down = braking_speed(np.maximum(q - self._low, 0.0), a, dt)
        wanted = np.clip(wanted, np.maximum(-down, -self._speed), np.minimum(up, self._speed))
        v = np.clip(wanted, v - a * dt, v + a * dt)
        # What rounding leaves of a speed after braking is rest.
        self._v = np.where(np.abs(v) < ARRIVED_RAD, 0.0, v)
        self._q = q + self._v * dt
        return self._q.copy(), self._v.copy()

    def _toward(self, target: Array, left_s: float) -> Array:
        """(n,) speed wanted for this cycle: straight to the target, all joints arriving together, and not
        before `left_s` has passed."""
        q, v, a, dt = self._q, self._v, self.acceleration, self._dt
        # Aim inside the limits, or a joint that is held would slow down the others for nothing.
        reachable = np.clip(target, np.minimum(self._low, q), np.maximum(self._high, q))
        self.saturated = np.abs(target - reachable) > 1e-9
        way = reachable - q
        way[np.abs(way) < ARRIVED_RAD] = 0.0
        distance = np.abs(way)
        brake = braking_speed(distance, a, dt)
        top = np.minimum(brake, self._speed * self._scale)
        # Joints that have arrived, or that may not move at all, do not set the pace of the others.
        paced = (distance > 0) & (self._speed > 0)
        rates = np.divide(top, distance, out=np.full(self._n, 1.0 / dt), where=paced)
        change = way * min(float(rates.min()), 1.0 / max(left_s, dt)) - v
        # One common share of the wanted change keeps the path straight while speeding up, too.
        largest = float(np.abs(change).max(initial=0.0))
        if largest > a * dt:
            change *= a * dt / largest
        # A joint still on its way from an older target must not overshoot the new one, and one that
        # moves away from it brakes as hard as it may.
        lowest = np.where(way < 0, -brake, 0.0)
        highest = np.where(way > 0, brake, 0.0)
        return np.clip(v + change, lowest, highest)

    def _watch(self, q_measured: Array) -> None:
        """Anchor to the arm at the first cycle; later, notice an arm that does not follow."""
        if q_measured.shape != (self._n,) or not np.isfinite(q_measured).all():
            self._give_up("the arm reports positions that are not numbers; reset the arm")
            return
        if not self._anchored:
            self._q, self._anchored = q_measured.copy(), True
        away = np.abs(q_measured - self._q)
        self._away = self._away + 1 if (away > FOLLOW_ERROR_RAD).any() else 0
        if self._away >= FOLLOW_CYCLES:
            name = self.joints[int(away.argmax())].name
            self._give_up(f"joint {name} does not follow; see what holds it, then acknowledge")

    def _give_up(self, why: str) -> None:
        self.fault = self.fault or why
        self._target = None

    def stop(self) -> None:
        """Brake and stay at rest until `release()`."""
        self.stopped = True
        self._target = None

    def release(self) -> None:
        """Allow motion again. Never moves the arm: the next step does."""
        self.stopped = False
        self.fault = ""
        self._away = 0
        self._target = None

    def reset(self, q: Array, now: float = -np.inf) -> None:
        """Start over at `q` at rest, e.g. after the arm was put there; steps from before are void."""
        q = np.asarray(q, dtype=float)
        if q.shape != (self._n,) or not np.isfinite(q).all():
            raise BadInput(f"expected {self._n} finite joint positions, got {q.tolist()}")
        self._q, self._v, self._anchored = q.copy(), np.zeros(self._n), True
        self._target, self._newest, self._away, self.fault = None, now, 0, ""
        self.saturated = np.zeros(self._n, dtype=bool)

    @property
    def at_rest(self) -> bool:
        return not self._v.any()
