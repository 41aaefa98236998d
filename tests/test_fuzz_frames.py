"""Hostile frames against a page that stands: a short run holds, and the fuzzer sees what breaks."""

from __future__ import annotations

import random
from typing import Any

import pytest

from vita.fuzz import frames
from vita.fuzz.client import Widget
from vita.fuzz.rude import Rude
from vita.ui import connection, wire


def test_nothing_changes_and_stop_works_under_hostile_frames() -> None:
    report = frames.run(4.0, seed=6)
    assert report.passed, report.violations
    assert report.tried > 50 and report.figures["pages"] > 3


def test_the_seed_fixes_what_is_said() -> None:
    widgets = [Widget("a", "GuiSliderMessage"), Widget("b", "GuiButtonMessage")]
    said = [[Rude(random.Random(3), widgets, ("b",)).frame() for _ in range(50)] for _ in range(2)]
    assert repr(said[0]) == repr(said[1])


def test_who_may_stop_is_not_told_to() -> None:
    """A click on Stop would rightly change the state."""
    widgets = [Widget("press", "GuiButtonMessage"), Widget("stop", "GuiButtonMessage")]
    rude = Rude(random.Random(0), widgets, ("stop",))
    clicks = [rude._click() for _ in range(200)]
    assert any(b"press" in click for click in clicks) and not any(b"stop" in click for click in clicks)


def test_values_that_pass_unchecked_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "accept", lambda handle, value: None)
    monkeypatch.setattr(connection.Connection, "_checked", lambda self, message: message)
    report = frames.run(8.0, seed=1)
    assert not report.passed
    assert any("changed" in violation or "traceback" in violation for violation in report.violations)


def test_a_reader_that_fails_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    def careless(raw: Any) -> Any:
        return wire._decoder.decode(raw)

    monkeypatch.setattr(wire, "read", careless)
    report = frames.run(4.0, seed=2)
    assert any("handler failed" in violation for violation in report.violations)
