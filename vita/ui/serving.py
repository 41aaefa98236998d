"""`vita serve`: the app from start to Ctrl+C."""

from __future__ import annotations

import signal
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from types import FrameType

from vita.errors import MissingDependency
from vita.scenario.schema import Scenario
from vita.ui.app import App, RunnerLike
from vita.ui.ports import check_free

OPEN_TIMEOUT_S = 20.0


def serve(
    scenario: Scenario,
    host: str = "127.0.0.1",
    port: int = 8080,
    *,
    make_runner: Callable[[Scenario], RunnerLike] | None = None,
    ready: Callable[[App], None] | None = None,
) -> None:
    """Run the app until SIGINT or SIGTERM; then stop the arm, close the rig and free the port.

    Raises `BadInput` when the port is taken, before the simulation is started. `ready` is called
    once the page can be opened.
    """
    check_free(host, port)
    leave = threading.Event()
    previous = {}

    def asked(number: int, frame: FrameType | None) -> None:
        leave.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        previous[number] = signal.signal(number, asked)
    runner: RunnerLike | None = None
    app: App | None = None
    try:
        if make_runner is None:
            from vita.runner import live_runner

            runner = live_runner(scenario)
        else:
            runner = make_runner(scenario)
        if not leave.is_set():
            app = App(runner, host, port)
            wait_until_open(app.url)
            print(f"vita is at {app.url}", flush=True)
            if ready is not None:
                ready(app)
            while not leave.wait(0.5):
                pass
    finally:
        try:
            if runner is not None:
                runner.stop()
            if app is not None:
                app.close()
        finally:
            if runner is not None:
                runner.close()
            for number, handler in previous.items():
                signal.signal(number, handler)


def wait_until_open(url: str) -> None:
    """Return once the page answers over HTTP."""
    deadline = time.monotonic() + OPEN_TIMEOUT_S
    # A proxy from the environment must not stand between us and our own machine.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    while True:
        try:
            with opener.open(url, timeout=2.0) as answer:
                if answer.status == 200:
                    return
        except (urllib.error.URLError, OSError):
            pass
        if time.monotonic() > deadline:
            raise MissingDependency(f"the page did not open at {url} within {OPEN_TIMEOUT_S:.0f} s")
        time.sleep(0.05)
