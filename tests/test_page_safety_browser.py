"""Who drives and how to stop, in a real browser: two pages of two people before one arm."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import chromium, wait_for
from fake_runner import FakeRunner

from vita import commands as c
from vita.servo import status_for
from vita.ui import App
from vita.ui.panels import run

pytestmark = pytest.mark.browser
DRIVES, BOUND_S = "Page 1 drives", 0.2
TAKE = "#vita-who .take"


class Two:
    """An app with Ann's page, and with Ben's where a test opens it. Each browser has a storage of its own."""

    def __init__(self, browser: Any) -> None:
        self.browser = browser
        self.runner = FakeRunner()
        self.runner.slowness_s = 1e3  # so that no run ends by itself
        self.app = App(self.runner, port=0)
        self.runner.submit(c.AddTracker("left", (200.0, 200.0), "auto", "T1"))
        self.runner.submit(c.AddTracker("left", (400.0, 300.0), "fixed", "G1"))
        self.runner.submit(c.AddConstraint("point_to_point", ("T1", "G1")))
        self.ann = self.open()

    def open(self, width: int = 640, height: int = 560) -> Any:
        """A page; small where only the panels matter, since every picture costs time to draw."""
        page = self.browser.browser.new_context(viewport={"width": width, "height": height}).new_page()
        self.load(page)
        return page

    def load(self, page: Any) -> None:
        known = set(self.app.boards)
        page.goto(f"{self.app.url}/?fixedDpr=1")
        page.wait_for_selector("#vita-run", timeout=60000)
        wait_for(lambda: set(self.app.boards) - known, "the page")

    def start(self, page: Any) -> None:
        page.get_by_role("button", name="Start").click()
        wait_for(lambda: self.runner.snapshot().status.state == "servoing", "the arm to move")

    def at_rest(self) -> None:
        """Both pages closed, nobody drives, nothing moves."""
        self.runner._status = status_for("")

    def close(self) -> None:
        self.app.close()
        self.runner.close()


@pytest.fixture(scope="module")
def two() -> Iterator[Two]:
    with chromium() as browser:
        two = Two(browser)
        try:
            yield two
        finally:
            two.close()


def shown(page: Any, selector: str, text: str) -> None:
    """Wait until an element says something."""
    found = page.locator(selector)
    wait_for(lambda: found.count() and text in found.first.inner_text(), f"{text!r} in {selector}")


def told(page: Any, text: str) -> None:
    shown(page, f".mantine-Notification-root:has-text({text!r})", text)


def inside(page: Any, name: str) -> bool:
    """Whether a button is seen whole, and is what a click at its middle and corners would meet."""
    return page.get_by_role("button", name=name, exact=True).evaluate(
        """button => {
            const box = button.getBoundingClientRect();
            return [[.5, .5], [.05, .1], [.95, .1], [.05, .9], [.95, .9]].every(([x, y]) => {
                const met = document.elementFromPoint(box.left + x * box.width, box.top + y * box.height);
                return met && button.contains(met);
            });
        }"""
    )


def test_one_person_alone_drives_unasked_and_sees_nothing_of_it(two: Two) -> None:
    two.start(two.ann)
    assert two.app.commands.lease.driver is not None
    two.ann.wait_for_timeout(300)
    assert two.ann.locator("#vita-who").count() == 0
    two.ann.get_by_role("button", name="Stop", exact=True).click()
    wait_for(lambda: two.runner.snapshot().status.state == "hold", "the stop")


def test_who_watches_may_stop_and_nothing_else_and_takes_over_at_rest(two: Two) -> None:
    ben = two.open()
    two.start(two.ann)
    shown(ben, "#vita-who", DRIVES)
    shown(two.ann, "#vita-who", "You drive · 1 watching")
    before = list(two.runner.log)
    ben.keyboard.press("Control+z")
    told(ben, "Page 1 drives. Take over when the arm rests.")
    ben.locator(TAKE).click()
    told(ben, "Stop it, then take over")
    assert two.runner.log == before and two.runner.snapshot().status.state == "servoing"
    ben.get_by_role("button", name="Stop", exact=True).click()
    wait_for(lambda: two.runner.snapshot().status.state == "hold", "the watcher's stop")
    ben.locator(TAKE).click()
    shown(ben, "#vita-who", "You drive")
    shown(two.ann, "#vita-who", "Page 2 drives")
    two.ann.locator(TAKE).click()
    shown(two.ann, "#vita-who", "You drive")
    ben.context.close()
    wait_for(lambda: len(two.app.boards) == 1, "Ben to leave")


def test_a_setting_that_a_watcher_turns_goes_back(two: Two) -> None:
    ben = two.open()
    two.ann.keyboard.press("x")
    shown(ben, "#vita-who", DRIVES)
    ben.get_by_role("tab", name="View").click()
    box = ben.get_by_label("3D overview")
    box.click()
    told(ben, DRIVES)
    wait_for(box.is_checked, "the box to be set back")
    assert two.app.audience.display.pane
    ben.context.close()
    wait_for(lambda: len(two.app.boards) == 1, "Ben to leave")


def test_the_arm_is_held_at_once_when_the_driver_leaves_and_the_others_are_told(two: Two) -> None:
    ben = two.open()
    two.start(two.ann)
    known: list[float] = []

    async def gone(client: Any) -> None:
        known.append(time.monotonic())

    two.app.server._client_disconnect_cb.insert(0, gone)
    two.runner.reasons.clear()
    stop, at = two.runner.stop, []

    def stopped(reason: str = "stopped_by_user") -> None:
        at.append(time.monotonic())
        stop(reason)

    two.runner.stop = stopped  # type: ignore[method-assign]
    two.ann.close()
    wait_for(lambda: two.runner.reasons, "the stop")
    two.runner.stop = stop  # type: ignore[method-assign]
    two.app.server._client_disconnect_cb.remove(gone)
    assert two.runner.reasons == ["driver_left"] and at[0] - known[0] <= BOUND_S
    told(ben, "Page 1 drove and is gone")
    shown(ben, "#vita-who", "Page 1 drove and is away")
    ben.locator(TAKE).click()
    two.start(ben)
    two.ann = ben


def test_a_reload_holds_the_arm_and_keeps_the_driver(two: Two) -> None:
    if two.runner.snapshot().status.state != "servoing":
        two.start(two.ann)
    number = two.app.commands.lease.number(two.app.commands.lease.driver)
    two.runner.reasons.clear()
    two.ann.reload()
    two.ann.wait_for_selector("#vita-run", timeout=60000)
    told(two.ann, "Welcome back")
    assert two.runner.reasons == ["driver_left"] and two.runner.snapshot().status.state == "hold"
    assert two.app.commands.lease.number(two.app.commands.lease.driver) == number
    assert two.ann.locator("#vita-who").count() == 0


def test_an_emergency_stop_is_left_by_two_clicks(two: Two) -> None:
    page = two.ann
    page.set_viewport_size({"width": 1280, "height": 720})
    two.start(page)
    page.keyboard.press("Shift+Space")
    shown(page, "#vita-run", "Emergency stop")
    page.wait_for_timeout(600)  # A click right behind the key is taken for the same press.
    yes = page.get_by_role("button", name=run.YES)
    page.get_by_role("button", name="Reset", exact=True).first.click()
    yes.wait_for()
    for name in ("Stop", "Emergency stop", run.YES):
        assert inside(page, name), name
    assert two.runner.snapshot().status.state == "estop"
    yes.click()
    wait_for(lambda: two.runner.snapshot().status.state == "idle", "idle")
    assert sum(isinstance(command, c.Reset) for command in two.runner.log) == 1


def test_however_long_the_message_is_the_buttons_stand_where_they_stood(two: Two, tmp_path: Path) -> None:
    page, two.runner.evidence = two.ann, str(tmp_path / "000007-diverged.npz")
    page.set_viewport_size({"width": 1280, "height": 720})
    page.wait_for_timeout(300)
    places = page.get_by_role("button", name="Stop", exact=True).bounding_box()
    two.runner._status = status_for("controller_stopped", ms=123.0, culprit="it was " + "working " * 30)
    shown(page, "#vita-run", "Evidence: 000007-diverged.npz")
    assert page.get_by_role("button", name="Stop", exact=True).bounding_box() == places
    assert all(inside(page, name) for name in ("Restart", "Stop", "Emergency stop"))
    panel = page.locator("#vita-run").evaluate(
        "e => e.getBoundingClientRect().bottom"
        " <= e.closest('[data-dock-leaf]').getBoundingClientRect().bottom"
    )
    assert panel, "the end of the message is cut"
    two.runner.evidence = ""
    two.at_rest()


def test_a_fault_is_tried_and_mended_by_a_click(two: Two) -> None:
    page = two.ann
    two.at_rest()
    page.get_by_role("tab", name="Faults").click()
    page.locator("#vita-faults .item", has_text="V1").first.wait_for()
    row = page.locator("#vita-faults .item", has_text="A camera repeats its last picture")
    if not row.get_by_text("Try", exact=True).count():
        pytest.skip("this row has no button")
    row.get_by_text("Try", exact=True).click()
    wait_for(lambda: c.Inject("V5") in two.runner.log, "the fault")
    row.get_by_text("in force").wait_for()
    page.get_by_role("button", name="Mend all").click()
    wait_for(lambda: not two.runner.injected, "the mending")
