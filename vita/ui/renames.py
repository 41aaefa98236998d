"""The selected marker stays selected while its name is typed: each pause in typing renames it. Pure logic.

Without this the marker would lose the selection at the first pause, the text field would go, and the rest
of the name would be taken for keys: a space starts the arm.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection

FORGET_S = 1.5
"""A name that has not come by then was refused [s]."""


class Renames:
    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._chain: list[str] = []
        """The name that the marker had, and those that were asked for since."""
        self._asked_at = 0.0

    def ask(self, selected: str, new: str) -> str:
        """Note that `new` is asked for; returns the name that the marker will have by then."""
        now = self._clock()
        if selected not in self._chain or now - self._asked_at > FORGET_S:
            self._chain = [selected]
        self._asked_at = now
        self._chain.append(new)
        return self._chain[-2]

    def follow(self, selected: str, known: Collection[str]) -> str | None:
        """What the marker `selected`, which is not among the `known` names any more, is called now."""
        if selected not in self._chain:
            return None
        later = self._chain[self._chain.index(selected) + 1 :]
        return next((name for name in reversed(later) if name in known), None)

    def typed(self, name: str | None) -> bool:
        """Whether a name was asked for here, so that the text field shows it, or more of it, already."""
        return name in self._chain[1:]
