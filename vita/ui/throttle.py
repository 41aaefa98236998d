"""How much one connection may say, and how often the log may repeat itself."""

from __future__ import annotations

from typing import Generic, Literal, TypeVar

RATE, BURST = 120.0, 240.0
"""Messages a second of one connection, and how many at once: a drag makes 20 to 60 a second."""
STOP_RATE, STOP_BURST = 20.0, 4.0
"""Stops have a purse of their own. They are idempotent, so more would only cost time."""
READ_RATE, READ_BURST = 2000.0, 64.0
"""Frames a second that are looked at; beyond, the socket is left unread and the sender has to wait."""
HELD_MAX = 64

T = TypeVar("T")
Kind = Literal["stop", "click", "value"]


class Bucket:
    """Tokens that come at a rate and can be saved up to a burst. Time is an argument [s]."""

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._tokens, self._at = burst, -1e9

    def take(self, now: float) -> bool:
        """Spend one, if there is one."""
        self._fill(now)
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True

    def wait_s(self, now: float) -> float:
        """Until there is one."""
        self._fill(now)
        return max(0.0, (1.0 - self._tokens) / self._rate)

    def _fill(self, now: float) -> None:
        self._tokens = min(self._burst, self._tokens + max(0.0, now - self._at) * self._rate)
        self._at = now


class Valve(Generic[T]):
    """Lets through what one connection says, at most so fast.

    In a flood values are held, the newest of each widget, and follow when there is room; clicks are
    dropped, because a click that acts late is worse than one that does not act; a Stop passes at once.
    """

    def __init__(self) -> None:
        self._all, self._stops = Bucket(RATE, BURST), Bucket(STOP_RATE, STOP_BURST)
        self._held: dict[object, T] = {}
        self._urgent: dict[object, T] = {}
        self.dropped = 0

    def offer(self, key: object, message: T, kind: Kind, now: float) -> T | None:
        """`message` if it may pass now. `key` is the same for what one replaces the other."""
        if kind == "stop":
            self._urgent[key] = message
            return self.due(now)
        if kind == "click":
            if self._all.take(now):
                return message
            self.dropped += 1
            return None
        if not self._held and self._all.take(now):
            return message
        self.dropped += key in self._held
        self._held[key] = message
        return self.due(now)

    def due(self, now: float) -> T | None:
        """What was held and may pass now."""
        if self._urgent and self._stops.take(now):
            return self._urgent.pop(next(iter(self._urgent)))
        if self._held and self._all.take(now):
            return self._held.pop(next(iter(self._held)))
        return None

    def wait_s(self, now: float) -> float | None:
        """Until something that is held may pass; None with nothing held."""
        waits = [self._stops.wait_s(now)] if self._urgent else []
        if self._held:
            waits.append(self._all.wait_s(now))
        return min(waits, default=None)

    @property
    def full(self) -> bool:
        return len(self._held) >= HELD_MAX


class Seldom:
    """At most one line a second of each kind, with how many were left out."""

    def __init__(self, period_s: float = 1.0) -> None:
        self._period_s = period_s
        self._last: dict[str, float] = {}
        self._left_out: dict[str, int] = {}

    def __call__(self, kind: str, now: float) -> str | None:
        """What to append to the line (nothing, or a count), or None for not now."""
        if now - self._last.get(kind, -1e9) < self._period_s:
            self._left_out[kind] = self._left_out.get(kind, 0) + 1
            return None
        self._last[kind] = now
        more = self._left_out.pop(kind, 0)
        return f" (and {more} more like it)" if more else ""
