"""Who drives: one page at a time, kept through a reload, free again when the page has been gone for a while.

The first page that does something drives, so that one person alone notices nothing of all this. Pages are
known by the number of their connection, which is new after every reload, and by a token that the browser
keeps. Pure bookkeeping: no page, no thread, and the time comes from outside.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Concatenate, ParamSpec, TypeVar

from vita.errors import NotNow

AWAY_S = 10.0
"""So long the place of a driver whose page is gone is kept for it [s]."""

P = ParamSpec("P")
R = TypeVar("R")


@dataclass
class _Page:
    """One open page."""

    number: int
    token: str | None = None
    shown_at: float = 0.0
    """When it showed its token [s]."""


@dataclass
class _Driver:
    """The page that drives, or that drove a moment ago."""

    client: int | None
    """Its connection; None while it is away."""
    number: int
    token: str | None
    left_at: float = 0.0


def _alone(method: Callable[Concatenate[Lease, P], R]) -> Callable[Concatenate[Lease, P], R]:
    """One at a time: pages come and go in several threads."""

    @functools.wraps(method)
    def locked(self: Lease, *args: P.args, **kwargs: P.kwargs) -> R:
        with self._lock:
            return method(self, *args, **kwargs)

    return locked


@dataclass
class Lease:
    """The right to command the arm."""

    clock: Callable[[], float]
    _pages: dict[int, _Page] = field(default_factory=dict)
    _driver: _Driver | None = None
    _lock: threading.RLock = field(default_factory=threading.RLock, repr=False)  # type: ignore

    # Pages come and go.

    @_alone
    def opened(self, client: int) -> None:
        """A page was opened; it watches until it does something. Pages are counted from 1 for people."""
        if client in self._pages:
            return
        taken = {page.number for page in self._pages.values()}
        kept = self._kept()
        if kept is not None:
            taken.add(kept.number)
        self._pages[client] = _Page(next(n for n in range(1, len(taken) + 2) if n not in taken))

    @_alone
    def showed(self, client: int, token: str) -> bool:
        """The browser of a page told its token. True when this is the driver, who has come back in time."""
        page = self._pages.get(client)
        if page is None:
            return False
        page.token, page.shown_at = token, self.clock()
        driver = self._kept()
        if driver is not None and driver.client == client:
            driver.token = token
        return self._give_back(client)

    @_alone
    def closed(self, client: int) -> bool:
        """A page is gone. True when it drove and nobody has taken its place: the arm has to stop."""
        self._pages.pop(client, None)
        driver = self._driver
        if driver is None or driver.client != client:
            return False
        driver.client, driver.left_at = None, self.clock()
        # A page that is reloaded may come back before the old connection is known to be dead.
        for other, page in self._pages.items():
            if page.token is not None and driver.left_at - page.shown_at < AWAY_S:
                self._give_back(other)
        return True

    # Who may command.

    @property
    @_alone
    def driver(self) -> int | None:
        """Connection of the page that drives; None when nobody does, or the driver is away."""
        driver = self._kept()
        return None if driver is None else driver.client

    @_alone
    def drives(self, client: int) -> bool:
        driver = self._kept()
        return driver is not None and driver.client == client

    @_alone
    def refusal(self, client: int | None) -> str:
        """Why a page may not command; empty where it may."""
        driver = self._kept()
        return "" if driver is None or driver.client == client else self._refusal(driver)

    @_alone
    def claim(self, client: int) -> None:
        """The page does something that only the driver may. Raises `NotNow` when another one drives."""
        driver = self._kept()
        if driver is None:
            self._seat(client)
        elif driver.client != client:
            raise NotNow(self._refusal(driver))

    @_alone
    def take_over(self, client: int, resting: bool) -> None:
        """Drive instead of the page that does; only while the arm rests."""
        if self.drives(client):
            return
        if not resting:
            raise NotNow("The arm moves. Stop it, then take over.")
        self._seat(client)

    # What people are told.

    @_alone
    def number(self, client: int | None) -> int:
        """What a page is called; 0 for one that is gone."""
        page = self._pages.get(-1 if client is None else client)
        return 0 if page is None else page.number

    @_alone
    def identity(self, client: int) -> str:
        """The browser behind a page: the same one after a reload, if it has told its token."""
        page = self._pages.get(client)
        return (page.token if page is not None else None) or str(client)

    @property
    @_alone
    def pages(self) -> tuple[int, ...]:
        """The connections of the open pages."""
        return tuple(self._pages)

    @property
    @_alone
    def away(self) -> tuple[int, float] | None:
        """Number of a driver who is gone, and for how long the place is still kept [s]."""
        driver = self._kept()
        if driver is None or driver.client is not None:
            return None
        return driver.number, AWAY_S - (self.clock() - driver.left_at)

    # Within.

    def _kept(self) -> _Driver | None:
        """The driver, unless away for too long."""
        driver = self._driver
        if driver is not None and driver.client is None and self.clock() - driver.left_at >= AWAY_S:
            self._driver = None
        return self._driver

    def _seat(self, client: int) -> None:
        page = self._pages.get(client)
        if page is None:
            raise NotNow("This page is not open any more.")
        self._driver = _Driver(client, page.number, page.token)

    def _give_back(self, client: int) -> bool:
        driver, page = self._kept(), self._pages[client]
        if driver is None or driver.client is not None or driver.token != page.token:
            return False
        page.number, driver.client = driver.number, client
        return True

    def _refusal(self, driver: _Driver) -> str:
        if driver.client is None:
            left = AWAY_S - (self.clock() - driver.left_at)
            return f"Page {driver.number} drove and may come back within {left:.0f} s. Wait, or take over."
        return f"Page {driver.number} drives. Take over when the arm rests."
