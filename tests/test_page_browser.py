"""The page in a real browser: what is clicked is what is meant."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from browser import Visit, chromium, wait_for
from fake_runner import FakeRunner, textured

from vita import commands as c
from vita.ui import App

pytestmark = pytest.mark.browser
SIZE = (640, 480)
CENTERS = ((60, 60), (580, 60), (60, 420), (580, 420))
SPOTS = np.array(CENTERS, float)
COLORS = {"left": (255, 0, 0), "right": (0, 0, 255)}


def with_spots(camera: str) -> np.ndarray:
    """A grey picture with four discs of one colour, centred on whole pixels."""
    picture = np.full((SIZE[1], SIZE[0], 3), 128, np.uint8)
    u, v = np.arange(SIZE[0])[None, :], np.arange(SIZE[1])[:, None]
    for cu, cv in CENTERS:
        picture[(u - cu) ** 2 + (v - cv) ** 2 <= 12**2] = COLORS[camera]
    return picture


def seen_spots(screenshot: np.ndarray, camera: str) -> np.ndarray | None:
    """(k, 2) window positions of the discs of a view, left to right within top to bottom; None if not all."""
    from scipy import ndimage

    color = np.array(COLORS[camera], int)
    mask = np.abs(screenshot.astype(int) - color).max(axis=2) < 110
    labels, count = ndimage.label(mask)  # type: ignore[misc]
    blobs = [i for i in range(1, count + 1) if (labels == i).sum() > 60]
    if len(blobs) != 4:
        return None
    centers = np.array([ndimage.center_of_mass(labels == i) for i in blobs])[:, ::-1] + 0.5
    centers = centers[np.argsort(centers[:, 1])]
    return np.concatenate([pair[np.argsort(pair[:, 0])] for pair in (centers[:2], centers[2:])])


@pytest.fixture(scope="module")
def visit() -> Iterator[Visit]:
    with chromium() as browser:
        runner = FakeRunner(pictures={name: with_spots(name) for name in COLORS})
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
    visit.app.composer.put_away()
    visit.app.composer.selected = None
    if visit.runner.scenario.tracker:
        visit.runner.submit(c.ClearTask())
        wait_for(lambda: not visit.runner.scenario.tracker, "an empty task")
    visit.runner.log.clear()


def truth(visit: Visit, camera: str) -> np.ndarray:
    """(3, 2) affine map from window position to pixel, measured on what the browser really drew."""
    found: list[np.ndarray] = []

    def look() -> bool:
        box = visit.canvas()
        assert box is not None
        spots = seen_spots(visit.picture()[:, : int(box["x"] + box["width"])], camera)
        if spots is not None:
            found.append(spots)
        return bool(found)

    wait_for(look, f"the discs of {camera}")
    spots = found[0]
    design = np.column_stack([spots, np.ones(4)])
    return np.linalg.lstsq(design, SPOTS, rcond=None)[0]


def settle(visit: Visit) -> None:
    """Wait until the board is arranged and fitted for the window as it is."""

    def fitted() -> bool:
        box, layout = visit.canvas(), visit.board.layout
        assert box is not None and layout is not None
        return abs(layout.window.w / layout.window.h - box["width"] / box["height"]) < 0.01

    wait_for(fitted, "the arrangement")
    visit.page.wait_for_timeout(400)


@pytest.mark.parametrize("window", [(1280, 720), (1000, 900), (1600, 800), "zoomed"])
def test_clicks_land_within_a_pixel_of_what_is_drawn(
    visit: Visit, window: tuple[int, int] | str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """30 clicks a window in both views; the oracle is a screenshot, not our own geometry."""
    width, height = (1280, 720) if isinstance(window, str) else window
    visit.page.set_viewport_size({"width": width, "height": height})
    settle(visit)
    landed: list[tuple[str, tuple[float, float]]] = []
    board = visit.board
    monkeypatch.setattr(board, "_on_pick", lambda camera, uv, hit: landed.append((camera, uv)))
    if window == "zoomed":
        lens = board.client.camera
        far = float(lens.position[2])
        visit.page.mouse.move(*visit.place("left", (320, 240)))
        visit.page.mouse.wheel(0, -120)
        wait_for(lambda: abs(float(lens.position[2])) < 0.97 * abs(far), "the zoom")
    visit.page.wait_for_timeout(600)  # the zoom glides to rest
    rng = np.random.default_rng(3)
    misses: list[np.ndarray] = []
    for camera in COLORS:
        to_pixel = truth(visit, camera)
        box = visit.canvas()
        assert box is not None
        for _ in range(15):
            x, y = (int(p) for p in visit.place(camera, tuple(rng.uniform([30, 30], [610, 450]))))
            x = int(np.clip(x, box["x"] + 3, box["x"] + box["width"] - 3))
            y = int(np.clip(y, box["y"] + 3, box["y"] + box["height"] - 3))
            # A mouse event belongs to a whole CSS pixel, whose middle is what the person points at.
            meant = np.array([x + 0.5, y + 0.5, 1.0]) @ to_pixel
            if not (2 < meant[0] < SIZE[0] - 3 and 2 < meant[1] < SIZE[1] - 3):
                continue
            known = len(landed)
            visit.page.mouse.click(x, y)
            wait_for(lambda known=known: len(landed) > known, f"the click at {x}, {y} of {camera}")
            name, uv = landed[-1]
            assert name == camera
            misses.append(np.array(uv) - meant[:2])
    visit.page.set_viewport_size({"width": 1280, "height": 720})
    settle(visit)
    visit.page.keyboard.press("f")
    visit.page.wait_for_timeout(400)
    assert len(misses) >= 20
    assert np.abs(misses).max() <= 1.0
    assert np.abs(np.mean(misses, axis=0)).max() <= 0.25  # no offset by half a screen pixel


def test_two_constraints_are_composed_started_stopped_and_survive_a_reload(visit: Visit) -> None:
    """Eight clicks: the kind, two clicks in each view, Start, Stop."""
    runner = visit.runner
    visit.press("Point → Point")
    wait_for(lambda: visit.app.composer.tool == "point_to_point", "the tool in hand")
    wanted = {"T1": ("left", (200, 150)), "G1": ("left", (330, 310)), "T2": ("right", (220, 160)),
              "G2": ("right", (300, 330))}
    for number, (camera, uv) in enumerate(wanted.values()):
        visit.click(camera, uv)
        wait_for(lambda n=number: len(runner.scenario.tracker) > n, "the tracker of the click")
        pairs = (number + 1) // 2
        wait_for(lambda n=pairs: len(runner.scenario.constraint) == n, "the constraint")
    for spec in runner.scenario.tracker:
        camera, uv = wanted[spec.name]
        assert spec.camera == camera and spec.at is not None
        assert np.abs(np.array(spec.at) - uv).max() < 2.0  # half a CSS pixel is 0.75 px here
        assert spec.kind == ("auto" if spec.name.startswith("T") else "fixed")
    assert [k.points for k in runner.scenario.constraint] == [("T1", "G1"), ("T2", "G2")]
    assert {k.kind for k in runner.scenario.constraint} == {"point_to_point"}

    wait_for(lambda: visit.page.get_by_role("button", name="Start", exact=True).is_enabled(), "Start")
    visit.press("Start")
    wait_for(lambda: any(isinstance(x, c.Start) for x in runner.log), "Start in the runner")
    stops = runner.stops
    visit.press("Stop")
    wait_for(lambda: runner.stops > stops, "Stop in the runner")

    before = set(visit.app.boards)
    visit.page.reload()
    wait_for(lambda: set(visit.app.boards) - before, "the new window")
    visit.ready()
    wait_for(lambda: visit.page.get_by_text("T1, G1").count() > 0, "the task in the list")
    assert len(runner.scenario.constraint) == 2


def test_dragging_a_marker_keeps_the_grab_offset(visit: Visit) -> None:
    visit.runner.submit(c.AddTracker("left", (300.0, 240.0), "fixed", "G1"))
    wait_for(lambda: "G1" in visit.runner.snapshot().features, "the marker")
    visit.page.wait_for_timeout(400)
    start = visit.place("left", (304.0, 243.0))
    end = visit.place("left", (404.0, 303.0))
    visit.page.mouse.move(*start)
    visit.page.mouse.down()
    for share in (0.2, 0.5, 0.8, 1.0):
        visit.page.mouse.move(*(np.array(start) + share * (np.array(end) - start)))
        visit.page.wait_for_timeout(40)
    visit.page.mouse.up()
    move = wait_for(
        lambda: next((x for x in visit.runner.log if isinstance(x, c.MoveTracker)), None), "the move"
    )
    assert np.abs(np.array(move.uv) - (400, 300)).max() < 2.0


def test_keys_and_rows_do_what_they_say(visit: Visit) -> None:
    """Esc stops with no tool in hand and puts a tool away otherwise; rows select and delete."""
    runner, page = visit.runner, visit.page
    runner.submit(c.AddTracker("left", (300.0, 240.0), "fixed", "G1"))
    wait_for(lambda: page.locator(".vita .item label.grow").count() == 1, "the row")
    page.locator(".vita .item label.grow").first.click()
    wait_for(lambda: visit.app.composer.selected == "G1", "the selection")
    page.locator(".vita .item label.x").first.click()
    wait_for(lambda: not runner.scenario.tracker, "the deletion")
    stops = runner.stops
    page.keyboard.press("p")
    wait_for(lambda: visit.app.composer.tool == "point_to_point", "the tool in hand")
    page.keyboard.press("Escape")
    wait_for(lambda: visit.app.composer.tool == "select", "the tool put away")
    assert runner.stops == stops
    page.keyboard.press("Escape")
    wait_for(lambda: runner.stops == stops + 1, "the stop")
    page.keyboard.press("Control+z")
    wait_for(lambda: any(isinstance(x, c.Undo) for x in runner.log), "Undo")
    page.keyboard.press("Space")
    wait_for(lambda: any(isinstance(x, c.Start) for x in runner.log), "Start")


def test_orbiting_is_impossible(visit: Visit) -> None:
    """Neither dragging beside the pictures nor the arrow keys leave the straight view."""
    lens = visit.board.client.camera
    box = visit.canvas()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] - 20
    visit.page.mouse.move(x, y)
    visit.page.mouse.down()
    visit.page.mouse.move(x + 80, y - 60, steps=4)
    visit.page.mouse.up()
    visit.page.keyboard.down("ArrowLeft")
    visit.page.wait_for_timeout(500)
    visit.page.keyboard.up("ArrowLeft")
    wait_for(lambda: abs(abs(float(lens.wxyz[0])) - 1.0) < 1e-5, "the straight view")
    visit.page.keyboard.press("f")


def test_markup_in_a_task_is_shown_and_never_run(visit: Visit) -> None:
    evil = "<img src=x onerror=window.pwned=1>"
    visit.runner.submit(c.AddTracker("left", (100.0, 100.0), "fixed", evil))
    wait_for(lambda: visit.page.get_by_text(evil).count() > 0, "the name as text")
    assert visit.page.evaluate("window.pwned") is None


def test_pictures_are_not_encoded_without_a_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    runner = FakeRunner(pictures={"left": textured(SIZE, 1), "right": textured(SIZE, 2)})
    app = App(runner, port=0)
    try:
        encoded: list[object] = []
        monkeypatch.setattr(app._encoder, "encode", lambda snapshot: encoded.append(snapshot) or {})
        first = runner.snapshot().tick
        wait_for(lambda: runner.snapshot().tick > first + 10, "ten ticks")
        assert not encoded
    finally:
        app.close()
        runner.close()
