"""A page that is served, a stand-in for the robot behind it, and clients without a browser."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest
from fake_runner import FakeRunner, two_cameras

from vita.faults import Site, Tap, inject
from vita.fuzz.client import Client
from vita.fuzz.knock import Answer, knock
from vita.scenario.schema import ConstraintSpec, Scenario, TrackerSpec
from vita.ui import App
from vita.ui.drill import Drill


def drawn() -> Scenario:
    """A task that can be started."""
    trackers = (
        TrackerSpec("tip", "left", "fixed", (100.0, 100.0)),
        TrackerSpec("goal", "left", "fixed", (200.0, 150.0)),
    )
    meet = ConstraintSpec("meet", "point_to_point", ("tip", "goal"))
    return replace(two_cameras(), tracker=trackers, constraint=(meet,))


class LivePage:
    def __init__(self, **how: Any) -> None:
        self.runner = FakeRunner(drawn())
        self.app = App(self.runner, port=0, **how)
        self.door, self.server = self.app.door, self.app.server
        drill = Drill(self.door)
        self.site = Site(None, Tap(), address=drill.own_address, page=drill, later=self._later)  # type: ignore
        self.idle_ms = 0.0
        """How long Stop takes on this machine with nothing else going on [ms]."""
        self._guests: list[Any] = []
        self._tries: list[threading.Thread] = []

    @property
    def address(self) -> tuple[str, int]:
        return self.door.own_address

    @property
    def state(self) -> str:
        return self.runner.snapshot().status.state

    def client(self, **how: Any) -> Client:
        """One more page; it leaves at the end of the test."""
        made = Client(self.address, headers=self.door.badge, **how)
        self._guests.append(made)
        return made

    def knock(self, path: str = "/", /, websocket: bool = True, **headers: str | None) -> Answer:
        made = knock(self.address, path, self.door.badge | headers, websocket=websocket)
        self._guests.append(made)
        return made

    def driving(self) -> Client:
        """A page that drives, with the arm under way."""
        page = self.client()
        page.wait(lambda: not page.widget("Start").props["disabled"], "Start")
        page.click("Start")
        self.until(lambda: self.state == "servoing", "the arm to move")
        return page

    def inject(self, row: str) -> None:
        inject(row, self.site)

    def tried(self) -> None:
        """What was injected is over."""
        for thread in self._tries:
            thread.join(20.0)
            assert not thread.is_alive()
        self._tries.clear()

    def until(self, condition: Callable[[], Any], what: str, seconds: float = 5.0) -> float:
        """How long it took [s]."""
        started = time.monotonic()
        while not condition():
            if time.monotonic() - started > seconds:
                pytest.fail(f"waited {seconds:g} s for {what}")
            time.sleep(0.002)
        return time.monotonic() - started

    def stop_ms(self, page: Client, times: int = 5, every_s: float = 0.02) -> list[float]:
        """Click to the runner's flag, by a page that is open already [ms], sorted."""
        button, took = page.widget("Stop").uuid, []
        for _ in range(times):
            before, started = self.runner.stops, time.perf_counter()
            page.send_value(button, True)
            while self.runner.stops == before:
                assert time.perf_counter() - started < 5.0, "Stop did not arrive"
                time.sleep(0.0002)
            took.append(1e3 * (time.perf_counter() - started))
            time.sleep(every_s)
        return sorted(took)

    def empty(self) -> None:
        """Everybody leaves, and the page is as at the start."""
        self.site.tap.mend()
        self.tried()
        for guest in self._guests:
            guest.close()
        self._guests.clear()
        self.until(lambda: not self.door.pages, "the last page to leave")
        self.runner.scenario = drawn()
        self.runner.log.clear()
        self.app.run._stopped_at = -10.0  # else a Start is taken for the other half of a Stop by key
        self.app.commands.lease.closed(self.app.commands.lease.driver or 0)
        self.app.commands.lease._driver = None

    def close(self) -> None:
        self.empty()
        self.app.close()
        self.runner.close()

    def _later(self, act: Callable[[], None]) -> None:
        thread = threading.Thread(target=act, daemon=True)
        self._tries.append(thread)
        thread.start()


@contextmanager
def live_page(**how: Any) -> Iterator[LivePage]:
    made = LivePage(**how)
    try:
        made.idle_ms = made.stop_ms(made.client(), times=9)[4]
        made.empty()
        yield made
    finally:
        made.close()
