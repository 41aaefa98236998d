"""What every fuzzer answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Report:
    """The outcome of a fuzzer, `run(seconds, seed) -> Report`."""

    name: str
    tried: int
    """How many inputs."""
    unit: str
    """What an input is, in the plural: `control cycles`, `files`, `frames`, ..."""
    violations: tuple[str, ...] = ()
    """What should never happen and did, each with what reproduces it."""
    figures: Mapping[str, float] = field(default_factory=dict)
    """Further figures, named with their units."""

    @property
    def passed(self) -> bool:
        return self.tried > 0 and not self.violations
