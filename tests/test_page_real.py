"""The whole path as a person walks it: the live simulation, the page, a real browser, real pixels."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from browser import Visit, chromium, wait_for

from vita import commands as c
from vita.runner import live_runner
from vita.scenario.library import welcome
from vita.types import MOVING_STATES
from vita.ui import App

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.timeout(240)]
CROSS = ("tool", (0.0, 0.0, 0.085))
BLANK = (600.0, 60.0)
"""A pixel of the left view that shows nothing but wall."""
BALL = ("post", (0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def visit() -> Iterator[Visit]:
    with chromium() as browser:
        runner = live_runner(welcome())
        app = App(runner, port=0)
        try:
            visit = Visit(app, runner, browser.new_page())
            visit.open()
            yield visit
        finally:
            app.close()
            runner.close()


@pytest.fixture(autouse=True)
def empty_task(visit: Visit) -> None:
    """Each test starts as a newcomer does: nothing drawn, the arm at the start."""
    visit.runner.stop()
    visit.app.composer.put_away()
    settled(visit)
    visit.runner.submit(c.LoadTask(welcome()))
    wait_for(lambda: not visit.runner.snapshot().scenario.tracker, "an empty task")
    settled(visit)


def state(visit: Visit) -> str:
    return visit.runner.snapshot().status.state


def settled(visit: Visit, ticks: int = 5) -> None:
    """Some further snapshots, none of them moving."""
    wait_for(lambda: state(visit) not in MOVING_STATES, "an arm at rest")
    tick = visit.runner.snapshot().tick
    wait_for(lambda: visit.runner.snapshot().tick >= tick + ticks, "further snapshots")


def seen_at(visit: Visit, camera: str, what: tuple[str, tuple[float, float, float]]) -> tuple[float, float]:
    """Where a person would look. The page and the engine never ask for this."""
    u, v = visit.runner._engine.rig.project(camera, *what)
    return float(u), float(v)


def compose(visit: Visit) -> dict[str, tuple[str, tuple[float, float]]]:
    """Two point-to-point constraints by clicking; returns tracker name to (camera, clicked pixel)."""
    clicked: dict[str, tuple[str, tuple[float, float]]] = {}
    visit.press("Point → Point")
    wait_for(lambda: visit.app.composer.tool == "point_to_point", "the tool in hand")
    for number, camera in enumerate(("left", "right"), start=1):
        for name, what in ((f"T{number}", CROSS), (f"G{number}", BALL)):
            uv = seen_at(visit, camera, what)
            clicked[name] = (camera, uv)
            visit.click(camera, uv)
            wait_for(lambda: name in visit.runner.snapshot().features, f"the tracker {name}")  # noqa: B023
        wait_for(lambda: len(visit.runner.snapshot().scenario.constraint) == number, "the constraint")  # noqa: B023
    visit.page.keyboard.press("Escape")
    wait_for(lambda: visit.app.composer.tool == "select", "the tool put away")
    return clicked


def start(visit: Visit) -> np.ndarray:
    """Press Start; returns the joints (n,) from which the arm left [rad]."""
    q = visit.runner.snapshot().q
    wait_for(lambda: visit.page.get_by_role("button", name="Start", exact=True).is_enabled(), "Start")
    visit.press("Start")
    wait_for(lambda: state(visit) in MOVING_STATES, "the start")
    return q


def converges(visit: Visit) -> np.ndarray:
    """Start and wait for the end; returns the joints (n,) from which the arm left [rad].

    Once, the test does what the page asks for when a busy machine kept the pictures back, or left so much
    time between two of them that a tracker was lost.
    """
    left_from = start(visit)
    wait_for(lambda: state(visit) not in MOVING_STATES, "the end of the motion", 60.0)
    if visit.runner.snapshot().status.reason in ("images_late", "tracker_lost"):
        reset(visit)
        left_from = start(visit)
        wait_for(lambda: state(visit) not in MOVING_STATES, "the end of the motion", 60.0)
    snapshot = visit.runner.snapshot()
    assert snapshot.status.state == "done", snapshot.status
    assert snapshot.error.largest < 0.5
    return left_from


def reset(visit: Visit) -> None:
    visit.press("Reset")
    wait_for(lambda: state(visit) == "idle", "the arm back at the start")


def rest_after(visit: Visit, act: Callable[[], None]) -> float:
    """Do `act`; returns after how many seconds the arm stood still, and stayed so for 10 snapshots."""
    seen: list[tuple[float, np.ndarray]] = []
    enough = threading.Event()

    def watch() -> None:  # besides the click, which takes a while to return
        tick = -1
        while not enough.is_set():
            newer = visit.runner.wait_newer(tick, 0.5)
            if newer is not None:
                tick = newer.tick
                seen.append((time.monotonic(), newer.q))

    def moved_at(since: float) -> float:
        """When joints were seen to differ from the picture before, for the last time."""
        pairs = zip(list(seen), list(seen)[1:], strict=False)
        return max((t for (_, p), (t, q) in pairs if np.abs(q - p).max() > 1e-5), default=since)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        wait_for(lambda: len(seen) > 1 and moved_at(0.0) > 0.0, "an arm that moves")
        began = time.monotonic()
        act()
        wait_for(lambda: sum(t > max(moved_at(began), began) for t, _ in list(seen)) >= 10, "an arm at rest")
    finally:
        enough.set()
        watcher.join()
    return max(moved_at(began) - began, 0.0)


def test_a_task_clicked_together_converges_stops_and_survives_a_reload(
    visit: Visit, record_property: Callable[[str, object], None]
) -> None:
    clicked = compose(visit)
    scenario = visit.runner.snapshot().scenario
    for spec in scenario.tracker:
        camera, uv = clicked[spec.name]
        assert spec.camera == camera and spec.at is not None
        assert np.abs(np.array(spec.at) - uv).max() < 2.0  # half a CSS pixel is 0.75 px here
    assert [k.points for k in scenario.constraint] == [("T1", "G1"), ("T2", "G2")]

    home = converges(visit)
    assert np.abs(visit.runner.snapshot().q - home).max() > 0.05
    reset(visit)
    wait_for(lambda: np.abs(visit.runner.snapshot().q - home).max() < 1e-3, "the arm back at the start")
    assert len(visit.runner.snapshot().scenario.constraint) == 2

    # So slow that even a busy browser presses Stop on the way.
    visit.runner.submit(c.SetServo("policy", "fixed"))
    visit.runner.submit(c.SetServo("gain", 0.02))
    start(visit)
    wait_for(lambda: state(visit) == "servoing", "the arm on its way", 60.0)
    seconds = rest_after(visit, lambda: visit.press("Stop"))
    record_property("stop_click_to_rest_s", round(seconds, 3))
    print(f"Stop click to arm at rest: {seconds:.3f} s")
    visit.runner.submit(c.SetServo("gain", 0.3))
    visit.runner.submit(c.SetServo("policy", "uncertainty"))
    assert seconds < 2.0
    assert (state(visit), visit.runner.snapshot().status.reason) == ("hold", "stopped_by_user")

    before, kept = set(visit.app.boards), visit.runner.snapshot().scenario
    visit.page.reload()
    wait_for(lambda: set(visit.app.boards) - before, "the new window")
    visit.ready()
    wait_for(lambda: visit.page.get_by_text("T1, G1").count() > 0, "the task in the list")
    assert visit.page.get_by_text("T2, G2").count() > 0
    now = visit.runner.snapshot().scenario
    assert now.constraint == kept.constraint
    assert [t.name for t in now.tracker] == [t.name for t in kept.tracker]
    assert state(visit) == "hold"


def test_a_blank_wall_is_refused_the_offered_place_taken_and_nudged_exactly(visit: Visit) -> None:
    composer, runner = visit.app.composer, visit.runner
    visit.page.keyboard.press("t")
    wait_for(lambda: composer.tool == "tracker", "the tool in hand")
    composer.place = "patch"
    visit.click("left", BLANK)
    hint = wait_for(lambda: composer.hint, "the offer")
    visit.page.locator(".vita .take").click()
    made = wait_for(lambda: dict(runner.snapshot().features), "the tracker there")
    ((name, feature),) = made.items()
    assert np.abs(feature.uv - hint.uv).max() < 0.2 and feature.ok
    composer.put_away()
    composer.place = "auto"
    visit.page.locator(".vita .item label.grow").first.click()
    wait_for(lambda: visit.page.locator("#vita-selected").count() == 1, "its card")
    assert "patch" in visit.page.locator("#vita-selected").inner_text()
    for key, step in (("ArrowRight", (1.0, 0.0)), ("Shift+ArrowDown", (0.0, 0.1))):
        before = runner.snapshot().features[name].uv
        visit.page.keyboard.press(key)
        wait_for(
            lambda: np.abs(runner.snapshot().features[name].uv - before - step).max() < 0.04,  # noqa: B023
            f"the step by {key}",
        )


def test_the_example_button_and_start_are_enough_to_see_it_work(visit: Visit) -> None:
    visit.press("Show me an example")
    wait_for(lambda: len(visit.runner.snapshot().scenario.constraint) == 2, "the example")
    converges(visit)


def test_a_simulation_that_dies_is_explained_and_restarts_with_the_task(visit: Visit) -> None:
    visit.press("Show me an example")
    wait_for(lambda: len(visit.runner.snapshot().scenario.constraint) == 2, "the example")
    revision, known = visit.runner.rig_revision, visit.runner.snapshot().stamp
    visit.runner._engine.rig._process.kill()
    wait_for(lambda: state(visit) == "offline", "the loss to be noticed")
    wait_for(lambda: visit.page.get_by_text("Offline", exact=True).count() > 0, "the page to say so")
    visit.press("Restart")
    wait_for(lambda: state(visit) == "idle", "the restart", 60.0)
    assert visit.runner.rig_revision > revision and known >= 0
    assert len(visit.runner.snapshot().scenario.constraint) == 2
    shown = visit.board.snapshot
    assert shown is not None
    wait_for(lambda: visit.board.snapshot.tick > shown.tick + 5, "new pictures")  # type: ignore[union-attr]
    converges(visit)
