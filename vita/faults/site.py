"""What an injector may lay its hands on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from vita.faults.tap import Tap

if TYPE_CHECKING:
    from vita.engine import Engine


@dataclass
class Site:
    """A running engine, and in the app the things around it."""

    engine: Engine
    tap: Tap
    child_pid: int | None = None
    """Process of the live rig; None where the simulation is in this process."""
    address: tuple[str, int] | None = None
    """Host and port of the page; None without one."""
    page: Any = None
    """The page's `vita.ui.drill.Drill`; None without one."""
    later: Callable[[Callable[[], None]], None] | None = None
    """Runs something in a thread of its own, for injectors that wait (a flood, a process that is frozen for a
    while); None where nothing may wait, as in tests that step by hand."""
