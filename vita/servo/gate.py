"""The gate: the only code between a command and the arm.

Nothing runs after it and nothing goes around it. Whatever it is fed, the positions that it hands
out keep the joint limits, the speed and the acceleration; when in doubt it brakes. It integrates
with the nominal period, so a late cycle makes the arm slower, never faster.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.servo.braking import ARRIVED_RAD, Bounds, braking_path, braking_speed, clip, toward
from vita.servo.keep_off import KeepOff, Nearness, least_share
from vita.types import Array, Joint, JointStep

MARGIN_RAD = 0.02
"""Distance kept from the joint limits [rad]."""
MAX_FRAME_AGE_S = 5 / 30
"""A step that answers an image older than this moves nothing [s]."""
FOLLOW = ((0.1, 5), (0.02, 60))
"""An arm further than this from its set point [rad] for so many cycles in a row does not follow: far off at
once, and less far off when it lasts, or a servo that asks for small steps would never know."""


class Gate:
    """Turns joint steps into set points for the arm, one per cycle of `dt` seconds."""

    def __init__(
        self,
        joints: Sequence[Joint],
        acceleration: float = 8.0,
        margin: float = MARGIN_RAD,
        dt: float = 1 / 240,
        lease_s: float = 0.1,
        guarded: bool = False,
    ) -> None:
        """
        acceleration: bound of every joint, braking included [rad/s^2].
        margin: distance kept from the joint limits [rad].
        lease_s: how long a step permits motion after it has arrived [s].
        guarded: whether somebody measures distances, see `keep_off`; nothing moves then without them.
        """
        self._margin, self._dt, self._lease_s = margin, dt, lease_s
        self._n = len(joints)
        self._q = np.zeros(self._n)
        self._v = np.zeros(self._n)
        self._anchored = False
        self._target: Array | None = None
        self._scale, self._expires, self._newest = 1.0, -np.inf, -np.inf
        self._arrive = -np.inf
        self._away = np.zeros(len(FOLLOW), dtype=int)
        self._astray = False
        self.guarded = guarded
        self._near = KeepOff(self._n)
        self.stopped = False
        """Latched by `stop()`; only `release()` clears it."""
        self.fault = ""
        """Why the gate stopped by itself, as a sentence; `release()` and `reset()` clear it."""
        self.kind = ""
        """The reason (`vita.servo.reasons`) that goes with `fault`."""
        self.dropped = 0
        """Steps refused because they were malformed, out of order or not allowed now."""
        self.bad = 0
        """Those of them that were malformed."""
        self._none = np.zeros(self._n, dtype=bool)
        self.saturated = self._none
        """(n,) joints that a limit keeps from going where the step wants them."""
        self.corrupt = False
        """Whether the arm reported positions that are no numbers since the last `release()` or `reset()`."""
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
        self._speeds = np.tile(self._speed, 2)
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
            self.bad += 1
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

    def keep_off(self, near: Nearness) -> None:
        """Take new distances from whoever measures them; contact stops the arm.

        What is not a number is not taken, and the gate goes on with distances that age."""
        self.guarded = True
        if not self._near.take(near):
            return
        pair = self._near.contact()
        if pair is not None:
            self._give_up(pair.touches, "too_close")

    def blind(self, now: float) -> bool:
        """Whether distances are wanted, and missing or too old."""
        return self.guarded and not self._near.fresh(now)

    def cycle(self, now: float, q_measured: Array) -> tuple[Array, Array]:
        """One cycle: the (n,) position and speed to be at when it ends [rad], [rad/s]."""
        self._watch(np.asarray(q_measured, dtype=float))
        if self._target is not None and now > self._expires:
            self._target = None
        if self._target is not None and self.blind(now):
            self._give_up("nothing tells how near the arm is to other things; restart the simulation")
        q, v, a, dt = self._q, self._v, self.acceleration, self._dt
        fastest = float(np.abs(v).max())
        # Braking keeps the direction: all joints come to rest together.
        brake = v * (1.0 - min(a * dt / fastest, 1.0)) if fastest > 0.0 else v
        wanted, self.saturated = brake, self._none
        if self._target is not None:
            bounds = Bounds(self._low, self._high, self._speed, self._scale, a)
            wanted, self.saturated = toward(self._target, q, v, bounds, self._arrive - now, dt)
        # The limits have the last word, each joint for itself: outside them only inward motion.
        room = np.maximum(np.concatenate([self._high - q, q - self._low]), 0.0)
        inward = np.minimum(braking_speed(room, a, dt), self._speeds)
        slowest, quickest = v - a * dt, v + a * dt
        low, high = clip(-inward[self._n :], slowest, quickest), clip(inward[: self._n], slowest, quickest)
        v = clip(wanted, low, high)
        if self._target is not None:
            v = self._eased(v, clip(brake, low, high), room, now)
        # What rounding leaves of a speed after braking is rest.
        self._v = np.where(np.abs(v) < ARRIVED_RAD, 0.0, v)
        self._q = q + self._v * dt
        return self._q.copy(), self._v.copy()

    def _eased(self, wanted: Array, brake: Array, room: Array, now: float) -> Array:
        """(n,) as much of the way from the velocity `brake` to the velocity `wanted` as leaves room to brake
        later with the direction kept: before the joint limits, and before what the arm is near to. What lies
        between two velocities that keep limits and acceleration keeps them, too."""
        a, dt = self.acceleration, self._dt
        fastest = float(np.abs(wanted).max())
        if fastest == 0.0:
            return wanted
        allowed = room * (fastest / braking_path(fastest, a, dt))
        outward = np.concatenate([wanted, -wanted])
        share = 1.0
        if (outward > allowed).any():
            share, _ = least_share(outward, np.concatenate([brake, -brake]), allowed)
        if self.guarded:
            share = min(share, self._near.share(wanted, brake, self._q, now, a, dt))
        return wanted if share >= 1.0 else brake + share * (wanted - brake)

    def _watch(self, q_measured: Array) -> None:
        """Anchor to the arm at the first cycle; later, notice an arm that does not follow."""
        if q_measured.shape != (self._n,) or not np.isfinite(q_measured).all():
            self.corrupt = True
            self._give_up("the arm reports positions that are not numbers; reset the arm")
            return
        if not self._anchored:
            self._q, self._anchored = q_measured.copy(), True
        away = np.abs(q_measured - self._q)
        farthest = float(away.max(initial=0.0))
        for i, (far, cycles) in enumerate(FOLLOW):
            self._away[i] = self._away[i] + 1 if farthest > far else 0
            if self._away[i] >= cycles:
                name = self.joints[int(away.argmax())].name
                self._give_up(f"joint {name} does not follow; see what holds it, then acknowledge")
                self._astray = True
        if self._astray:
            # Once set point and arm are apart, a joint that comes free would jump. They meet at the arm.
            self._target = None
            if self.at_rest:
                self._q, self._astray = q_measured.copy(), False

    def _give_up(self, why: str, kind: str = "gate_fault") -> None:
        if not self.fault:
            self.fault, self.kind = why, kind
        self._target = None

    def stop(self) -> None:
        """Brake and stay at rest until `release()`."""
        self.stopped = True
        self._target = None

    def release(self) -> None:
        """Allow motion again. Never moves the arm: the next step does."""
        self.stopped = False
        self.fault = self.kind = ""
        self.corrupt = False
        self._away[:] = 0
        self._target = None
        self._near.accept()

    def reset(self, q: Array, now: float = -np.inf) -> None:
        """Start over at `q` at rest, e.g. after the arm was put there; steps from before are void."""
        q = np.asarray(q, dtype=float)
        if q.shape != (self._n,) or not np.isfinite(q).all():
            raise BadInput(f"expected {self._n} finite joint positions, got {q.tolist()}")
        self._q, self._v, self._anchored = q.copy(), np.zeros(self._n), True
        self._target, self._newest, self.fault, self.kind = None, now, "", ""
        self._away[:] = 0
        self.corrupt = self._astray = False
        self._near.forget()
        self.saturated = self._none

    @property
    def outside(self) -> NDArray[np.bool_]:
        """(n,) whether each joint is beyond one of its limits; only inward motion passes there."""
        lower, upper = (np.array([getattr(j, name) for j in self.joints]) for name in ("lower", "upper"))
        return (self._q < lower - 1e-6) | (self._q > upper + 1e-6)

    @property
    def held_off(self) -> str:
        """What keeps the arm from going on, such as `the forearm and the table`; empty while nothing does."""
        pair = self._near.holding if self._target is not None else None
        return f"{pair.first} and {pair.second}" if pair else ""

    @property
    def at_rest(self) -> bool:
        return not self._v.any()
