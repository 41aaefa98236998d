"""The page in a real browser: what is clicked is what is meant."""

from __future__ import annotations

from collections.abc import Callable, Iterator

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


def zoom_in(visit: Visit) -> None:
    """Two notches of the wheel over the middle of the left view."""
    lens = visit.app.server.get_clients()[max(visit.app.boards)].camera
    far = abs(float(lens.position[2]))
    visit.page.mouse.move(*visit.place("left", (320, 240)))
    visit.page.mouse.wheel(0, -120)
    wait_for(lambda: abs(float(lens.position[2])) < 0.97 * far, "the zoom")
    visit.page.wait_for_timeout(600)  # the zoom glides to rest


def targets(visit: Visit, to_pixel: np.ndarray, count: int, seed: int) -> list[tuple[int, int, np.ndarray]]:
    """`count` window positions inside a view that can be seen, with the pixel (2,) that is drawn there."""
    box = visit.canvas()
    assert box is not None
    rng, chosen = np.random.default_rng(seed), []
    while len(chosen) < count:
        x = int(rng.uniform(box["x"] + 3, box["x"] + box["width"] - 3))
        y = int(rng.uniform(box["y"] + 3, box["y"] + box["height"] - 3))
        # A mouse event belongs to a whole CSS pixel, whose middle is what the person points at.
        meant = np.array([x + 0.5, y + 0.5, 1.0]) @ to_pixel
        if 4 < meant[0] < SIZE[0] - 5 and 4 < meant[1] < SIZE[1] - 5:
            chosen.append((x, y, meant))
    return chosen


def test_clicks_land_within_a_pixel_of_what_is_drawn(
    visit: Visit, monkeypatch: pytest.MonkeyPatch, record_property: Callable[[str, object], None]
) -> None:
    """120 clicks: three window sizes and a zoom; the oracle is a screenshot, not our own geometry."""
    landed: list[tuple[str, tuple[float, float]]] = []
    misses: list[np.ndarray] = []
    for seed, window in enumerate([(1280, 720), (1000, 900), (1600, 800), "zoomed"]):
        width, height = (1280, 720) if isinstance(window, str) else window
        visit.page.set_viewport_size({"width": width, "height": height})
        settle(visit)
        monkeypatch.setattr(visit.board, "on_pick", lambda camera, uv, hit: landed.append((camera, uv)))
        if window == "zoomed":
            zoom_in(visit)
        for camera in COLORS:
            for x, y, meant in targets(visit, truth(visit, camera), 15, seed):
                known = len(landed)
                visit.page.mouse.click(x, y)
                wait_for(lambda: len(landed) > known, f"the click at {x}, {y} of {camera}")  # noqa: B023
                name, uv = landed[-1]
                assert name == camera
                misses.append(np.array(uv) - meant)
    visit.page.keyboard.press("f")
    settle(visit)
    errors = np.linalg.norm(misses, axis=1)
    record_property("click_error_px", {"clicks": len(errors), "mean": errors.mean(), "max": errors.max()})
    print(f"{len(errors)} clicks: mean {errors.mean():.3f} px, max {errors.max():.3f} px")
    assert len(errors) == 120
    assert errors.max() < 1.0
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


def test_every_documented_key_does_what_it_says(visit: Visit) -> None:
    runner, page, composer, board = visit.runner, visit.page, visit.app.composer, visit.board
    for letter, tool in (("p", "point_to_point"), ("l", "point_to_line"), ("m", "line_to_line"),
                         ("b", "parallel_lines"), ("t", "tracker")):
        page.keyboard.press(letter)
        wait_for(lambda: composer.tool == tool, f"{tool} by {letter}")  # noqa: B023
    page.keyboard.press("x")
    wait_for(lambda: composer.tool == "select", "Select by x")

    def sent(key: str, kind: type) -> None:
        runner.log.clear()
        page.keyboard.press(key)
        wait_for(lambda: any(isinstance(x, kind) for x in runner.log), f"{kind.__name__} by {key}")

    runner.submit(c.AddTracker("left", (300.0, 240.0), "fixed", "G1"))
    wait_for(lambda: "G1" in runner.snapshot().features, "the marker")
    sent("Control+z", c.Undo)
    sent("Control+y", c.Redo)
    sent("Shift+R", c.ResetArm)
    composer.selected = "G1"
    sent("ArrowRight", c.MoveTracker)
    assert runner.log[-1].uv == (301.0, 240.0)
    sent("Shift+ArrowUp", c.MoveTracker)
    sent("Delete", c.DeleteTracker)
    page.keyboard.press("v")
    wait_for(lambda: board.mode == "world", "the 3D world by v")
    wait_for(lambda: page.evaluate("window.vitaPage.still") is False, "arrow keys that may orbit")
    page.keyboard.press("v")
    wait_for(lambda: board.mode == "cameras", "the cameras by v")
    wait_for(lambda: page.evaluate("window.vitaPage.still") is True, "arrow keys that may not")
    settle(visit)

    def shown() -> float:
        """Share of the whole board's height that is seen."""
        assert board.layout is not None
        return board.lens._height() / board.layout.window.h

    # What the browser tells of its camera lags behind, and at first it is still the 3D world's.
    try:
        wait_for(lambda: abs(shown() - 1) < 0.01, "all cameras after v")
    except BaseException:
        camera = board.lens._client.camera
        print("share", shown(), "fov", camera.fov, "position", camera.position, "look_at", camera.look_at)
        raise
    whole = board.lens.unit()
    page.keyboard.press("2")
    wait_for(lambda: board.lens.unit() < 0.9 * whole, "one camera by 2")
    page.keyboard.press("f")
    wait_for(lambda: abs(board.lens.unit() / whole - 1) < 0.01, "all cameras by f")


