"""Where the time of a tick goes: medians over the last second or so."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable
from statistics import median

from vita.types import Timing

KEEP = 45


class Stopwatch:
    """Measures the phases of a repeated tick."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._laps: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=KEEP))
        self._begins: deque[float] = deque(maxlen=KEEP)
        self._last = clock()

    def begin(self) -> None:
        self._last = self._clock()
        self._begins.append(self._last)

    def lap(self, phase: str) -> None:
        """The time since the last `begin` or `lap` went into `phase`."""
        now = self._clock()
        self._laps[phase].append(1e3 * (now - self._last))
        self._last = now

    def timing(self) -> Timing:
        span = self._begins[-1] - self._begins[0] if len(self._begins) > 1 else 0.0
        loop_hz = (len(self._begins) - 1) / span if span > 0 else 0.0
        return Timing(loop_hz, {phase: median(laps) for phase, laps in self._laps.items()})
