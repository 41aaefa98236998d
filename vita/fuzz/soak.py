"""Days of use in minutes: people come and go, start and stop, and every fault of the page happens.

The real app runs in a process of its own; this one plays its users and watches what it costs. In the end it
must still be able to do what it could in the beginning, with no more threads and handles than then.
"""

from __future__ import annotations

import contextlib
import csv
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path

from vita.errors import VitaError
from vita.fuzz.base import Report
from vita.fuzz.person import Person
from vita.fuzz.vitals import Vitals, check_proc, children, command, vitals

EXAMPLE = "point_to_point"
SAMPLE_S = 5.0
MOST_GROWTH_MB = 20.0
SETTLE_S = 300.0
"""Memory is compared from here on, or from a third of a shorter soak on [s]."""
PAGE_FAULTS, BLOCKING, BLOCKING_S = 4, "U7", 2.0
"""The page's group of faults, its row of callbacks that block, and how long to wait for them [s]."""
SHORT_S = 60.0
"""A shorter soak does not begin with the example, only ends with it [s]."""
MOST_VIEWERS = 5
OPEN_S, DONE_S, QUIET_S, END_S, RESTART_S = 120.0, 180.0, 8.0, 10.0, 30.0
_TRACEBACK = re.compile(r"^Traceback \(most recent call last\):\n(?:[ \t].*\n)+(.*)", re.MULTILINE)


@dataclass(frozen=True)
class Sample:
    """The app at one moment."""

    at_s: float
    state: str
    pages: int
    app_mb: float
    rig_mb: float
    threads: int
    handles: int
    children: int
    loop_hz: float
    cpu_s: float