def test_typing_in_a_text_field_triggers_no_key(visit: Visit) -> None:
    runner, page = visit.runner, visit.page
    runner.submit(c.AddTracker("left", (300.0, 240.0), "fixed", "G1"))
    wait_for(lambda: "G1" in runner.snapshot().features, "the marker")
    visit.app.composer.selected = "G1"
    field = page.locator("input[value='G1']")
    field.wait_for()
    field.click()
    runner.log.clear()
    stops = runner.stops
    page.keyboard.press("Control+a")
    page.keyboard.type("p lmb txv 1")
    page.keyboard.press("Backspace")
    page.keyboard.press("Delete")
    wait_for(lambda: any(isinstance(x, c.RenameTracker) for x in runner.log), "the new name")
    page.wait_for_timeout(300)
    assert all(isinstance(x, c.RenameTracker) for x in runner.log), runner.log
    assert runner.stops == stops
    assert visit.app.composer.tool == "select" and visit.board.mode == "cameras"
    page.keyboard.press("Tab")


def test_a_click_beside_the_pictures_deselects_or_says_where_to_click(visit: Visit) -> None:
    runner, composer = visit.runner, visit.app.composer
    runner.submit(c.AddTracker("left", (300.0, 240.0), "fixed", "G1"))
    wait_for(lambda: "G1" in runner.snapshot().features, "the marker")
    composer.selected = "G1"
    box = visit.canvas()
    assert box is not None
    beside = box["x"] + box["width"] / 2, box["y"] + box["height"] - 20
    visit.page.mouse.click(*beside)
    wait_for(lambda: composer.selected is None, "nothing selected")
    composer.arm("point_to_point")
    visit.page.mouse.click(*beside)
    wait_for(lambda: "inside" in composer.note, "the advice")


def test_a_lost_rig_is_explained_and_the_button_restarts_it(visit: Visit) -> None:
    visit.runner.lose("The simulation has ended. Press Restart.")
    wait_for(lambda: visit.page.get_by_text("Press Restart").count() > 0, "the explanation")
    visit.press("Restart")
    wait_for(lambda: any(isinstance(x, c.ResetArm) for x in visit.runner.log), "the restart")
    wait_for(lambda: visit.page.get_by_text("Ready", exact=True).count() > 0, "the page to be ready")


def test_the_rates_are_seen_without_opening_a_tab(visit: Visit) -> None:
    line = visit.page.locator(".vita.rates")
    wait_for(lambda: line.is_visible() and "pictures" in line.inner_text(), "the rates")
    words = line.inner_text()
    assert "control 30 Hz" in " ".join(words.split()) and "simulation 1.00×" in " ".join(words.split())
    assert "below 1 the machine cannot keep up" in line.get_attribute("title")


@pytest.mark.parametrize("window", [(1280, 720), (1920, 1080)])
def test_a_small_window_shows_the_whole_task_without_scrolling(
    visit: Visit, window: tuple[int, int]
) -> None:
    """Two constraints: their rows and the first tracker are inside the panel; all rows in a large one."""
    runner, page = visit.runner, visit.page
    for number, camera in enumerate(("left", "right"), start=1):
        runner.submit(c.AddTracker(camera, (200.0, 150.0), "auto", f"T{number}"))
        runner.submit(c.AddTracker(camera, (330.0, 310.0), "fixed", f"G{number}"))
        runner.submit(c.AddConstraint("point_to_point", (f"T{number}", f"G{number}")))
    page.set_viewport_size({"width": window[0], "height": window[1]})
    rows = page.locator(".vita .item label.grow")
    wait_for(lambda: rows.count() == 6, "the rows")
    settle(visit)
    page.wait_for_timeout(300)
    plots = page.locator("[data-dock-leaf]").last.bounding_box()
    ends = [rows.nth(i).bounding_box() for i in range(6)]
    seen = sum(end["y"] + end["height"] <= plots["y"] for end in ends)
    page.set_viewport_size({"width": 1280, "height": 720})
    settle(visit)
    assert seen >= (3 if window[1] == 720 else 6)


def test_orbiting_is_impossible(visit: Visit) -> None:
    """Neither dragging beside the pictures nor the arrow keys leave the straight view."""
    lens = visit.app.server.get_clients()[max(visit.app.boards)].camera
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
        monkeypatch.setattr(app.audience.encoder, "encode", lambda snapshot: encoded.append(snapshot) or {})
        first = runner.snapshot().tick
        wait_for(lambda: runner.snapshot().tick > first + 10, "ten ticks")
        assert not encoded
    finally:
        app.close()
        runner.close()
