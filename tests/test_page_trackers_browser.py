"""Placing and correcting trackers in a real browser: keys, loupe, edges, kinds, losses and offers."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from browser import Visit, chromium, wait_for
from fake_runner import BETTER, FakeRunner

from vita import commands as c
from vita.types import Status
from vita.ui import App

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def visit() -> Iterator[Visit]:
    with chromium() as browser:
        runner = FakeRunner()
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
    composer, runner = visit.app.composer, visit.runner
    composer.put_away()
    composer.selected, composer.edge, composer.place, composer.follow = None, False, "auto", "auto"
    runner.lost.clear()
    if runner.scenario.tracker:
        runner.submit(c.ClearTask())
        wait_for(lambda: not runner.scenario.tracker, "an empty task")
    visit.page.mouse.move(*beside(visit))
    runner.log.clear()


def beside(visit: Visit) -> tuple[float, float]:
    """A place of the window next to the pictures."""
    box = visit.canvas()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] - 20


def put(visit: Visit, name: str, uv: tuple[float, float], to: tuple[float, float] | None = None) -> None:
    kind = "fixed" if to is None else "line"
    visit.runner.submit(c.AddTracker("left", uv, kind, name, to))
    wait_for(lambda: name in visit.runner.snapshot().features, f"the tracker {name}")
    wait_for(lambda: visit.board.snapshot and name in visit.board.snapshot.features, "the picture of it")
    visit.runner.log.clear()


def asked(visit: Visit, kind: type, count: int = 1) -> list:
    """The commands of a kind, once there are `count`."""
    found: Callable[[], list] = lambda: [x for x in visit.runner.log if isinstance(x, kind)]  # noqa: E731
    return wait_for(lambda: found() if len(found()) >= count else None, f"{count} {kind.__name__}")


def drag(visit: Visit, start: tuple[float, float], end: tuple[float, float], release: bool = True) -> None:
    """Drag from one pixel of the left view to another."""
    a, b = np.array(visit.place("left", start)), np.array(visit.place("left", end))
    visit.page.mouse.move(*a)
    visit.page.mouse.down()
    for share in (0.2, 0.5, 0.8, 1.0):
        visit.page.mouse.move(*(a + share * (b - a)))
        visit.page.wait_for_timeout(40)
    if release:
        visit.page.mouse.up()


def choose(visit: Visit, old: str, new: str) -> None:
    """Choose in the dropdown that shows `old`."""
    visit.page.locator(f"input[value='{old}']:visible").first.click()
    visit.page.get_by_role("option", name=new, exact=True).click()


def test_arrow_keys_move_the_selected_tracker_by_a_pixel_and_with_shift_by_a_tenth(visit: Visit) -> None:
    """The view stays where it is: no camera that the browser reports is turned or moved."""
    put(visit, "G1", (300.0, 240.0))
    client = visit.app.server.get_clients()[max(visit.app.boards)]
    poses: list[np.ndarray] = []
    at_rest = np.array([*client.camera.position, *client.camera.look_at, *client.camera.wxyz])

    @client.camera.on_update
    async def watch(camera: object) -> None:
        now = client.camera
        poses.append(np.array([*now.position, *now.look_at, *now.wxyz]))

    visit.page.keyboard.press("ArrowLeft")
    visit.page.wait_for_timeout(300)
    assert not visit.runner.log  # nothing is selected
    visit.app.composer.selected = "G1"
    expected = np.array([300.0, 240.0])
    for number, (key, step) in enumerate([
        ("ArrowRight", (1, 0)), ("ArrowDown", (0, 1)), ("ArrowLeft", (-1, 0)), ("ArrowUp", (0, -1)),
        ("Shift+ArrowRight", (0.1, 0)), ("Shift+ArrowDown", (0, 0.1)), ("Shift+ArrowRight", (0.1, 0)),
    ], start=1):
        visit.page.keyboard.press(key)
        expected = expected + step
        assert np.allclose(asked(visit, c.MoveTracker, number)[-1].uv, expected, atol=1e-9), key
    # A held key repeats faster than the engine answers: no step is lost, and the camera never turns.
    visit.runner.log.clear()
    visit.page.wait_for_timeout(400)
    for _ in range(8):
        visit.page.keyboard.down("ArrowRight")
    visit.page.wait_for_timeout(400)
    visit.page.keyboard.up("ArrowRight")
    assert np.allclose(asked(visit, c.MoveTracker, 8)[-1].uv, expected + (8, 0), atol=1e-9)
    off = max((np.abs(pose - at_rest).max() for pose in poses), default=0.0)
    assert off < 1e-3
    visit.page.keyboard.press("Control+z")
    asked(visit, c.Undo)


def test_two_clicks_along_an_image_edge_make_one_line_of_a_constraint(visit: Visit) -> None:
    visit.press("Point → Line")
    wait_for(lambda: visit.app.composer.tool == "point_to_line", "the tool in hand")
    choose(visit, "Two points", "Image edge")
    wait_for(lambda: visit.app.composer.edge, "the choice")
    clicks = [(120.0, 300.0), (200.0, 150.0), (420.0, 180.0)]
    for number, uv in enumerate(clicks, start=1):
        visit.click("left", uv)
        wait_for(lambda n=number: visit.app.composer.points == n or n == 3, "the click to be counted")
    made = asked(visit, c.AddConstraint)[0]
    point, line = asked(visit, c.AddTracker, 2)
    assert (point.kind, line.kind, made.points) == ("auto", "line", (point.name, line.name))
    assert np.abs(np.array([point.uv, line.uv, line.to]) - clicks).max() < 2.0


def test_a_line_is_moved_by_its_end_or_as_a_whole(visit: Visit) -> None:
    put(visit, "L1", (200.0, 150.0), (400.0, 150.0))
    drag(visit, (402.0, 151.0), (422.0, 211.0))
    move = asked(visit, c.MoveTracker)[0]
    assert np.abs(np.array([move.uv, move.to]) - [(200, 150), (420, 210)]).max() < 2.0
    wait_for(lambda: not visit.board.picking.dragged, "the hand to let go")
    visit.runner.log.clear()
    drag(visit, (260.0, 168.0), (280.0, 268.0))
    move = asked(visit, c.MoveTracker)[0]
    assert move.to is None and np.abs(np.array(move.uv) - (330, 280)).max() < 2.0


def test_the_chosen_kind_of_tracker_is_placed(visit: Visit) -> None:
    visit.press("Tracker")
    wait_for(lambda: visit.app.composer.tool == "tracker", "the tool in hand")
    choose(visit, "Automatic", "Ellipse")
    wait_for(lambda: visit.page.get_by_text("The middle of a round hole").count() > 0, "its sentence")
    visit.click("left", (300.0, 200.0))
    assert asked(visit, c.AddTracker)[0].kind == "ellipse"
    visit.app.composer.put_away()


def test_a_lost_tracker_is_explained_and_half_speed_is_said(visit: Visit) -> None:
    page, runner = visit.page, visit.runner
    runner.submit(c.AddTracker("left", (300.0, 200.0), "patch", "T1"))
    wait_for(lambda: page.locator(".vita .item label.grow").count() == 1, "the row")
    wait_for(lambda: page.locator(".vita .quality").count() == 1, "its quality")
    runner.lost.add("T1")
    row = page.locator(".vita .lost")
    wait_for(lambda: row.count() == 1, "the loss")
    words = row.inner_text()
    assert words.startswith("T1 lost: covered, or changed too much.") and "drag it onto its feature" in words
    page.locator(".vita .item label.grow").first.click()
    card = page.locator("#vita-selected")
    wait_for(lambda: card.count() == 1 and "Lost: covered" in card.inner_text(), "the card to say so too")
    try:
        runner._start = time.monotonic()
        runner._status = Status("servoing", "", "T1 is lost: going on without it.", degraded=True)
        wait_for(lambda: page.get_by_text("Moving at half speed").count() == 1, "the chip")
        assert page.get_by_text("going on without it").count() == 1
    finally:
        runner._status = Status()


def test_a_refused_click_offers_the_nearest_good_place_on_the_picture_and_as_a_button(visit: Visit) -> None:
    composer = visit.app.composer
    visit.page.keyboard.press("p")
    wait_for(lambda: composer.tool == "point_to_point", "the tool in hand")
    for take in ("picture", "button"):
        visit.runner.log.clear()
        visit.click("left", (200.0, 8.0))
        wait_for(lambda: composer.hint is not None and not composer.picked, "the offer")
        assert "nothing to hold on to" in composer.note
        if take == "picture":
            visit.click("left", (BETTER[0] + 9, BETTER[1] - 6))
        else:
            visit.page.locator(".vita .take").click()
        again = asked(visit, c.AddTracker, 2)[-1]
        assert (again.camera, again.uv) == ("left", BETTER)
        wait_for(lambda: len(composer.picked) == 1 and composer.picked[0].seen, "the tracker there")
        visit.page.keyboard.press("Escape")
        wait_for(lambda: composer.tool == "select", "the tool put away")
        wait_for(lambda: not visit.runner.scenario.tracker, "the click taken back")
        visit.page.keyboard.press("p")
        wait_for(lambda: composer.tool == "point_to_point", "the tool in hand")


def test_a_loupe_follows_the_pointer_while_a_place_is_chosen(visit: Visit) -> None:
    """What it shows is what a click takes; the button may be held down and let go at the place."""
    loupe, composer = visit.board.loupe, visit.app.composer
    visit.page.mouse.move(*visit.place("left", (200.0, 200.0)))
    visit.page.wait_for_timeout(300)
    assert loupe.shown is None  # no tool in hand
    visit.page.keyboard.press("t")
    for camera, uv in (("left", (200.0, 200.0)), ("right", (333.0, 222.0))):
        visit.page.mouse.move(*visit.place(camera, uv))
        wait_for(lambda: shown_near(visit, camera, uv), f"the loupe at {uv}")  # noqa: B023
    x, y = (int(p) for p in visit.place("right", (350.0, 240.0)))
    visit.page.mouse.move(x, y)
    wait_for(lambda: shown_near(visit, "right", (350.0, 240.0)), "the loupe at the spot")
    seen = loupe.shown
    visit.page.mouse.click(x, y)
    placed = asked(visit, c.AddTracker)[0]
    assert seen is not None and np.abs(np.array(placed.uv) - seen[1]).max() < 0.02
    visit.runner.log.clear()
    drag(visit, (100.0, 100.0), (180.0, 300.0), release=False)
    wait_for(lambda: shown_near(visit, "left", (180.0, 300.0)), "the loupe at the hand")
    visit.page.mouse.up()
    assert np.abs(np.array(asked(visit, c.AddTracker)[0].uv) - (180, 300)).max() < 2.0
    visit.page.mouse.move(*beside(visit))
    wait_for(lambda: loupe.shown is None, "no loupe beside the pictures")
    composer.put_away()


def shown_near(visit: Visit, camera: str, uv: tuple[float, float]) -> bool:
    shown = visit.board.loupe.shown
    return shown is not None and shown[0] == camera and bool(np.abs(np.array(shown[1]) - uv).max() < 2.0)


def test_the_card_of_the_selected_tracker_shows_where_it_is_to_a_tenth_of_a_pixel(visit: Visit) -> None:
    put(visit, "G1", (300.0, 240.0))
    visit.page.locator(".vita .item label.grow").first.click()
    spot = visit.page.locator("#vita-selected circle")
    wait_for(lambda: spot.count() == 1 and float(spot.get_attribute("cx")) == 300.0, "the loupe")
    visit.page.keyboard.press("Shift+ArrowRight")
    wait_for(lambda: float(spot.get_attribute("cx")) == 300.1, "the cross-hair a tenth further")
    view = [float(x) for x in visit.page.locator("#vita-selected svg").get_attribute("viewBox").split()]
    assert view[0] < 300.1 < view[0] + view[2] and view[1] < 240.0 < view[1] + view[3]
    picture = visit.page.locator("#vita-selected img")
    assert re.match(r"data:image/png;base64,", picture.get_attribute("src"))
    natural = picture.evaluate("image => [image.naturalWidth, image.naturalHeight]")
    assert natural == view[2:]  # pixel for pixel


def test_the_page_stays_white_beside_the_pictures_under_the_pointer(visit: Visit) -> None:
    """viser marks what can be clicked in yellow when the pointer is over it, and that is the whole page."""
    x, y = beside(visit)
    for step in (0, 2):
        visit.page.mouse.move(x + step, y)
        visit.page.wait_for_timeout(400)
        assert visit.picture()[int(y) - 4, int(x) - 40].min() > 250


def test_a_slider_in_focus_keeps_the_arrow_keys_for_itself(visit: Visit) -> None:
    put(visit, "G1", (300.0, 240.0))
    visit.app.composer.selected = "G1"
    visit.page.get_by_role("tab", name="View").click()
    slider = visit.page.get_by_role("slider").first
    slider.wait_for()
    before = slider.get_attribute("aria-valuenow")
    slider.focus()
    visit.page.keyboard.press("ArrowRight")
    wait_for(lambda: slider.get_attribute("aria-valuenow") != before, "the slider to move")
    visit.page.wait_for_timeout(200)
    assert not [x for x in visit.runner.log if isinstance(x, c.MoveTracker)]
    visit.page.keyboard.press("ArrowLeft")
    visit.page.get_by_role("tab", name="Task").click()
    visit.page.locator("canvas").first.focus()
