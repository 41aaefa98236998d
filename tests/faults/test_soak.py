"""The soak in small: the app is used for a few seconds, and is none the worse for it."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bench import row

from vita.fuzz import soak
from vita.fuzz.soak import Sample, grown
from vita.fuzz.vitals import Vitals, children, vitals


@row("Q1")
def test_a_short_soak_leaves_the_app_as_it_was(tmp_path: Path) -> None:
    report = soak.run(6.0, seed=3, out=tmp_path)
    assert report.passed, "\n".join(report.violations)
    assert report.tried >= 3 and report.figures["faults tried"] >= 1
    rows = list(csv.DictReader((tmp_path / "soak.csv").open()))
    assert len(rows) >= 3 and all(float(row["app_mb"]) > 20 and int(row["threads"]) >= 3 for row in rows)
    assert (tmp_path / "soak.md").read_text().startswith("# Soak: passed\n")


def samples(*memory_mb: float) -> list[Sample]:
    """Ten seconds apart."""
    return [Sample(10.0 * i, "idle", 1, mb, 0.0, 8, 15, 2, 30.0, 0.0) for i, mb in enumerate(memory_mb)]


def test_growth_counts_from_when_the_app_has_settled() -> None:
    assert grown(samples(100, 130, 150, *[160] * 7), 100.0) == 0
    assert grown(samples(100, 130, 150, 160, 160, 165, 170, 175, 180, 190), 100.0) == 30
    assert grown(samples(*[160.0] * 9, 130.0), 100.0) == -30


def test_what_nobody_dealt_with_is_found_in_the_log_and_what_was_injected_is_not(tmp_path: Path) -> None:
    (tmp_path / "log.txt").write_text(
        'a line\nTraceback (most recent call last):\n  File "x.py", line 1, in f\n    g()\nValueError: oops\n'
        "another\nTraceback (most recent call last):\n"
        '  File "x.py", line 1, in f\n    ~^^~\nRuntimeError: injected: the tracker fails\nend\n'
    )
    app = object.__new__(soak.App)
    app.log = tmp_path / "log.txt"
    assert app.tracebacks() == ["ValueError: oops"]


def test_the_vitals_are_those_of_the_process() -> None:
    hungry = "import threading, time; a = bytearray(60_000_000); f = [open('/dev/null') for _ in range(40)]; "
    hungry += "threading.Thread(target=time.sleep, args=(30,)).start(); print(flush=True); time.sleep(30)"
    child = subprocess.Popen([sys.executable, "-c", hungry], stdout=subprocess.PIPE)
    try:
        assert child.stdout is not None
        child.stdout.readline()
        seen = vitals(child.pid)
        assert 57 < seen.memory_mb < 90 and seen.threads == 2 and 43 <= seen.handles <= 46
        assert child.pid in children(os.getpid())
    finally:
        child.kill()
        child.wait()
    assert vitals(child.pid) == Vitals() and child.pid not in children(os.getpid())


def test_a_leak_is_noticed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The same verdict on an app that is played: it holds one handle more at the end, and raised."""

    class Played:
        log = tmp_path / "log.txt"
        process = type("P", (), {"poll": lambda self: None})()

        def close(self) -> str:
            return "1 processes were left"

        def tracebacks(self) -> list[str]:
            return ["KeyError: 'x'", "KeyError: 'x'"]

    class PlayedSoak(soak.Soak):
        def __init__(self, app: object, seed: int) -> None:
            self.driver = self
            self.samples, self.wrong = samples(100, 100, 100, 100, 100, 100, 100, 100, 100, 125), []
            self.done, self.tried, self.calm = soak.Counter({"go": 3}), soak.Counter(), 0
            self.state = "idle"

        def wait(self, *_: object) -> None: ...
        def warm_up(self) -> None: ...
        def close(self) -> None: ...
        def use(self, seconds: float) -> None: ...
        def run_example(self, timeout_s: float = 0.0) -> None:
            raise TimeoutError("it stands still")

        def alone(self) -> Vitals:
            self.calm += 1
            return Vitals(100.0, 8, 14 + self.calm)

    monkeypatch.setattr(soak, "Soak", PlayedSoak)
    report, _ = soak._soaked(Played(), 100.0, 0)  # type: ignore[arg-type]
    assert report.violations == (
        "it cannot run the example even at first: it stands still",
        "it cannot run the example in the end: it stands still",
        "memory grew by 25.0 MB", "15 handles at first, 16 in the end", "1 processes were left",
        "2 times nobody dealt with: KeyError: 'x'",
    )  # fmt: skip
    assert not report.passed


def test_the_clock_of_a_soak_is_the_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    """A soak of so many seconds ends after so many, whatever the app does."""

    class Idle(soak.Soak):
        def __init__(self) -> None:
            self.app = type("A", (), {"process": type("P", (), {"poll": lambda self: None})()})()
            self.chance, self.done, self.wrong, self.viewers = soak.random.Random(1), soak.Counter(), [], []

        def sample(self) -> None: ...
        def _revive(self) -> None: ...

    monkeypatch.setattr(soak, "ACTIONS", (soak.Soak.leave,))
    idle, started = Idle(), time.monotonic()
    idle.use(1.0)
    assert 1.0 <= time.monotonic() - started < 2.5 and idle.done["leave"] >= 1
