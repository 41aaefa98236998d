"""An error vector that is measured elsewhere: another thread, a socket, a ROS topic.

It is the only thing that couples vision and servo, as the topic `/image_error` of the thesis' library.
"""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import ArrayLike

from vita.types import Array, frozen


class ErrorFeed:
    """Give it to `VisualServo` as `measure`; another thread calls `put` with each new error vector.

    Every call waits for an error that is put after the call began, so that the error is of the arm
    where it stands now and not from before the last motion. For a source that sends exactly one error
    for each motion say `queued=True`: then one that came already is taken. Without any for `timeout_s`
    all rows count as not seen, and the servo holds the arm (`tracker_lost`).
    """

    def __init__(self, rows: int, timeout_s: float = 1.0, *, queued: bool = False) -> None:
        self._news = threading.Condition()
        self._latest = frozen(np.full(rows, np.nan))
        self._number = self._taken = 0
        self._timeout_s, self._queued = timeout_s, queued

    def put(self, error: ArrayLike) -> None:
        """Publish an error vector (m,), NaN in rows that are not seen. Never waits."""
        with self._news:
            self._latest = frozen(error)
            self._number += 1
            self._news.notify_all()

    def __call__(self) -> Array:
        """(m,) the next error; NaN when none comes in time."""
        with self._news:
            last = self._taken if self._queued else self._number
            came = self._news.wait_for(lambda: self._number > last, self._timeout_s)
            self._taken = self._number
            return self._latest if came else frozen(np.full(self._latest.shape, np.nan))
