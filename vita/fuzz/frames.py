"""Hostile frames by the thousand, against a page that stands: `vita fuzz frames`.

The page, its runner and the gate are the real ones, the arm is a stick. An honest page drives and does
nothing; hostile pages come and go and say whatever they like. The honest one has to be able to stop the arm
at any time, nothing may change, and the log may hold no traceback.
"""

from __future__ import annotations

import io
import logging
import random
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from vita.fuzz.base import Report
from vita.fuzz.client import CAMERA, Client, TurnedAway
from vita.fuzz.knock import frame, knock
from vita.fuzz.malformed import pack
from vita.fuzz.rude import Rude
from vita.fuzz.stick_rig import StickRig, stick_task

PERIOD_S = 1.0 / 30.0
STOP_WITHIN_S = 1.0
"""A stop that takes this long was lost; how long they take is among the figures."""
GROWTH_MB = 20.0
BATCH = 40
CODES = (None, 1000, 1001, 1002, 1003, 1006, 1007, 1008, 1009)
"""How a connection may end; 1011 would be an error of ours."""


class Paced(StickRig):
    """In real time, as the page expects it."""

    def observe(self) -> Any:
        time.sleep(PERIOD_S)
        return super().observe()


class Siege:
    """The page under attack, and what is watched."""

    def __init__(self, seed: int) -> None:
        from vita.runner import Runner
        from vita.ui.app import App

        self.rng, self.seed = random.Random(seed), seed
        self.violations: list[str] = []
        self.stops, self.took_ms, self.tried = 0, [], 0
        self.runner = Runner(lambda scenario: Paced(), stick_task())
        real = self.runner.stop

        def counted(*reason: str) -> None:
            self.stops += 1
            real(*reason)

        self.runner.stop = counted  # type: ignore[method-assign]
        self.app = App(self.runner, port=0)
        self.honest = Client(self.app.door.own_address)
        self.honest.wait(lambda: self.app.boards, "the page to stand")
        self._drive()
        widgets = dict(self.app.server.gui._gui_input_handle_from_uuid)
        self.known = [uuid for uuid, handle in widgets.items() if handle._impl.update_cb]
        self.stop_uuid = self.honest.widget("Stop").uuid
        self.rude = Rude(self.rng, list(self.honest.widgets.values()), tuple(self.app.door.urgent))
        self.before = self.picture()

    def close(self) -> None:
        self.honest.close()
        self.app.close()
        self.runner.close()

    def picture(self) -> dict[str, object]:
        """All that hostile pages must not change."""
        snapshot = self.runner.snapshot()
        widgets = {
            uuid: handle._impl for uuid in self.known
            if (handle := self.app.server.gui._gui_input_handle_from_uuid.get(uuid)) is not None
        }  # fmt: skip
        return {
            "task": snapshot.scenario, "state": snapshot.status.state,
            "driver": self.app.commands.lease.driver,
            "values": {uuid: w.value for uuid, w in widgets.items() if not w.is_button},
            "callbacks": {uuid: len(w.update_cb) for uuid, w in widgets.items()},
            "removed widgets": {uuid: w.removed for uuid, w in widgets.items()},
        }  # fmt: skip

    def batch(self) -> None:
        """One hostile page, from its coming to its end."""
        try:
            kind = self.rng.random()
            if kind < 0.1:
                self._noise()
            elif kind < 0.3:
                self._page()
            else:
                self._bare_page()
        except TurnedAway as refusal:
            if refusal.status != 503:
                self._violated(f"a page was answered {refusal.status}")
        self._stop()
        now = self.picture()
        for what, was in self.before.items():
            if now[what] != was:
                self._violated(f"{what} changed: {_difference(was, now[what])}")
        self.before = now

    def _page(self) -> None:
        said: list[str] = []
        with Client(self.app.door.own_address, camera=self.rng.random() < 0.5) as page:
            for _ in range(self.rng.randint(1, BATCH)):
                kind, payload = self.rude.frame()
                said.append(f"{kind} {payload[:40]!r}")
                page.send_raw(payload)
                self.tried += 1
                if not page.open:
                    break
            if self.rng.random() < 0.5:
                time.sleep(0.01)
        if page.close_code not in CODES:
            self._violated(f"a connection ended with {page.close_code} after {said[-1]}")

    def _bare_page(self) -> None:
        """As above, without reading what comes back; that is quicker."""
        with knock(self.app.door.own_address, websocket=True) as line:
            if line.status != 101:
                return
            if self.rng.random() < 0.2:
                line.socket.sendall(frame(pack(CAMERA)))
            for _ in range(self.rng.randint(1, BATCH)):
                _, payload = self.rude.frame()
                self.tried += 1
                text = isinstance(payload, str)
                whole = frame(payload.encode("utf-8", "replace") if text else payload, 1 if text else 2)
                try:
                    line.socket.sendall(whole)
                except OSError:
                    return

    def _noise(self) -> None:
        """Below the messages: bytes that are no frames, and frames that the protocol forbids."""
        with knock(self.app.door.own_address, websocket=True) as line:
            if line.status != 101:
                return
            for _ in range(self.rng.randint(1, 4)):
                kind, payload = self.rude.frame()
                raw = payload.encode("utf-8", "replace") if isinstance(payload, str) else payload
                whole = self.rng.choice((raw, frame(raw[:500], opcode=self.rng.randrange(16))))
                self.tried += 1
                try:
                    line.socket.sendall(whole)
                except OSError:
                    return

    def _drive(self) -> None:
        """The honest page drives, so that nobody else may."""
        self.honest.click("Select")
        self.honest.wait(lambda: self.app.commands.lease.driver is not None, "the honest page to drive")

    def _stop(self) -> None:
        before, started = self.stops, time.perf_counter()
        self.honest.send_value(self.stop_uuid, True)
        while self.stops == before:
            if time.perf_counter() - started > STOP_WITHIN_S:
                self._violated(f"the honest page could not stop (open: {self.honest.open})")
                return
            time.sleep(0.0005)
        self.took_ms.append(1e3 * (time.perf_counter() - started))

    def _violated(self, what: str) -> None:
        self.violations.append(f"seed {self.seed}, after {self.tried} frames: {what}")


