"""Gauges, choices and the ghost of the next step in a real browser."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from browser import Visit, chromium, wait_for
from fake_runner import FakeRunner
from known import an_insight

from vita import commands as c
from vita.servo.estimators import ESTIMATORS
from vita.servo.insight import Finding
from vita.ui import App
from vita.ui.ghost import GHOST
from vita.ui.panels import ServoPanel

pytestmark = pytest.mark.browser
GREY = np.full((480, 640, 3), 150, np.uint8)
HERE, THERE = (150.0, 150.0), (420.0, 330.0)


@pytest.fixture(scope="module")
def visit() -> Iterator[Visit]:
    with chromium() as browser:
        runner = FakeRunner(pictures={"left": GREY, "right": GREY})
        app = App(runner, port=0)
        try:
            visit = Visit(app, runner, browser.new_page())
            visit.open()
            yield visit
        finally:
            app.close()
            runner.close()


def ghost_places(visit: Visit) -> np.ndarray:
    """(k, 2) window positions of everything that is drawn in the ghost's colour."""
    off = np.abs(visit.picture().astype(int) - GHOST).max(axis=2)
    return np.argwhere(off < 40)[:, ::-1]


def test_the_ghost_is_seen_where_the_feature_will_be_until_it_is_switched_off(visit: Visit) -> None:
    runner, page = visit.runner, visit.page
    runner.submit(c.AddTracker("left", HERE, "auto", "T1"))
    wait_for(lambda: "T1" in runner.snapshot().features, "the tracker")
    assert not len(ghost_places(visit))
    runner.ghost = {"T1": np.array([THERE])}
    wait_for(lambda: len(ghost_places(visit)) > 20, "the ghost")
    places = ghost_places(visit)
    here, there = np.array(visit.place("left", HERE)), np.array(visit.place("left", THERE))
    # The ring's far side is 7 pixels beyond, and the arrow begins under the marker.
    assert np.abs(places.max(axis=0) - (there + 7)).max() < 3.0
    assert (places.min(axis=0) > here - 3).all()

    page.get_by_role("tab", name="View").click()
    page.get_by_text("Next step", exact=True).click()
    wait_for(lambda: not visit.board.foresee, "the switch")
    wait_for(lambda: not len(ghost_places(visit)), "no ghost")
    page.get_by_text("Next step", exact=True).click()
    wait_for(lambda: len(ghost_places(visit)) > 20, "the ghost again")
    runner.ghost = {}
    wait_for(lambda: not len(ghost_places(visit)), "no ghost without a prediction")


def test_an_estimator_chosen_from_the_list_is_asked_for_and_described(visit: Visit) -> None:
    runner, page = visit.runner, visit.page
    page.get_by_role("tab", name="Servo").click()
    rls, kalman = ESTIMATORS["rls"], ESTIMATORS["kalman"]
    panel = next(p for p in visit.app.panels if isinstance(p, ServoPanel))
    field = page.locator(f'[id="{panel._choices["estimator"].handle._impl.uuid}"]')
    wait_for(lambda: field.count() and field.input_value() == kalman.title, "the usual estimator")
    field.click()
    page.get_by_role("option", name=rls.title, exact=True).click()
    wait_for(lambda: c.SetServo("estimator", "rls") in runner.log, "the command")
    wait_for(lambda: page.get_by_text(rls.doc).is_visible(), "what it does")
    wait_for(lambda: page.get_by_text("Forgetting", exact=True).is_visible(), "its own setting")
    assert not page.get_by_text("Learning rate alpha", exact=True).is_visible()
    runner.submit(c.SetServo("estimator", "kalman"))
    wait_for(lambda: field.input_value() == kalman.title, "the echo of a script's choice")


def test_gauges_and_findings_are_read_without_scrolling(visit: Visit) -> None:
    runner, page = visit.runner, visit.page
    page.get_by_role("tab", name="Knowledge").click()
    wait_for(lambda: page.get_by_text("makes a few small moves").is_visible(), "what will be here")
    runner.insight = an_insight(condition=50.0)
    runner.findings = (Finding("bad", "conflict", "c1 and c2 <b>pull</b> apart."),)
    last = page.locator("#vita-knowledge .gauge .word").last
    wait_for(lambda: last.is_visible() and last.inner_text() == "as predicted", "the gauges")
    assert page.locator("#vita-knowledge .gauge").count() == 5
    finding = page.locator("#vita-knowledge .finding")
    assert "<b>pull</b>" in finding.inner_text()
    box = finding.bounding_box()
    assert box is not None and box["y"] + box["height"] <= 720
