"""What the page says of the servo's self-knowledge, without a browser: gauges and findings."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from fake_runner import two_cameras
from hypothesis import given, settings
from hypothesis import strategies as st
from known import an_insight, task

from vita.servo.insight import Finding, words
from vita.snapshot import Snapshot
from vita.types import Joint, Status, frozen
from vita.ui.findings import ESTIMATE, ORDER, sentences, verdict, without_praise, worst_first
from vita.ui.gauges import Gauge, bars, gauges
from vita.ui.panels import lists
from vita.ui.panels.knowledge import knowledge
from vita.ui.panels.run import warned

EVIL = "\"><img src=x onerror=alert(1)> & 'quotes'"


def gauge(name: str, **changes: object) -> Gauge:
    return next(g for g in gauges(an_insight(**changes)) if g.name == name)


@pytest.mark.parametrize(
    ("name", "changes", "value", "level", "word"),
    [
        ("Held motions", {}, "4 of 7", "info", "3 free"),
        ("Held motions", {"held": 6}, "6 of 7", "good", "whole pose"),
        ("Held motions", {"held": 4, "joints": 4}, "4 of 4", "good", "all"),
        ("Held motions", {"held": 0}, "0 of 7", "bad", "nothing"),
        ("Condition", {}, "7", "good", "good"),
        ("Condition", {"condition": 50.0}, "50", "warning", "fair"),
        ("Condition", {"condition": 12345.6}, "12346", "bad", "poor"),
        ("Condition", {"condition": float("inf")}, "–", "bad", "singular"),
        ("Weakest", {}, "100 px/rad", "good", "clear"),
        ("Weakest", {"weakest": 30.0}, "30 px/rad", "warning", "faint"),
        ("Weakest", {"weakest": 2.34567}, "2.35 px/rad", "bad", "hardly seen"),
        ("Uncertainty", {}, "±2.0 %", "good", "sure"),
        ("Uncertainty", {"uncertainty": 0.2}, "±20 %", "warning", "rough"),
        ("Uncertainty", {"uncertainty": 3.0}, "±300 %", "bad", "a guess"),
        ("Prediction", {}, "95 %", "good", "as predicted"),
        ("Prediction", {"observed": frozen([20.0, 0.0])}, "50 %", "warning", "partly"),
        ("Prediction", {"observed": frozen([-10.0, 0.0])}, "0 %", "bad", "off"),
        ("Prediction", {"observed": frozen([np.nan, np.nan])}, "–", "info", "no motion yet"),
        ("Prediction", {"observed": frozen([-10.0, 0.0]), "near": True}, "0 %", "info", "only noise"),
    ],
)
def test_each_gauge_has_the_right_word(
    name: str, changes: dict[str, object], value: str, level: str, word: str
) -> None:
    shown = gauge(name, **changes)
    assert (shown.value, shown.level, shown.word) == (value, level, word)


POSITIVE = st.floats(0.0, 1e9) | st.just(float("inf")) | st.just(float("nan"))


@settings(deadline=None)
@given(st.integers(0, 6), POSITIVE, POSITIVE, POSITIVE, st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")),
                                                                 min_size=2, max_size=2), st.booleans())
def test_gauges_can_be_drawn_for_whatever_the_servo_reports(
    held: int, condition: float, weakest: float, uncertainty: float, observed: list[float], near: bool
) -> None:
    """Every bar is between empty and full, every gauge has a word, and the HTML is well-formed."""
    shown = gauges(an_insight(held=held, condition=condition, weakest=weakest, uncertainty=uncertainty,
                              observed=frozen(observed), near=near))
    for one in shown:
        assert 0.0 <= one.share <= 1.0 and one.word and one.value and "nan" not in one.value
        assert len(one.word) <= 13 and len(one.value) <= 13
    assert_balanced(bars(shown))


@settings(deadline=None)
@given(st.floats(1.0, 5000.0), st.floats(1.0, 5000.0), st.floats(0.0, 2.0), st.floats(0.0, 2.0))
def test_a_longer_bar_is_always_the_better_figure(a: float, b: float, p: float, q: float) -> None:
    low, high = sorted((a, b))
    assert gauge("Condition", condition=low).share >= gauge("Condition", condition=high).share
    assert gauge("Weakest", weakest=low).share <= gauge("Weakest", weakest=high).share
    low, high = sorted((p, q))
    assert gauge("Uncertainty", uncertainty=low).share >= gauge("Uncertainty", uncertainty=high).share


@settings(deadline=None)
@given(st.integers(0, 4), st.floats(1.0, 2000.0), st.floats(0.0, 2.0), st.floats(-30.0, 30.0))
def test_gauges_and_sentences_never_disagree(
    held: int, condition: float, uncertainty: float, observed: float
) -> None:
    """A sentence that warns has a gauge that is not green, and praise has one that is."""
    now = an_insight(
        held=held, joints=4, condition=condition, uncertainty=uncertainty, observed=frozen([observed, 0.0]),
        weak_constraint="c1", weak_direction=frozen([1.0, 0, 0, 0]),
    )
    joints = tuple(Joint(f"j{i}", -1.0, 1.0, 1.0) for i in range(4))
    said = {f.code: f.level for f in words(now, joints, range(4))}
    assert set(said) <= ESTIMATE  # the page tells them from the task's by this
    bar = {g.name: g.level for g in gauges(now)}
    pairs = {
        "condition": "Condition", "known": "Uncertainty", "agreement": "Prediction", "held": "Held motions",
    }
    for code, level in said.items():
        if code in pairs:
            assert (level == "good") == (bar[pairs[code]] == "good"), (code, level, bar)
        if level in ("warning", "bad") and code in pairs:
            assert bar[pairs[code]] in ("warning", "bad")


# Findings.


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open.append(tag)
        self.seen.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


def assert_balanced(markup: str) -> _Tags:
    parser = _Tags()
    parser.feed(markup)
    parser.close()
    assert parser.open == []
    return parser


LEVELS = st.sampled_from(ORDER)
FINDINGS = st.lists(
    st.builds(Finding, LEVELS, st.sampled_from(["free_motion", "conflict", "known"]), st.text(max_size=30)),
    max_size=6,
)


@settings(deadline=None)
@given(FINDINGS, st.integers(1, 3))
def test_findings_stand_worst_first_and_none_is_kept_back(findings: list[Finding], limit: int) -> None:
    order = [ORDER.index(f.level) for f in worst_first(findings)]
    assert order == sorted(order) and len(order) == len(findings)
    markup = sentences(findings, limit)
    assert markup.count('class="finding') == min(len(findings), limit) + (len(findings) > limit)
    if len(findings) > limit:
        assert f"and {len(findings) - limit} more" in markup


def test_whatever_is_found_is_shown_as_text_and_never_run() -> None:
    """In the sentence, in the rest behind the count, in the gauges and in the list of constraints."""
    evil = tuple(Finding("warning", f"code{i}", EVIL) for i in range(4))
    now = an_insight(weak_joint=EVIL, weak_constraint=EVIL)
    snapshot = replace(task(), insight=now, findings=evil)
    shown = (knowledge(snapshot), lists.constraints(snapshot, None, lambda i, name: ("a", "b")))
    for markup in shown:
        parser = assert_balanced(markup)
        assert "img" not in parser.seen and EVIL in parser.text
    assert "img" not in assert_balanced(bars(gauges(now))).seen


def test_the_task_panel_names_the_culprits_and_says_when_there_are_none() -> None:
    def said(*findings: Finding, snapshot: Snapshot | None = None) -> str:
        shown = replace(snapshot or task(), findings=findings)
        return re.sub(r"<[^>]*>", " ", lists.constraints(shown, None, lambda i, name: ("a", "b")))

    assert "no problem found" in said()
    conflict = Finding("bad", "conflict", "c1 and c2 pull T1 to two places.")
    redundant = Finding("warning", "redundant", "c2 adds nothing to c1.")
    both = said(redundant, conflict)
    assert "2 problems found" in both and both.index("c1 and c2 pull") < both.index("c2 adds nothing")
    free = said(Finding("info", "free_motion", "2 motions stay free."))
    assert "no problem found" in free and "2 motions stay free" in free
    running = said(Finding("warning", "known", "The Jacobian is a guess."))
    assert "guess" not in running and "no problem" in running
    empty = said(snapshot=Snapshot(0, 0.0, Status(), frozen(()), (), {}, {}, two_cameras()))
    assert "before anything moves" in empty and "problem" not in empty
    assert verdict((), 0) == ("", "info")


def test_praise_is_left_to_the_gauges_unless_there_is_nothing_else_to_say() -> None:
    good = [Finding("good", "known", "known well"), Finding("good", "condition", "seen clearly")]
    free = Finding("info", "held", "3 of 7")
    assert without_praise([*good, free]) == [free]
    assert without_praise(good) == good[:1]
    shown = knowledge(replace(task(), insight=an_insight(), findings=(*good, free)))
    assert "3 of 7" in shown and "seen clearly" not in shown and "finding more" not in shown


def test_a_task_with_a_problem_is_not_called_complete() -> None:
    conflict = replace(task(), findings=(Finding("bad", "conflict", "..."),))
    assert warned(conflict).startswith("1 problem found")
    assert warned(replace(task(), findings=(Finding("info", "free_motion", "..."),))) == ""
    assert warned(task()) == ""
    nothing = Snapshot(0, 0.0, Status(), frozen(()), (), {}, {}, two_cameras())
    assert warned(nothing) == ""


def test_before_anything_is_known_the_page_says_how_it_will_be() -> None:
    assert "After <b>Start</b>" in knowledge(task())
    assert "vita-knowledge" in knowledge(replace(task(), insight=an_insight()))
