"""A setting that is changed while the arm moves takes hold little by little."""

from __future__ import annotations

SHARE = 0.1
"""Share of the setting's range by which it may change in one period."""


class Ramp:
    """Follows a value at a bounded rate; `full_range` is what the setting can span."""

    def __init__(self, full_range: float) -> None:
        self._most = SHARE * full_range
        self._now: float | None = None

    def restart(self) -> None:
        """At rest a change is in force at once."""
        self._now = None

    def follow(self, wanted: float) -> float:
        """The value to use in this period."""
        if self._now is None:
            self._now = wanted
        self._now += min(max(wanted - self._now, -self._most), self._most)
        return self._now
