"""Says when simulated time falls behind the clock on the wall, so that a slow arm surprises nobody."""

from __future__ import annotations

SLOW, WELL = 0.5, 0.8
"""Simulated seconds per second on the wall below which it is said, and above which it is well again."""
LOOKS = 30
"""Control periods in a row before anything is said: a single slow picture is no news."""


class Pace:
    """Watches one rig."""

    def __init__(self) -> None:
        self._slow, self._count = False, 0

    def look(self, factor: float) -> str:
        """What to tell people now, mostly nothing."""
        changed = factor > WELL if self._slow else factor < SLOW
        self._count = self._count + 1 if changed else 0
        if self._count < LOOKS:
            return ""
        self._slow, self._count = not self._slow, 0
        if self._slow:
            return (
                f"The simulation runs at {factor:.1f}×: the machine cannot keep up. The arm is slower, and "
                "keeps its limits."
            )
        return f"The simulation keeps up again ({factor:.1f}×)."