@dataclass
class App:
    """The app in a process of its own, with a folder of its own."""

    folder: Path
    process: subprocess.Popen[str] = field(init=False)
    address: tuple[str, int] = field(init=False)

    def __post_init__(self) -> None:
        self.log = self.folder / "log.txt"
        surroundings = os.environ | {"VITA_DATA": str(self.folder / "data"), "PYTHONUNBUFFERED": "1"}
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "vita", "serve", EXAMPLE, "--port", "0"],
                stdout=subprocess.PIPE, stderr=log, text=True, env=surroundings,
            )  # fmt: skip
        assert self.process.stdout is not None
        said = self.process.stdout.readline()
        match = re.search(r"http://([\d.]+):(\d+)", said)
        if match is None:
            self.close()
            raise RuntimeError(f"the app did not start: {said}{self.log.read_text()[-2000:]}")
        self.address = match[1], int(match[2])

    @property
    def rig(self) -> int | None:
        """The process of the simulation: the heaviest child."""
        return max(children(self.process.pid), key=lambda pid: vitals(pid).memory_mb, default=None)

    def close(self) -> str:
        """End it as people do, and say what was not as it should be."""
        family = children(self.process.pid)
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            code = self.process.wait(timeout=END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            return f"it did not end within {END_S:.0f} s of SIGTERM"
        left, patience = _ours(family), time.monotonic() + 2.0
        while left and time.monotonic() < patience:
            time.sleep(0.05)
            left = _ours(family)
        for pid in left:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        wrong = f"exit code {code}" if code else ""
        return ", ".join(filter(None, (wrong, f"{len(left)} processes were left" if left else "")))

    def tracebacks(self) -> list[str]:
        """The last lines of what was raised and nobody dealt with. Injected errors carry their name."""
        last = _TRACEBACK.findall(self.log.read_text(errors="replace"))
        return [line for line in last if "injected" not in line]


def _ours(family: Sequence[int]) -> list[int]:
    """Which of the app's processes still live; a number may have gone to somebody else's by now."""
    return [pid for pid in family if "vita" in command(pid) or "multiprocessing" in command(pid)]


class Soak:
    """One soak: the app, its users, and what was counted."""

    def __init__(self, app: App, seed: int) -> None:
        self.app, self.chance = app, random.Random(seed)
        self.driver = Person(app.address)
        self.viewers: list[Person] = []
        self.samples: list[Sample] = []
        self.done = Counter[str]()
        self.tried = Counter[str]()
        self.wrong: list[str] = []
        self.began = time.monotonic()
        self.rested: Vitals | None = None
        """The app alone for the first time."""

    # Using it.

    def use(self, seconds: float) -> None:
        """Do things at random for so long."""
        end, next_sample = time.monotonic() + seconds, 0.0
        while time.monotonic() < end:
            if time.monotonic() >= next_sample:
                self.sample()
                next_sample = time.monotonic() + min(SAMPLE_S, seconds / 12)
            if self.app.process.poll() is not None:
                self.wrong.append(f"the app ended by itself with {self.app.process.returncode}")
                return
            what = self.chance.choice(ACTIONS)
            try:
                what(self)
                self.done[what.__name__] += 1
                self._revive()
            except (VitaError, TimeoutError, OSError):
                self.done[f"{what.__name__} refused"] += 1
            time.sleep(self.chance.uniform(0.05, 0.6))

    def _revive(self) -> None:
        """Pages that were thrown out (a fault floods its connection) are opened again, or forgotten."""
        self.viewers = [viewer for viewer in self.viewers if viewer.page.open]
        if not self.driver.page.open:
            self.reload()

    def sample(self) -> None:
        app = vitals(self.app.process.pid)
        rig = self.app.rig
        around = Vitals() if rig is None else vitals(rig)
        self.samples.append(Sample(
            round(time.monotonic() - self.began, 1), self.driver.state, 1 + len(self.viewers),
            round(app.memory_mb, 1), round(around.memory_mb, 1), app.threads, app.handles,
            len(children(self.app.process.pid)), self.driver.loop_hz, round(app.cpu_s + around.cpu_s, 1),
        ))  # fmt: skip

    # What people do.

    def go(self) -> None:
        """Start, or what the button says in this state; a restart takes its time."""
        state = self.driver.state
        self.driver.start()
        if state == "estop":
            self.driver.wait(lambda: self.driver.asked, "the question whether it is safe", 10.0)
            self.driver.say_yes()
        if state in ("offline", "fault", "estop"):
            with contextlib.suppress(TimeoutError):  # by then, press it again
                self.driver.wait(lambda: self.driver.state != state, "another state", RESTART_S)

    def stop(self) -> None:
        """Anyone may, at any time."""
        self.chance.choice([self.driver, *self.viewers]).page.click("Stop")

    def emergency(self) -> None:
        self.chance.choice([self.driver, *self.viewers]).page.click("Emergency stop")

    def reset_scene(self) -> None:
        self.driver.reset_scene()

    def come(self) -> None:
        """Another page is opened."""
        if len(self.viewers) < MOST_VIEWERS:
            self.viewers.append(Person(self.app.address))
        else:
            self.leave()

    def leave(self) -> None:
        if self.viewers:
            self.viewers.pop(self.chance.randrange(len(self.viewers))).close()

    def reload(self) -> None:
        """The driver's page goes and comes back as the same browser."""
        self.driver.close()
        self.driver = Person(self.app.address, self.driver.storage)

    def fault(self) -> None:
        """One of the page's faults."""
        before = self.driver.faults
        self.driver.show_faults(self.chance.randrange(7))
        with contextlib.suppress(TimeoutError):  # the same group as before
            self.driver.wait(lambda: self.driver.faults != before, "the faults", 1.0)
        rows = sorted(self.driver.faults)
        if rows:
            row = self.chance.choice(rows)
            self.tried[row] += self.driver.try_fault(row)

    def mend(self) -> None:
        self.driver.page.click("Mend all")

    def wait(self) -> None:
        """Let the arm move for a while."""
        time.sleep(self.chance.uniform(0.5, 2.5))

    # How it is.

    def warm_up(self) -> None:
        """As many pages at once as there will ever be, and callbacks that block: the web server makes its
        threads (32 at most) when it first needs them, and keeps them."""
        with ThreadPoolExecutor(MOST_VIEWERS) as pool:
            self.viewers += pool.map(lambda _: Person(self.app.address), range(MOST_VIEWERS))
        while self.viewers:
            self.leave()
        self.driver.show_faults(PAGE_FAULTS)
        self.driver.wait(lambda: BLOCKING in self.driver.faults, f"the button of {BLOCKING}")
        self.driver.try_fault(BLOCKING)
        time.sleep(BLOCKING_S)
        self.driver.page.click("Mend all")

    def try_example(self, when: str) -> None:
        """Whether the app can do what it is for."""
        try:
            self.run_example()
        except (VitaError, TimeoutError, OSError) as failure:
            self.wrong.append(f"it cannot run the example {when}: {failure}")

    def run_example(self, timeout_s: float = DONE_S) -> None:
        """From wherever it is to the end of the example. Raises `TimeoutError` when it does not get there."""
        end = time.monotonic() + timeout_s
        self.driver.take_over()
        self.driver.page.click("Mend all")
        fresh = False
        while True:
            state = self.driver.state
            if state == "done" and fresh:
                return
            if time.monotonic() > end:
                raise TimeoutError(f"the example was not done in {timeout_s:.0f} s; the page says {state!r}: "
                                   f"{self.driver.page.told()[-600:]}")  # fmt: skip
            if state in ("learning", "servoing"):
                self.driver.page.wait(lambda: self.driver.state not in ("learning", "servoing"), "rest", 60.0)
            elif state in ("offline", "fault", "estop"):
                fresh = False
                self.go()
            elif not fresh:
                self.driver.reset_scene()
                fresh = True
            else:
                self.driver.start()
            time.sleep(1.0)

    def alone(self) -> Vitals:
        """The app with one page, at rest: the least that it needs within a while."""
        while self.viewers:
            self.leave()
        end, least = time.monotonic() + QUIET_S, vitals(self.app.process.pid)
        wanted = self.rested or Vitals()
        while time.monotonic() < end and (least.threads > wanted.threads or least.handles > wanted.handles):
            time.sleep(0.5)
            now = vitals(self.app.process.pid)
            least = Vitals(
                now.memory_mb, min(least.threads, now.threads), min(least.handles, now.handles), now.cpu_s
            )
        self.rested = self.rested or least
        return least


ACTIONS = (
    *[Soak.go] * 8, *[Soak.wait] * 6, *[Soak.stop] * 3, *[Soak.fault] * 4, *[Soak.mend] * 2,
    *[Soak.reset_scene] * 2, *[Soak.come] * 2, *[Soak.leave] * 2, Soak.reload, Soak.emergency,
)  # fmt: skip


def run(seconds: float, seed: int = 0, *, out: Path | None = None) -> Report:
    """Use the app for so long; samples and verdict go into the folder `out`. Raises `MissingDependency`
    where there is no `/proc` to read."""
    check_proc()
    with tempfile.TemporaryDirectory() as folder:
        app = App(Path(folder))
        try:
            report, samples = _soaked(app, seconds, seed)
        finally:
            app.close()
        if out is not None:
            _write(out, report, samples, app.log)
    return report


def _soaked(app: App, seconds: float, seed: int) -> tuple[Report, list[Sample]]:
    soak = Soak(app, seed)
    soak.driver.wait(lambda: soak.driver.state, "the page's state", OPEN_S)
    soak.warm_up()
    if seconds >= SHORT_S:
        soak.try_example("even at first")
    before = soak.alone()
    soak.began = time.monotonic()
    soak.use(seconds)
    after = before
    if app.process.poll() is None:
        soak.try_example("in the end")
        after = soak.alone()
    soak.driver.close()
    wrong = soak.wrong
    growth = grown(soak.samples, seconds)
    if growth > MOST_GROWTH_MB:
        wrong.append(f"memory grew by {growth:.1f} MB")
    if after.threads > before.threads:
        wrong.append(f"{before.threads} threads at first, {after.threads} in the end")
    if after.handles > before.handles:
        wrong.append(f"{before.handles} handles at first, {after.handles} in the end")
    if ended := app.close():
        wrong.append(ended)
    raised = app.tracebacks()
    wrong += [f"{count} times nobody dealt with: {line}" for line, count in Counter(raised).items()]
    hz = [sample.loop_hz for sample in soak.samples if sample.loop_hz > 0]
    figures = {
        "minutes": seconds / 60, "faults tried": float(soak.tried.total()), "kinds": float(len(soak.tried)),
        "growth [MB]": growth, "memory at first [MB]": before.memory_mb, "in the end [MB]": after.memory_mb,
        "threads at first": before.threads, "threads in the end": after.threads,
        "handles at first": before.handles, "handles in the end": after.handles,
        "median control rate [Hz]": sorted(hz)[len(hz) // 2] if hz else 0.0, "unhandled": float(len(raised)),
        **{name: float(count) for name, count in sorted(soak.done.items())},
    }  # fmt: skip
    return Report("soak", sum(soak.done.values()), "actions", tuple(wrong), figures), soak.samples


def grown(samples: list[Sample], seconds: float) -> float:
    """How much more memory the app holds at the end than when it had settled [MB]: medians over a tenth of
    the time each, because single moments depend on what was just being drawn."""
    settled, window = min(SETTLE_S, seconds / 3), max(seconds / 10, 1e-9)
    first = [s.app_mb for s in samples if settled <= s.at_s <= settled + window]
    last = [s.app_mb for s in samples if s.at_s >= seconds - window]
    if not first or not last:
        return 0.0
    return sorted(last)[len(last) // 2] - sorted(first)[len(first) // 2]


def _write(out: Path, report: Report, samples: list[Sample], log: Path) -> None:
    out.mkdir(parents=True, exist_ok=True)
    if samples:
        with (out / "soak.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, list(asdict(samples[0])))
            table.writeheader()
            table.writerows(asdict(sample) for sample in samples)
    verdict = "passed" if report.passed else "FAILED"
    lines = [f"# Soak: {verdict}", "", "| figure | value |", "|---|---|"]
    lines += [f"| {key} | {value:g} |" for key, value in report.figures.items()]
    lines += ["", *(f"- {violation}" for violation in report.violations), "", "States at the samples: "
              + ", ".join(f"{s or '?'} {n}" for s, n in Counter(s.state for s in samples).most_common())]
    (out / "soak.md").write_text("\n".join(lines) + "\n")
    (out / "log.txt").write_text(log.read_text(errors="replace"))
