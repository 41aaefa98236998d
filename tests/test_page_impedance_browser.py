"""The stereo-impedance mode in a real browser: what is dragged goes where the mouse is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser import Visit, chromium, wait_for
from fake_following import PLACES, FakeFollowing, stereo_scene

from vita import commands as c
from vita.ui import App
from vita.ui.world3d import World3D

pytestmark = pytest.mark.browser
GREY = np.full((480, 640, 3), 150, np.uint8)


@pytest.fixture(scope="module")
def visit() -> Iterator[Visit]:
    with chromium() as browser:
        runner = FakeFollowing(stereo_scene("uvs"), pictures={"left": GREY, "right": GREY})
        app = App(runner, port=0)
        try:
            visit = Visit(app, runner, browser.new_page())
            visit.open()
            yield visit
        finally:
            app.close()
            runner.close()


def on_page(visit: Visit, world: World3D, place: Any) -> np.ndarray:
    """(2,) page coordinates at which a place of the scene (3,) [m] is seen: a pinhole of our own."""
    camera = visit.app.server.get_clients()[max(visit.app.boards)].camera
    box = visit.canvas()
    assert box is not None
    eye, ahead = np.array(camera.position), np.array(camera.look_at) - camera.position
    z = ahead / np.linalg.norm(ahead)
    x = np.cross(z, np.array(camera.up_direction))
    x /= np.linalg.norm(x)
    sight = world._at + world._rotation @ (world.scale * np.asarray(place)) - eye
    depth = float(sight @ z)
    focal = box["height"] / 2 / np.tan(float(camera.fov) / 2)
    right, down = float(sight @ x), float(sight @ np.cross(z, x))
    middle = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
    return middle + focal * np.array([right, down]) / depth


def asked(visit: Visit, name: str) -> list[np.ndarray]:
    return [
        np.array(cmd.arguments["xyz"]) for cmd in visit.runner.log
        if isinstance(cmd, c.Perform) and cmd.arguments["object"] == name
    ]


def drag(visit: Visit, start: np.ndarray, way: tuple[float, float], key: str = "") -> np.ndarray:
    """Drag from a place of the page by `way`; returns where the mouse was let go."""
    mouse, end = visit.page.mouse, start + way
    mouse.move(*start)
    visit.page.wait_for_timeout(150)
    if key:
        visit.page.keyboard.down(key)
    mouse.down()
    for share in np.linspace(0.1, 1.0, 8):
        mouse.move(*(start + share * np.array(way)))
        visit.page.wait_for_timeout(60)
    mouse.up()
    if key:
        visit.page.keyboard.up(key)
    return end


def test_the_switch_changes_tabs_start_and_what_start_does(visit: Visit) -> None:
    page, runner = visit.page, visit.runner
    start = page.get_by_role("button", name="Start", exact=True)
    wait_for(lambda: start.is_disabled(), "nothing to start without a constraint")
    page.locator("#vita-mode").get_by_text("Stereo impedance").click()
    wait_for(lambda: c.SetMode("impedance") in runner.log, "the command")
    wait_for(lambda: page.get_by_role("tab", name="Stereo").is_visible(), "the tab")
    assert page.get_by_role("tab", name="Task").count() == 0
    wait_for(lambda: page.locator("#vita-forces .gauge").count() == 5, "the forces")
    wait_for(lambda: "2.1 mm" in page.locator("#vita-stereo").inner_text(), "the calibration")
    wait_for(lambda: start.is_enabled(), "Start")
    start.click()
    words = "Following the target: 12 mm, 0.8 deg."
    wait_for(lambda: words in page.locator("#vita-run").inner_text(), "what goes on")
    wait_for(lambda: page.locator("#vita-mode.off").count() == 1, "a switch that rests")
    page.locator("#vita-mode").get_by_text("UVS").click(force=True)
    page.wait_for_timeout(200)
    assert not any(isinstance(cmd, c.SetMode) and cmd.mode == "uvs" for cmd in runner.log)


def test_the_target_goes_where_the_mouse_drags_it(visit: Visit) -> None:
    """In the small view about, in the big one up: seen from there it lies under the mouse again."""
    runner, board = visit.runner, visit.board
    if runner.scenario.mode != "impedance":
        runner.submit(c.SetMode("impedance"))
    wait_for(lambda: board._hands[0]._offered[1], "things to take")
    runner.log.clear()
    before = np.array(PLACES["target"])
    end = drag(visit, on_page(visit, board._small, before), (30.0, 12.0))
    wait_for(lambda: asked(visit, "target"), "the commands")
    visit.page.wait_for_timeout(300)
    after = asked(visit, "target")[-1]
    assert after[2] == pytest.approx(before[2]) and np.linalg.norm(after - before) > 0.05
    assert np.linalg.norm(on_page(visit, board._small, after) - end) < 4.0

    visit.page.keyboard.press("v")
    wait_for(lambda: board.mode == "world", "the big view")
    visit.page.wait_for_timeout(1500)
    runner.log.clear()
    end = drag(visit, on_page(visit, board._big, after), (0.0, -60.0), key="Shift")
    wait_for(lambda: asked(visit, "target"), "the commands")
    visit.page.wait_for_timeout(300)
    raised = asked(visit, "target")[-1]
    assert np.allclose(raised[:2], after[:2], atol=1e-4) and raised[2] > after[2] + 0.03
    assert abs(on_page(visit, board._big, raised)[1] - end[1]) < 6.0