def run(seconds: float, seed: int) -> Report:
    """Attack for so long. Figures: how long Stop took under it, and how much memory is gone."""
    with _ears() as heard:
        siege = Siege(seed)
        try:
            first = _memory_mb()
            warm, end = time.monotonic() + 0.3 * seconds, time.monotonic() + seconds
            while time.monotonic() < end and len(siege.violations) < 10:
                siege.batch()
                if time.monotonic() < warm:
                    first = _memory_mb()
            growth = _memory_mb() - first
        finally:
            siege.close()
        siege.violations += [f"seed {seed}: a traceback: {text}" for text in heard()]
    if growth > GROWTH_MB:
        siege.violations.append(f"seed {seed}: {growth:.0f} MB of memory in {0.7 * seconds:.0f} s")
    took = sorted(siege.took_ms) or [0.0]
    figures = {
        "stop p50 [ms]": took[len(took) // 2], "stop p99 [ms]": took[int(0.99 * (len(took) - 1))],
        "memory growth [MB]": growth, "pages": float(len(siege.took_ms)),
    }  # fmt: skip
    return Report("frames", siege.tried, "frames", tuple(siege.violations[:20]), figures)


@contextmanager
def _ears() -> Iterator[Any]:
    """What is logged with a traceback, and what is printed to stderr as one; nothing of it is shown."""
    told, real = io.StringIO(), sys.stderr
    records: list[logging.LogRecord] = []
    handler = logging.Handler()
    handler.emit = records.append  # type: ignore[method-assign]
    root = logging.getLogger()
    root.addHandler(handler)
    sys.stderr = told

    def heard() -> Sequence[str]:
        logged = [f"{r.getMessage()} {r.exc_info[1]!r}" for r in records if r.exc_info]
        logged += [r.getMessage() for r in records if "handler failed" in r.getMessage()]
        printed = told.getvalue().split("Traceback (most recent call last)")[1:]
        return [*logged[:3], *(text[-300:] for text in printed[:3])]

    try:
        yield heard
    finally:
        sys.stderr = real
        root.removeHandler(handler)


def _difference(was: object, now: object) -> str:
    if isinstance(was, dict) and isinstance(now, dict):
        changed = [key for key in was.keys() | now.keys() if was.get(key) != now.get(key)]
        return ", ".join(f"{key}: {was.get(key)!r} -> {now.get(key)!r}" for key in changed[:3])
    return f"{str(was)[:80]} -> {str(now)[:80]}"


def _memory_mb() -> float:
    """Resident memory of this process; 0 where the system does not say."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * 4096 / 2**20
    except OSError:
        return 0.0
