"""Trackers on the page, without a browser: the loupe, trails, quality, edge lines and offered places."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from fake_runner import two_cameras
from hypothesis import given, settings
from hypothesis import strategies as st

from vita import commands as c
from vita.errors import BadInput, Untrackable
from vita.runner import _instead
from vita.scenario.schema import ConstraintSpec, TrackerSpec
from vita.snapshot import Snapshot
from vita.types import Feature, Notice, Status, frozen
from vita.ui import loupe, pointer
from vita.ui.compose import Composer
from vita.ui.layout import arrange
from vita.ui.overlay import HINT_LABEL, draw
from vita.ui.panels import lists
from vita.ui.panels.selected import selected_card
from vita.ui.picking import _Grab, _nearest
from vita.ui.trails import JUMP_PX, SPAN_S, Trails
from vita.ui.words import AMBER, FOLLOW, GREEN, KINDS, RED, follow_label, quality
from vita.vision import TRACKER_KINDS

LINED = [kind for kind in KINDS if kind.lines]
PIXEL = st.tuples(st.floats(0, 639), st.floats(0, 479))


class Bench:
    """A composer on a scenario that takes every command at once, but refuses what `refuse` names."""

    def __init__(self, refuse: dict[str, tuple[float, float] | None] | None = None) -> None:
        self.refuse = refuse or {}
        self.now, self.tick = 0.0, 0
        self.scenario = two_cameras()
        self.notices: tuple[Notice, ...] = ()
        self.sent: list[object] = []
        self.composer = Composer(self.submit, clock=lambda: self.now)

    def submit(self, command: object) -> None:
        self.sent.append(command)
        s = self.scenario
        if isinstance(command, c.AddTracker) and command.name in self.refuse:
            refusal = Untrackable("blank wall", f"tracker {command.name!r}", self.refuse[command.name])
            notice = Notice(len(self.notices) + 1, "warning", str(refusal), _instead(command, refusal))
            self.notices = (*self.notices, notice)
        elif isinstance(command, c.AddTracker):
            spec = TrackerSpec(str(command.name), command.camera, command.kind, command.uv, command.to)
            self.scenario = replace(s, tracker=(*s.tracker, spec))
        elif isinstance(command, c.DeleteTracker):
            self.scenario = replace(s, tracker=tuple(t for t in s.tracker if t.name != command.name))
        elif isinstance(command, c.AddConstraint):
            made = ConstraintSpec(f"c{len(s.constraint) + 1}", command.kind, command.points)
            self.scenario = replace(s, constraint=(*s.constraint, made))

    def snapshot(self) -> Snapshot:
        features = {t.name: feature_of(t) for t in self.scenario.tracker}
        return Snapshot(
            self.tick, self.now, Status(), frozen(()), (), {}, features, self.scenario, notices=self.notices
        )

    def click(self, u: float, v: float, hit: str | None = None, camera: str = "left") -> None:
        self.composer.click(self.snapshot(), camera, (u, v), hit)
        self.later()

    def later(self, seconds: float = 0.1) -> None:
        self.tick += 1
        self.now += seconds
        self.composer.reconcile(self.snapshot())

    @property
    def added(self) -> list[c.AddTracker]:
        return [x for x in self.sent if isinstance(x, c.AddTracker)]


def feature_of(spec: TrackerSpec) -> Feature:
    at = frozen(spec.at or (0.0, 0.0))
    if spec.to is None:
        return Feature(at)
    segment = frozen([at, spec.to])
    return Feature(frozen(segment.mean(axis=0)), segment=segment)


# Lines that stick to an edge.


@pytest.mark.parametrize("kind", LINED, ids=lambda kind: kind.key)
def test_with_image_edge_two_clicks_make_one_line_tracker_and_it_stands_for_both_ends(kind) -> None:
    bench = Bench()
    bench.composer.edge = True
    bench.composer.arm(kind.key)
    clicks = [(40.0 + 60.0 * i, 100.0 + 7.0 * i) for i in range(len(kind.roles))]
    for click in clicks:
        assert not bench.scenario.constraint
        bench.click(*click)
    (made,) = bench.scenario.constraint
    specs = {t.name: t for t in bench.scenario.tracker}
    places = [end for name in made.points for end in (specs[name].at, specs[name].to) if end is not None]
    assert places == clicks
    lines = [t for t in bench.scenario.tracker if t.kind == "line"]
    assert len(lines) == len(kind.lines) and all(t.to is not None for t in lines)
    assert len(made.points) == len(kind.roles) - len(lines)


def test_nothing_is_asked_for_at_the_first_end_and_one_line_tracker_at_the_second() -> None:
    bench = Bench()
    bench.composer.edge = True
    bench.composer.arm("line_to_line")
    bench.click(10, 10)
    assert not bench.sent and bench.composer.prompt(("left",))[1].startswith("2 of 4")
    bench.click(11, 10)
    assert not bench.sent and "further apart" in bench.composer.note
    bench.click(90, 10)
    assert bench.sent == [c.AddTracker("left", (10.0, 10.0), "line", "L1", (90.0, 10.0))]


def test_a_refused_edge_steps_back_to_its_first_end_with_the_reason() -> None:
    bench = Bench(refuse={"L1": None})
    bench.composer.edge = True
    bench.composer.arm("point_to_line")
    bench.click(10, 10)
    bench.click(50, 10)
    bench.click(90, 10)
    assert "blank wall" in bench.composer.note
    assert bench.composer.points == 1 and bench.composer.first is None
    assert not bench.scenario.constraint
    bench.refuse = {}
    bench.click(50, 30)
    bench.click(90, 30)
    assert [k.points for k in bench.scenario.constraint] == [("T1", "L1")]


def test_a_click_on_a_line_uses_both_its_ends_and_a_line_is_no_point() -> None:
    bench = Bench()
    bench.submit(c.AddTracker("left", (5.0, 5.0), "line", "edge", (80.0, 5.0)))
    bench.composer.arm("point_to_line")
    bench.click(6, 5, hit="edge")
    assert bench.composer.points == 0 and "whole line" in bench.composer.note
    bench.click(30, 40)
    bench.click(6, 5, hit="edge")
    assert [k.points for k in bench.scenario.constraint] == [("T1", "edge")]


@settings(deadline=None)
@given(st.lists(
    st.sampled_from(["arm1", "arm2", "edge", "points", "left", "right", "line", "escape"]), max_size=30
))
def test_escape_leaves_no_stray_trackers_whatever_the_lines_are_made_of(steps: list[str]) -> None:
    bench = Bench()
    for index, step in enumerate([*steps, "escape"]):
        if step.startswith("arm"):
            bench.composer.arm(LINED[int(step[3])].key)
        elif step == "escape":
            bench.composer.put_away()
        elif step in ("edge", "points"):
            bench.composer.edge = step == "edge"
        elif bench.composer.composing:
            made = next((t.name for t in bench.scenario.tracker if t.to is not None), None)
            camera = step if step != "line" else "left"
            bench.click(7.0 * index, 50.0, hit=made if step == "line" else None, camera=camera)
    used = {p for k in bench.scenario.constraint for p in k.points}
    assert {t.name for t in bench.scenario.tracker} == used
    for made in bench.scenario.constraint:
        specs = {t.name: t for t in bench.scenario.tracker}
        cameras = {specs[p].camera for p in made.points}
        widths = [2 if specs[p].to is not None else 1 for p in made.points]
        assert len(cameras) == 1
        assert sum(widths) == len(next(kind for kind in KINDS if kind.key == made.kind).roles)


# Which tracker follows.


@pytest.mark.parametrize("kind", [k for k in TRACKER_KINDS if k != "line"])
def test_the_tracker_tool_places_the_kind_that_was_chosen(kind: str) -> None:
    bench = Bench()
    bench.composer.place = kind
    bench.composer.arm("tracker")
    bench.click(30, 40)
    assert [(x.kind, x.uv) for x in bench.added] == [(kind, (30.0, 40.0))]


def test_moving_features_and_goals_that_follow_take_the_chosen_kind_and_fixed_goals_stay_fixed() -> None:
    bench = Bench()
    bench.composer.follow = "marker"
    for goal in ("auto", "fixed"):
        bench.composer.goal = goal
        bench.composer.arm("point_to_point")
        bench.click(30, 40)
        bench.click(90, 40)
        bench.composer.put_away()
    assert [x.kind for x in bench.added] == ["marker", "marker", "marker", "fixed"]


def test_every_tracker_kind_has_a_sentence_and_a_new_one_shows_its_own_name() -> None:
    assert set(TRACKER_KINDS) <= set(FOLLOW)
    assert follow_label("hologram") == "hologram"


# A good place after a refusal.


def test_the_offered_place_is_one_click_away_and_the_constraint_goes_on_with_it() -> None:
    bench = Bench(refuse={"T1": (33.0, 44.0)})
    bench.composer.arm("point_to_point")
    bench.click(10, 10)
    hint = bench.composer.hint
    assert hint is not None and (hint.camera, hint.uv) == ("left", (33.0, 44.0))
    cell = arrange({"left": (640, 480), "right": (640, 480)}, 1.3).cells["left"]
    for camera in ("left", "right"):
        drawing = draw(camera, cell, bench.snapshot(), bench.composer, 1.0, {})
        assert any(tag.text == HINT_LABEL for tag in drawing.tags) == (camera == "left")
    bench.refuse = {}
    bench.composer.accept(bench.snapshot())
    bench.later()
    bench.click(90, 90)
    (made,) = bench.scenario.constraint
    assert {t.name: t.at for t in bench.scenario.tracker}[made.points[0]] == (33.0, 44.0)
    assert bench.composer.hint is None


def test_an_offer_is_gone_after_a_while_and_with_the_next_click() -> None:
    bench = Bench(refuse={"T1": (33.0, 44.0)})
    bench.composer.arm("tracker")
    bench.click(10, 10)
    assert bench.composer.hint is not None
    bench.later(60.0)
    assert bench.composer.hint is None
    bench.click(10, 10)
    assert bench.composer.hint is not None
    bench.refuse = {}
    bench.click(50, 50)
    assert bench.composer.hint is None


def test_a_marker_that_was_dropped_on_a_bad_spot_may_be_moved_to_the_offered_one() -> None:
    bench = Bench()
    bench.submit(c.AddTracker("right", (5.0, 5.0), "auto", "tip"))
    bench.later()
    better = c.MoveTracker("tip", (70.0, 80.0))
    bench.notices = (Notice(1, "warning", "tracker 'tip' in the right view: blank wall", better),)
    bench.later()
    assert bench.composer.hint is not None and bench.composer.hint.camera == "right"
    bench.composer.accept(bench.snapshot())
    assert bench.sent[-1] == better


def test_old_news_offers_nothing() -> None:
    """Somebody who opens the page is not shown what was refused an hour ago."""
    bench = Bench()
    bench.notices = (Notice(1, "warning", "blank", c.AddTracker("left", (1.0, 2.0))),)
    bench.later()
    assert bench.composer.hint is None


def test_the_runner_offers_the_same_command_at_the_nearest_good_place() -> None:
    asked = c.AddTracker("left", (10.0, 20.0), "line", "L1", (30.0, 20.0))
    assert _instead(asked, Untrackable("no", suggestion=(12.0, 25.0))) == replace(
        asked, uv=(12.0, 25.0), to=(32.0, 25.0)
    )
    assert _instead(c.MoveTracker("T1", (1.0, 2.0)), Untrackable("no", suggestion=(3, 4))) == c.MoveTracker(
        "T1", (3.0, 4.0)
    )
    assert _instead(asked, Untrackable("no")) is None
    assert _instead(asked, BadInput("no")) is None
    assert _instead(c.Undo(), Untrackable("no", suggestion=(3, 4))) is None


# The loupe.


@settings(deadline=None)
@given(PIXEL, st.sampled_from([(17, 13), (19, 13)]))
def test_the_loupe_shows_the_pixels_around_the_place_and_grey_beyond_the_picture(
    uv: tuple[float, float], size: tuple[int, int]
) -> None:
    """The oracle pads the whole picture and cuts by plain indexing."""
    frame = np.random.default_rng(1).integers(0, 255, (480, 640, 3), dtype=np.uint8)
    part, (u0, v0) = loupe.cut(frame, uv, *size)
    margin = 30
    padded = np.empty((480 + 2 * margin, 640 + 2 * margin, 3), np.uint8)
    padded[:] = loupe.NOTHING
    padded[margin:-margin, margin:-margin] = frame
    expected = padded[v0 + margin : v0 + margin + size[1], u0 + margin : u0 + margin + size[0]]
    assert np.array_equal(part, expected)
    assert abs(u0 + size[0] // 2 - uv[0]) <= 0.5 and abs(v0 + size[1] // 2 - uv[1]) <= 0.5


@settings(deadline=None)
@given(PIXEL)
def test_the_cross_hair_of_the_loupe_stands_at_the_place_to_a_part_of_a_pixel(
    uv: tuple[float, float],
) -> None:
    """Found in the enlarged picture by its colour; a grey picture has no red."""
    frame = np.full((480, 640, 3), 128, np.uint8)
    big = loupe.enlarged(frame, uv).astype(int)
    red = np.abs(big - RED).max(axis=2) < 3
    across, down = red.sum(axis=0), red.sum(axis=1)
    column, row = np.flatnonzero(across == across.max()).mean(), np.flatnonzero(down == down.max()).mean()
    _, (u0, v0) = loupe.cut(frame, uv, loupe.COLUMNS, loupe.ROWS)
    seen = (column + 0.5) / loupe.ZOOM - 0.5 + u0, (row + 0.5) / loupe.ZOOM - 0.5 + v0
    assert np.abs(np.array(seen) - uv).max() <= 0.51 / loupe.ZOOM


def test_the_card_of_a_tracker_says_how_it_follows_how_well_and_exactly_where() -> None:
    spec = TrackerSpec("<b>tip", "left", "auto", (100.0, 50.0))
    region = frozen([[90, 40], [110, 40], [110, 60], [90, 60]])
    feature = Feature(frozen([100.25, 50.5]), score=0.82, corners=region, detail="patch 43 px")
    frame = np.zeros((480, 640, 3), np.uint8)
    snapshot = Snapshot(
        1, 0.0, Status(), frozen(()), (), {"left": frame}, {spec.name: feature},
        replace(two_cameras(), tracker=(spec,)),
    )
    html = selected_card(snapshot, spec.name)
    assert "Automatic: patch 43 px" in html and "82 %" in html and "100.25, 50.50" in html
    assert "<b>tip" not in html and "&lt;b&gt;tip" in html
    circle = re.search(r'<circle cx="([\d.]+)" cy="([\d.]+)"', html)
    assert circle is not None and tuple(map(float, circle.groups())) == (100.25, 50.5)
    assert "<polygon" in html and selected_card(snapshot, "nobody") == ""
    lost = replace(feature, status="lost", detail="covered")
    html = selected_card(replace(snapshot, features={spec.name: lost}), spec.name)
    assert "Lost: covered." in html and "drag it onto its feature" in html


@pytest.mark.parametrize("text", [None, "", "a b", "1", "0.5 nan", "0.5 1.5", "-1 0", "0.1 0.2 0.3", "{}"])
def test_what_a_browser_says_of_its_pointer_is_checked(text: str | None) -> None:
    assert pointer.place_of(text) is None
    assert pointer.place_of("0.25 1.0") == (0.25, 1.0)


# Trails and quality.


def run_by(
    trails: Trails, places: list[tuple[float, float, float]], kind: str = "auto", ok: bool = True
) -> Snapshot:
    """A tracker passes `places`, each a stamp [s] and a pixel; returns the last snapshot."""
    snapshot = None
    for stamp, u, v in places:
        spec = TrackerSpec("T1", "left", kind, (u, v))
        feature = Feature(frozen([u, v]), "ok" if ok else "lost")
        snapshot = Snapshot(
            1, stamp, Status(), frozen(()), (), {}, {"T1": feature}, replace(two_cameras(), tracker=(spec,))
        )
        trails.add(snapshot)
    assert snapshot is not None
    return snapshot


def test_a_trail_holds_the_last_two_seconds_of_a_tracker_that_moves_and_nothing_else() -> None:
    path = [(0.1 * i, 100.0 + 3 * i, 50.0) for i in range(60)]
    trails = Trails()
    run_by(trails, path)
    trail = trails.of("T1")
    assert np.allclose(trail, [p[1:] for p in path if p[0] >= path[-1][0] - SPAN_S - 1e-9])
    for kind, ok in (("fixed", True), ("auto", False)):
        quiet = Trails()
        run_by(quiet, path, kind, ok)
        assert len(quiet.of("T1")) == 0
    resting = Trails()
    run_by(resting, [(0.1 * i, 100.0 + 0.01 * i, 50.0) for i in range(20)])
    assert len(resting.of("T1")) == 0 and len(resting.of("nobody")) == 0


def test_a_trail_begins_anew_where_somebody_puts_the_tracker_or_time_starts_again() -> None:
    path = [(0.1 * i, 100.0 + 3 * i, 50.0) for i in range(10)]
    for jump in ((1.0, 127.0 + 2 * JUMP_PX, 50.0), (0.0, 130.0, 50.0)):
        trails = Trails()
        run_by(trails, [*path, jump, (jump[0] + 0.1, jump[1] + 5.0, 50.0)])
        assert np.allclose(trails.of("T1"), [jump[1:], (jump[1] + 5.0, 50.0)])


def test_a_trail_is_drawn_behind_the_tracker_and_fades() -> None:
    trails = Trails()
    snapshot = run_by(trails, [(0.1 * i, 100.0 + 8 * i, 50.0) for i in range(15)])
    cell = arrange({"left": (640, 480)}, 1.3).cells["left"]
    composer = Composer(lambda command: None)
    with_trail = draw("left", cell, snapshot, composer, 1.0, {}, trails).thin.arrays(cell, 0.0)[0]
    lengths = np.linalg.norm(with_trail[:, 1] - with_trail[:, 0], axis=1)[:14]
    assert with_trail.shape[0] == 14 and np.all(np.diff(lengths) > 0)
    assert draw("left", cell, snapshot, composer, 1.0, {}).thin.arrays(cell, 0.0)[0].shape[0] == 1


@settings(deadline=None)
@given(st.floats(0, 1), st.floats(0, 1))
def test_quality_goes_from_red_over_amber_to_green(a: float, b: float) -> None:
    low, high = sorted((a, b))
    assert quality(low)[0] >= quality(high)[0] - 1  # never less green for a better score
    assert quality(1.0) == GREEN and quality(0.0) == RED and quality(0.6) == AMBER
    assert quality(float("nan")) == RED


def test_a_lost_tracker_says_why_and_what_to_do_in_its_row() -> None:
    spec = TrackerSpec("T1", "left", "patch", (10.0, 20.0))
    snapshot = Snapshot(
        1, 0.0, Status(), frozen(()), (), {},
        {"T1": Feature(frozen([10.0, 20.0]), "lost", 0.1, detail="covered, or changed too much")},
        replace(two_cameras(), tracker=(spec,)),
    )
    html = lists.trackers(snapshot, None, lambda index, name: ("a", "b"))
    assert "T1 lost: covered, or changed too much." in html
    assert "looks for itself" in html and "delete it" in html and 'class="quality"' not in html
    seen = replace(snapshot, features={"T1": Feature(frozen([10.0, 20.0]), score=0.5)})
    html = lists.trackers(seen, None, lambda index, name: ("a", "b"))
    assert 'style="width:50%' in html and "lost" not in html


# Lines in the hand.


def test_a_line_is_taken_by_the_end_that_is_near_else_as_a_whole() -> None:
    line = np.array([[100.0, 100.0], [200.0, 100.0]])
    assert _nearest(line, (103.0, 104.0), 10.0) == (5.0, 0)
    assert _nearest(line, (195.0, 100.0), 10.0) == (5.0, 1)
    assert _nearest(line, (150.0, 107.0), 10.0) == (7.0, None)
    assert _nearest(line, (250.0, 100.0), 10.0) == (50.0, None)
    assert _nearest(line[:1], (100.0, 103.0), 10.0) == (3.0, None)


@settings(deadline=None)
@given(PIXEL, PIXEL, PIXEL, st.sampled_from([None, 0, 1]))
def test_a_dragged_line_keeps_its_other_end_or_its_direction_and_length(
    a: tuple[float, float], b: tuple[float, float], to: tuple[float, float], end: int | None
) -> None:
    grab = _Grab("L1", "left", (0.0, 0.0), (0.0, 0.0), np.array([a, b]), end)
    moved = grab.at(to)
    if end is None:
        assert np.allclose(moved.mean(axis=0), to) and np.allclose(moved[1] - moved[0], np.subtract(b, a))
    else:
        assert np.allclose(moved[end], to) and np.allclose(moved[1 - end], (a, b)[1 - end])


def test_a_goal_that_is_a_line_tracker_is_drawn_as_a_line_with_both_ends() -> None:
    bench = Bench()
    bench.composer.edge = True
    bench.composer.arm("point_to_line")
    for click in ((50.0, 60.0), (100.0, 100.0), (300.0, 150.0)):
        bench.click(*click)
    cell = arrange({"left": (640, 480)}, 1.3).cells["left"]
    drawing = draw("left", cell, bench.snapshot(), bench.composer, 1.0, {})
    points = drawing.bold.arrays(cell, 0.0)[0][..., :2] / cell.scale - 0.5
    ends = np.array([[100.0, 100.0], [300.0, 150.0]])
    assert any(np.allclose(segment, ends, atol=1e-3) for segment in points)
    assert [t.kind for t in drawing.tags if t.text == "L1"] == ["goal"]
    assert [t.kind for t in drawing.tags if t.text == "T1"] == ["name"]
