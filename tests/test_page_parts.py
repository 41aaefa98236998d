"""The page without a browser: geometry, composing, overlays, and what is refused."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fake_runner import FakeRunner, two_cameras
from hypothesis import given, settings
from hypothesis import strategies as st
from viser import _messages

from vita import commands as c
from vita.errors import BadInput, UnknownName
from vita.scenario.schema import ConstraintSpec, Scenario, TrackerSpec
from vita.snapshot import Snapshot
from vita.types import ErrorVector, Feature, RowLabel, Status, frozen
from vita.ui import App, serve
from vita.ui.compose import Composer
from vita.ui.drawer import Drawer
from vita.ui.layout import FOV, arrange, unproject, window_distance
from vita.ui.marks import clip_line
from vita.ui.overlay import draw
from vita.ui.plots import SPAN_S, History
from vita.ui.ports import check_free
from vita.ui.safe import guarded, number
from vita.ui.tags import Placer, Tag, box_of, overlap
from vita.ui.words import KINDS, explain, pixels

SIZES = st.dictionaries(
    st.sampled_from(["a", "b", "c", "d"]),
    st.tuples(st.integers(160, 1920), st.integers(120, 1200)),
    min_size=1,
    max_size=4,
)


@settings(deadline=None)
@given(SIZES, st.floats(0.3, 4.0), st.booleans())
def test_views_never_overlap_and_are_inside_the_window(
    sizes: dict[str, tuple[int, int]], aspect: float, pane: bool
) -> None:
    layout = arrange(sizes, aspect, pane)
    boxes = [cell.rect for cell in layout.cells.values()] + ([layout.pane] if layout.pane else [])
    for box in boxes:
        assert box.x >= -1e-6 and box.x + box.w <= layout.window.w + 1e-6
        assert box.y >= -1e-6 and box.y + box.h <= layout.window.h + 1e-6
    for i, a in enumerate(boxes):
        for b in boxes[i + 1 :]:
            apart_x = a.x + a.w <= b.x + 1e-6 or b.x + b.w <= a.x + 1e-6
            apart_y = a.y + a.h <= b.y + 1e-6 or b.y + b.h <= a.y + 1e-6
            assert apart_x or apart_y


@settings(deadline=None)
@given(
    st.tuples(st.floats(0, 639), st.floats(0, 479)), st.floats(0.5, 3.0), st.floats(400, 4000),
    st.tuples(st.floats(-500, 2000), st.floats(-500, 2000)),
)
def test_a_pixel_seen_through_the_lens_comes_back(
    uv: tuple[float, float], aspect: float, height: float, eye: tuple[float, float]
) -> None:
    """Projecting with a plain pinhole camera and unprojecting gives the same pixel."""
    cell = arrange({"left": (640, 480), "right": (1280, 720)}, 1.4).cells["left"]
    x, y = cell.to_board(*uv)
    distance = window_distance(height)
    focal = 1.0 / (2.0 * np.tan(FOV / 2.0))  # in window heights
    screen = (focal * (x - eye[0]) / distance / aspect + 0.5, focal * (y - eye[1]) / distance + 0.5)
    back = cell.to_pixel(*unproject(screen, (*eye, -distance), FOV, aspect))
    assert np.allclose(back, uv, atol=1e-6)


def test_views_stand_side_by_side_in_a_wide_window_and_stacked_in_a_tall_one() -> None:
    pair = {"left": (640, 480), "right": (640, 480)}
    wide, tall = arrange(pair, 1.8).cells, arrange(pair, 0.6).cells
    assert wide["left"].rect.y == wide["right"].rect.y
    assert tall["left"].rect.x == tall["right"].rect.x


class Bench:
    """A composer on a scenario that takes every command at once."""

    def __init__(self, refuse: tuple[str, ...] = ()) -> None:
        self.refuse, self.now, self.tick = refuse, 0.0, 0
        self.scenario = two_cameras()
        self.sent: list[object] = []
        self.composer = Composer(self.submit, clock=lambda: self.now)

    def submit(self, command: object) -> None:
        self.sent.append(command)
        s = self.scenario
        if isinstance(command, c.AddTracker) and command.name not in self.refuse:
            spec = TrackerSpec(str(command.name), command.camera, command.kind, command.uv)
            self.scenario = replace(s, tracker=(*s.tracker, spec))
        elif isinstance(command, c.DeleteTracker):
            self.scenario = replace(s, tracker=tuple(t for t in s.tracker if t.name != command.name))
        elif isinstance(command, c.AddConstraint):
            spec2 = ConstraintSpec(f"c{len(s.constraint) + 1}", command.kind, command.points)
            self.scenario = replace(s, constraint=(*s.constraint, spec2))

    def snapshot(self) -> Snapshot:
        features = {t.name: Feature(frozen(t.at or (0, 0))) for t in self.scenario.tracker}
        return Snapshot(self.tick, 0.0, Status(), frozen(()), (), {}, features, self.scenario)

    def click(self, camera: str, u: float, v: float, hit: str | None = None) -> None:
        self.composer.click(self.snapshot(), camera, (u, v), hit)
        self.tick += 1
        self.now += 0.1
        self.composer.reconcile(self.snapshot())


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.key)
@pytest.mark.parametrize("goal", ["fixed", "auto"])
def test_as_many_clicks_as_roles_make_one_constraint(kind, goal: str) -> None:
    """Moving features first and `auto`, goals of the chosen kind, and the tool stays in hand."""
    bench = Bench()
    bench.composer.goal = goal
    bench.composer.arm(kind.key)
    for i in range(len(kind.roles)):
        assert not bench.scenario.constraint
        bench.click("left", 50.0 * i, 100.0)
    (made,) = bench.scenario.constraint
    assert made.kind == kind.key
    kinds = {t.name: t.kind for t in bench.scenario.tracker}
    assert [kinds[p] for p in made.points] == ["auto" if r == "moving" else goal for r in kind.roles]
    assert bench.composer.tool == kind.key
    assert "the same in right" in bench.composer.prompt(("left", "right"))[1]


def test_a_click_in_the_other_view_midway_changes_nothing_and_is_explained() -> None:
    bench = Bench()
    bench.composer.arm("point_to_point")
    bench.click("left", 10, 10)
    sent = len(bench.sent)
    bench.click("right", 10, 10)
    assert len(bench.sent) == sent
    assert "left" in bench.composer.note


def test_a_click_on_a_marker_uses_it_again() -> None:
    bench = Bench()
    bench.submit(c.AddTracker("left", (5.0, 5.0), "auto", "tip"))
    bench.composer.arm("point_to_point")
    bench.click("left", 6, 6, hit="tip")
    bench.click("left", 90, 90)
    assert bench.scenario.constraint[0].points == ("tip", "G1")
    assert len(bench.scenario.tracker) == 2


def test_a_refused_spot_steps_back_to_its_click_and_never_sends_a_broken_constraint() -> None:
    bench = Bench(refuse=("T1",))
    bench.composer.arm("point_to_point")
    bench.click("left", 10, 10)
    bench.tick, bench.now = bench.tick + 10, bench.now + 2.0
    bench.composer.reconcile(bench.snapshot())
    assert bench.composer.picked == [] and "refused" in bench.composer.note
    bench.refuse = ()
    bench.click("left", 20, 20)
    bench.click("left", 60, 60)
    assert len(bench.scenario.constraint) == 1


@settings(deadline=None)
@given(st.lists(st.sampled_from(["arm0", "arm1", "arm2", "left", "right", "tracker", "escape"]), max_size=30))
def test_escape_leaves_only_trackers_that_a_constraint_or_the_person_wanted(steps: list[str]) -> None:
    """Whatever is clicked, cancelled constraints leave no stray trackers behind."""
    bench, wanted = Bench(), 0
    for index, step in enumerate([*steps, "escape"]):
        if step.startswith("arm"):
            bench.composer.arm(KINDS[int(step[3])].key)
        elif step == "escape":
            bench.composer.put_away()
        elif step == "tracker":
            bench.composer.arm("tracker")
            if bench.composer.tool == "tracker":
                wanted += 1
                bench.click("left", 7.0 * index, 5.0)
                bench.composer.put_away()
        elif bench.composer.tool == "tracker":
            wanted += 1
            bench.click(step, 7.0 * index, 50.0)
        else:
            bench.click(step, 7.0 * index, 50.0)
    used = {p for k in bench.scenario.constraint for p in k.points}
    assert len(bench.scenario.tracker) == len(used) + wanted


@settings(deadline=None)
@given(
    st.tuples(st.floats(0, 639), st.floats(0, 479)), st.tuples(st.floats(0, 639), st.floats(0, 479))
)
def test_a_line_is_drawn_to_the_edges_of_the_image(a: tuple[float, float], b: tuple[float, float]) -> None:
    p, q = np.array(a), np.array(b)
    if np.hypot(*(q - p)) < 1.0:
        return
    ends = clip_line(p, q, (640, 480))
    assert ends is not None
    normal = np.array([-(q - p)[1], (q - p)[0]]) / np.hypot(*(q - p))
    assert np.abs((ends - p) @ normal).max() < 1e-6
    for end in ends:
        assert min(abs(end[0] + 0.5), abs(end[0] - 639.5), abs(end[1] + 0.5), abs(end[1] - 479.5)) < 1e-6


def test_overlays_are_finite_for_lost_and_missing_features() -> None:
    runner_scenario = replace(
        two_cameras(),
        tracker=tuple(
            TrackerSpec(f"p{i}", "left", "auto", (100.0 + 50 * i, 200.0 + 9 * i)) for i in range(4)
        ),
        constraint=tuple(
            ConstraintSpec(k.key, k.key, tuple(f"p{i}" for i in range(len(k.roles)))) for k in KINDS
        ),
    )
    nan = frozen([np.nan, np.nan])
    half = Feature(frozen([150.0, 209.0]), corners=np.full((4, 2), np.nan))
    features = {"p0": Feature(nan, "lost"), "p1": half}
    error = ErrorVector(frozen([np.nan]), (RowLabel("point_to_line", "left", "d"),), frozen([1.0]))
    snapshot = Snapshot(1, 0.0, Status(), frozen(()), (), {}, features, runner_scenario, error)
    cell = arrange({"left": (640, 480)}, 1.3).cells["left"]
    drawing = draw("left", cell, snapshot, Composer(lambda command: None), 1.5, {})
    for strokes in (drawing.bold, drawing.thin):
        points, colors = strokes.arrays(cell, -1.0)
        assert np.isfinite(points).all() and points.shape == colors.shape
    assert any(tag.text.startswith("p0 lost: drag it") for tag in drawing.tags)


SPOT = st.tuples(st.floats(60, 580), st.floats(60, 420))


@settings(deadline=None)
@given(SPOT, SPOT)
def test_labels_of_a_constraint_never_cover_one_another(
    moving: tuple[float, float], goal: tuple[float, float]
) -> None:
    """Wherever the arm is on its way to the goal, all three labels can be read."""
    placer = Placer()
    for share in np.linspace(0.0, 1.0, 20):
        at = tuple(np.array(moving) + share * (np.array(goal) - moving))
        middle = tuple((np.array(at) + goal) / 2)
        tags = [Tag("t", "cross_l", at), Tag("g", "ball_l", goal, "goal"),
                Tag("v", "12.3 px", middle, "value")]
        placed = placer.place(tags, (640, 480), 1.5, 6.0, 17.0)
        boxes = [box_of(uv, anchor, (6 * len(tag.text) + 4) * 1.5, 17 * 1.5) for tag, uv, anchor in placed]
        for i, a in enumerate(boxes):
            assert a[0] >= 0 and a[1] >= 0 and a[2] <= 640 and a[3] <= 480
            assert not any(overlap(a, b) for b in boxes[i + 1 :])


def test_a_label_stays_where_it_is_while_nothing_is_in_its_way() -> None:
    placer = Placer()
    anchors = {
        placer.place([Tag("t", "tip", (300.0 + i, 200.0))], (640, 480), 1.0, 6.0, 17.0)[0][2]
        for i in range(50)
    }
    assert len(anchors) == 1


def test_plot_columns_hold_no_nan_and_span_the_window() -> None:
    history = History()
    for i in range(2000):
        history.add(i / 30.0, np.array([np.nan if i % 3 else i, np.nan]))
    columns = history.columns(2)
    assert len({len(column) for column in columns}) == 1
    assert all(np.isfinite(column).all() for column in columns)
    assert columns[0][-1] == 0.0 and columns[0][0] >= -SPAN_S - 0.1


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -0.1, 99, "1", None, True, [1]])
def test_numbers_from_browsers_are_checked(value: object) -> None:
    with pytest.raises(BadInput):
        number(value, 0.0, 1.0, "gain")


def test_a_callback_that_raises_becomes_a_message_with_an_id_and_echoes_are_ignored() -> None:
    told: list[tuple[str, str]] = []
    guard = guarded(lambda client, level, text: told.append((level, text)))
    calls: list[object] = []

    def broken(event: object) -> None:
        calls.append(event)
        raise RuntimeError("boom")

    asyncio.run(guard(broken)(SimpleNamespace(client=object())))
    asyncio.run(guard(broken)(SimpleNamespace(client=None)))
    assert len(calls) == 1
    ((level, text),) = told
    assert level == "error" and "Internal error" in text and "boom" not in text


def test_a_taken_port_is_refused_by_name() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(BadInput, match=f"port {port} is taken; choose another with --port"):
            check_free("127.0.0.1", port)
    with pytest.raises(BadInput, match="--host"):
        check_free("no such host", 0)


def test_the_page_listens_on_this_machine_only_and_opens_no_tunnel() -> None:
    runner = FakeRunner()
    app = App(runner, port=0)
    try:
        assert app.server.get_host() == "127.0.0.1"
        handlers = app.server._websock_server._incoming_handlers
        assert _messages.ShareUrlRequest not in handlers
        assert _messages.ShareUrlDisconnect not in handlers
        with pytest.raises(BadInput, match="taken"):
            App(runner, port=app.port)
    finally:
        app.close()
        runner.close()
    check_free("127.0.0.1", app.port)


def test_serving_prints_one_line_and_ends_in_order_on_sigterm(capsys: pytest.CaptureFixture[str]) -> None:
    """The arm is stopped, the runner closed and the port free again when `serve` returns."""
    made: list[FakeRunner] = []
    urls: list[str] = []

    def make(scenario: Scenario) -> FakeRunner:
        made.append(FakeRunner(scenario))
        return made[-1]

    def ready(app: App) -> None:
        urls.append(app.url)
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGTERM)).start()

    before = signal.getsignal(signal.SIGTERM)
    serve(two_cameras(), port=0, make_runner=make, ready=ready)
    assert capsys.readouterr().out.splitlines() == [f"vita is at {urls[0]}"]
    assert made[0].stops >= 1 and not made[0]._thread.is_alive()
    assert signal.getsignal(signal.SIGTERM) is before
    check_free("127.0.0.1", int(urls[0].rsplit(":", 1)[1]))


@pytest.mark.parametrize("name", ["../x", "/etc/passwd", "CON", "a" * 300, "a\0b", "", ".hidden", "a/b"])
def test_save_names_cannot_leave_the_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(BadInput):
        Drawer(tmp_path / "tasks").save(name, two_cameras())
    assert list(tmp_path.rglob("*.toml")) == []


def test_a_saved_task_loads_equal(tmp_path: Path) -> None:
    drawer = Drawer(tmp_path)
    assert drawer.save(" my task ", two_cameras()) == "my task"
    assert drawer.names() == ["my task"]
    assert drawer.load("my task") == two_cameras()
    with pytest.raises(UnknownName):
        drawer.load("other")


def test_every_state_has_a_sentence_and_residuals_read_well() -> None:
    for state in ("offline", "idle", "learning", "servoing", "hold", "done", "fault", "estop"):
        assert explain(Status(state), 0, 0, "")  # type: ignore[arg-type]
    values = (0.123, 9.99, 123.4, float("nan"))
    assert [pixels(x) for x in values] == ["0.12 px", "9.99 px", "123 px", "not seen"]
