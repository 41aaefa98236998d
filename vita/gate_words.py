"""What the gate did without stopping the arm, in words for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from vita.types import Joint

AGAIN_PERIODS = 90
"""Bad commands less than so many control periods apart are one story."""


class GateWords:
    """Says each thing once, when it begins."""

    def __init__(self) -> None:
        self._bad: int | None = None
        self._quiet = AGAIN_PERIODS
        self._outside: frozenset[int] = frozenset()
        self._held_off = ""

    def update(self, gate: Mapping[str, object], joints: Sequence[Joint]) -> list[str]:
        """New sentences; `gate` is what `Rig.gate_state` gives, of which parts may be missing."""
        said = []
        bad = gate.get("bad", 0)
        self._quiet += 1
        if isinstance(bad, int):
            if self._bad is not None and bad > self._bad:
                if self._quiet > AGAIN_PERIODS:
                    said.append("A command that was not a number was stopped at the gate; the arm braked.")
                self._quiet = 0
            self._bad = bad
        indices = gate.get("outside", ())
        outside = frozenset(indices) if isinstance(indices, (list, tuple)) else frozenset()
        for joint in sorted(outside - self._outside):
            name = joints[joint].name
            said.append(f"{_words(name)} is out of its range: only motion inwards is possible.")
        self._outside = outside
        held = str(gate.get("held_off", ""))
        if held and held != self._held_off:
            said.append(f"The arm is slowed down, because {held} are close together.")
        self._held_off = held or self._held_off
        return said


def _words(name: str) -> str:
    """`joint2` reads as Joint 2."""
    bare = name.removeprefix("joint")
    return f"Joint {bare if bare.isdigit() else name}"
