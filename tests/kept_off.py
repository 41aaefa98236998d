"""Listens to what keeps an arm off things while it runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from vita.servo.keep_off import KeepOff


@dataclass
class KeptOff:
    """What a run came near to."""

    smallest: float = np.inf
    """The smallest distance [m]."""
    slowed: int = 0
    """Gate cycles in which something near slowed the arm."""
    by: set[str] = field(default_factory=set)
    """What did."""


@contextmanager
def listening() -> Iterator[KeptOff]:
    """Of every gate in this process, while the block runs."""
    found = KeptOff()
    take, share = KeepOff.take, KeepOff.share

    def taking(self, near):
        found.smallest = min(found.smallest, float(near.distances.min()))
        return take(self, near)

    def sharing(self, *arguments):
        answer = share(self, *arguments)
        if self.holding is not None:
            found.slowed += 1
            found.by.add(self.holding.touches)
        return answer

    KeepOff.take, KeepOff.share = taking, sharing  # type: ignore[method-assign, assignment]
    try:
        yield found
    finally:
        KeepOff.take, KeepOff.share = take, share
