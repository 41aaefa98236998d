"""`vita serve`: the app from start to Ctrl+C."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from vita.errors import MissingDependency
from vita.fuzz.knock import knock
from vita.logs import keep_log
from vita.run_file import RunFile
from vita.scenario.schema import Scenario
from vita.ui import selfcheck
from vita.ui.app import App, RunnerLike
from vita.ui.drill import Drill
from vita.ui.hardening import check_token
from vita.ui.ports import check_free, check_reach

OPEN_TIMEOUT_S = 20.0


def serve(
    scenario: Scenario,
    host: str = "127.0.0.1",
    port: int = 8080,
    *,
    allow_remote: bool = False,
    token: str | None = None,
    allow_unattended: bool = False,
    make_runner: Callable[[Scenario], RunnerLike] | None = None,
    ready: Callable[[App], None] | None = None,
) -> None:
    """Run the app until SIGINT or SIGTERM; then stop the arm, close the rig and free the port.

    Raises `BadInput` when the port is taken, or the host can be reached from other machines without
    `allow_remote`, before the simulation is started; `Unprotected` when an attack on the page succeeds.
    `token` is what pages must know; with `allow_remote` there is one, given or made. `ready` is called once
    the page can be opened.
    """
    check_reach(host, allow_remote)
    check_token(token)
    check_free(host, port)
    if os.environ.get("VITA_LOG"):
        keep_log(Path(os.environ["VITA_LOG"]).expanduser())
    leave = threading.Event()
    previous = {}

    def asked(number: int, frame: FrameType | None) -> None:
        leave.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        previous[number] = signal.signal(number, asked)
    runner: RunnerLike | None = None
    app: App | None = None
    run_file: RunFile | None = None
    try:
        if make_runner is None:
            from vita.runner import live_runner

            runner = live_runner(scenario)
        else:
            runner = make_runner(scenario)
        if not leave.is_set():
            app = App(
                runner, host, port, allow_remote=allow_remote, token=token, allow_unattended=allow_unattended
            )
            wait_until_open(app.door.own_address)
            selfcheck.check(app.door)
            run_file = RunFile(app.port)
            run_file.follow(runner)
            print(f"vita is at {app.door.address}", flush=True)
            introduce = getattr(runner, "has_page", None)
            if introduce is not None:
                introduce(Drill(app.door))
            if ready is not None:
                ready(app)
            while not leave.wait(0.25):
                run_file.follow(runner)  # A simulation that was restarted has another process.
    finally:
        try:
            if app is not None:
                print("vita is stopping", file=sys.stderr, flush=True)
            if runner is not None:
                runner.stop()
            if app is not None:
                app.close()
        finally:
            if runner is not None:
                runner.close()
            if run_file is not None:
                run_file.remove()
            for number, handler in previous.items():
                signal.signal(number, handler)


def wait_until_open(address: tuple[str, int]) -> None:
    """Return once the page answers over HTTP."""
    deadline = time.monotonic() + OPEN_TIMEOUT_S
    while True:
        try:
            with knock(address) as answer:
                if answer.status not in (0, 503):
                    return
        except OSError:
            pass
        if time.monotonic() > deadline:
            raise MissingDependency(f"the page did not open at port {address[1]} in {OPEN_TIMEOUT_S:.0f} s")
        time.sleep(0.05)
