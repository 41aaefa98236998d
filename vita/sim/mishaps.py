"""Faults that are made inside a simulated world, for trying what everything else makes of them.

They sit behind the gate on purpose, where a physics engine really fails: nothing here moves the arm.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from vita.errors import BadInput, UnknownName
from vita.sim.arm import Arm
from vita.sim.bullet import pybullet as p

KINDS = ("corrupt", "slow", "error", "mend")
MOST_SLOW_S = 0.05
"""More would be taken for a process that was suspended [s]."""


class Mishaps:
    """What goes wrong in one world; nothing until `make` is asked to."""

    def __init__(self, nap: Callable[[float], None] = time.sleep) -> None:
        self._nap = nap
        self._slow_s, self._corrupt, self._error = 0.0, False, ""

    def make(self, kind: str, value: float = 0.0) -> None:
        """`corrupt`: joint states become NaN at the next step. `slow`: each step takes `value` seconds
        longer. `error`: pybullet fails at the next step. `mend`: no more of it."""
        if kind not in KINDS:
            raise UnknownName("mishap", kind, KINDS)
        if not 0.0 <= value <= MOST_SLOW_S:
            raise BadInput(f"a step may be slower by 0 to {MOST_SLOW_S:g} s, got {value!r}", kind)
        if kind == "corrupt":
            self._corrupt = True
        elif kind == "error":
            self._error = "failure made on purpose"
        else:
            self._slow_s = value if kind == "slow" else 0.0

    def befall(self, arm: Arm) -> None:
        """Called once in each cycle, between the motors' targets and the physics."""
        if self._slow_s:
            self._nap(self._slow_s)
        if self._corrupt:
            self._corrupt = False
            arm.poison()
        if self._error:
            error, self._error = self._error, ""
            raise p.error(error)
