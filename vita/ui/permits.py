"""The one way from pages to the arm: every command passes here with the page that it came from.

Callbacks of the page run one after the other on viser's event loop, each to its end, so that a context
variable tells whose callback is running; nothing below has to hand the page on. What the page's own
thread sends (the constraint that the last click completed) is the driver's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Protocol

from vita import commands as c
from vita.errors import NotNow
from vita.snapshot import Snapshot
from vita.types import MOVING_STATES
from vita.ui.ownership import Lease

Callback = Callable[[Any], None]
Guard = Callable[[Callback], Callable[[Any], Any]]

ACTING: ContextVar[int | None] = ContextVar("vita_acting_page", default=None)
"""The page whose callback is running; None in the page's own thread."""
EDITS = (
    c.AddTracker, c.MoveTracker, c.RenameTracker, c.DeleteTracker, c.AddConstraint, c.DeleteConstraint,
    c.SetWeight, c.SetPriority, c.ClearTask, c.Undo, c.Redo, c.LoadTask, c.ResetArm, c.SetMode,
)  # fmt: skip
"""What changes the task. Such a command belongs to the task that the page had before it."""
LAG_TICKS = 1
"""A command may be applied one control period after the newest picture and shows in the one after."""


class Takes(Protocol):
    """What is behind the doors."""

    def submit(self, command: Any) -> None: ...
    def stop(self, reason: str = ...) -> None: ...
    def estop(self, culprit: str = ...) -> None: ...
    def snapshot(self) -> Snapshot: ...


class Commands:
    """Who may do what. Stop and emergency stop are everybody's, and never wait."""

    def __init__(
        self, runner: Takes, lease: Lease, seen: Callable[[int], int | None] = lambda client: None,
        allow_unattended: bool = False,
    ) -> None:
        """`seen`: number of the last picture (`Snapshot.tick`) that a page was shown, None if not known.
        `allow_unattended` lets the arm go on when its driver has left; simulation only."""
        self.lease, self._runner, self._seen = lease, runner, seen
        self.allow_unattended = allow_unattended
        self._edited: tuple[int, int] | None = None
        """The page that made the last edit, and the picture after which it did."""
        self._stopped: tuple[int, int] | None = None

    # What pages ask.

    def submit(self, client: int | None, command: object, revision: int | None = None) -> None:
        """Hand a command of a page to the runner. Raises `NotNow` when another page drives, and for what
        was asked of a task or a state that another page has changed meanwhile. `revision` is the number of
        the picture that the page went by; without it, the last one that it was shown."""
        tick = self._runner.snapshot().tick
        if client is not None:
            self.lease.claim(client)
            by = revision if revision is not None else self._seen(client)
            self._check_fresh(client, command, tick if by is None else by)
        author = self.lease.driver if client is None else client
        if author is not None and isinstance(command, EDITS):
            self._edited = author, tick
        self._runner.submit(command)

    def stop(self, client: int | None) -> None:
        """Rest now, whoever asks."""
        self._note_stop(client)
        self._runner.stop()

    def estop(self, client: int | None) -> None:
        """Rest now and latch, whoever asks."""
        self._note_stop(client)
        number = self.lease.number(client)
        several = len(self.lease.pages) > 1 and number
        self._runner.estop(f"pressed at page {number}" if several else "pressed at the page")

    def take_over(self, client: int) -> None:
        """Drive from another page; only while the arm rests."""
        state = self._runner.snapshot().status.state
        self.lease.take_over(client, state not in MOVING_STATES)

    def left(self, client: int) -> bool:
        """A page is gone. True when it drove a moving arm, which has been stopped for that."""
        moving = self._runner.snapshot().status.state in MOVING_STATES
        if not self.lease.closed(client) or self.allow_unattended:
            return False
        self._runner.stop("driver_left")  # At once and always: a Start may be in the queue.
        return moving

    # Callbacks.

    def driving(self, guard: Guard) -> Guard:
        """Of callbacks that only the page that drives may run. Whoever is first drives."""

        def decorate(function: Callback) -> Callable[[Any], Any]:
            def checked(event: Any) -> None:
                self.lease.claim(event.client_id)
                function(event)

            return guard(_acting(checked))

        return decorate

    def anyone(self, guard: Guard) -> Guard:
        """Of callbacks that look, stop, or check for themselves."""
        return lambda function: guard(_acting(function))

    # Within.

    def _note_stop(self, client: int | None) -> None:
        if client is not None:
            self._stopped = client, self._runner.snapshot().tick

    def _check_fresh(self, client: int, command: object, by: int) -> None:
        """Nothing is done to a task, or started, that another page has changed since the page looked."""
        if isinstance(command, (*EDITS, c.Start)) and _unseen(self._edited, client, by):
            raise NotNow("The task was changed meanwhile from another page. Look, then do it again.")
        if isinstance(command, c.Start) and _unseen(self._stopped, client, by):
            raise NotNow("Stopped meanwhile from another page. Look, then press Start again.")


def _unseen(act: tuple[int, int] | None, client: int, by: int) -> bool:
    """Whether another page did something that a page which goes by picture `by` cannot have seen."""
    return act is not None and act[0] != client and by <= act[1] + LAG_TICKS


@contextmanager
def as_the_page() -> Iterator[None]:
    """What happens within is the page's own doing, though somebody's click led to it."""
    token = ACTING.set(None)
    try:
        yield
    finally:
        ACTING.reset(token)


def _acting(function: Callback) -> Callback:
    """Runs a callback in the name of its page."""

    def acting(event: Any) -> None:
        token = ACTING.set(event.client_id)
        try:
            function(event)
        finally:
            ACTING.reset(token)

    return acting
