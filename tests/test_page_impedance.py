"""The page of the stereo-impedance mode, without a browser."""

from __future__ import annotations

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from browser import wait_for
from fake_following import PLACES, FakeFollowing, a_snapshot, a_view, placed, stereo_scene, turned
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vita import commands as c
from vita.errors import NotNow
from vita.impedance.config import ImpedanceConfig
from vita.impedance.view import Capsule
from vita.snapshot import Snapshot
from vita.types import MOVING_STATES, Status, frozen
from vita.ui import App, shells
from vita.ui.compose import SELECT, Composer
from vita.ui.dragging import FOLLOW_S, PERIOD_S, Grip, Mover, inside, movable
from vita.ui.forces3d import LONGEST_M, MASS_M, METRES_PER_NEWTON, Forces3D, arrows, learned_cameras
from vita.ui.impedance_words import FORCE, FORCES, LEAST_N, explain, rows
from vita.ui.layout import arrange
from vita.ui.mode import IMPEDANCE, UVS, TwoFaced
from vita.ui.overlay import draw
from vita.ui.panels.impedance import GROUPS, SWITCHES, TuningPanel, figures, force_bars
from vita.ui.panels.mode_switch import ModeSwitch
from vita.ui.recovered import Known, difference_sample, position_sample
from vita.ui.world3d import World3D

number = st.floats(-1.0, 1.0)
vector = st.tuples(number, number, number).map(np.array)
config = ImpedanceConfig()


# Forces and what is learned, in 3D.


@settings(deadline=None)
@given(st.dictionaries(st.sampled_from([force.key for force in FORCES]), vector), st.floats(0.01, 40.0))
def test_an_arrow_points_along_its_force_and_is_as_long_as_it_is_strong_up_to_the_longest(
    directions: dict[str, np.ndarray], size: float
) -> None:
    pulls = {key: frozen(size * v) for key, v in directions.items()}
    view = a_view(forces=pulls)
    points, colors = arrows(view)
    acting = [force for force in FORCES if np.linalg.norm(pulls.get(force.key, np.zeros(3))) >= LEAST_N]
    assert len(points) == len(acting)
    for force, (start, end), color in zip(acting, points, colors, strict=True):
        pull = pulls[force.key]
        length = np.linalg.norm(end - start)
        ball = np.asarray(view.T_base_mass)[:3, 3]
        assert np.allclose(start - ball, MASS_M * pull / np.linalg.norm(pull))
        assert np.isclose(length, min(METRES_PER_NEWTON * np.linalg.norm(pull), LONGEST_M))
        assert np.allclose((end - start) / length, pull / np.linalg.norm(pull))
        assert tuple(color) == force.color


def test_every_kind_of_force_has_a_colour_of_its_own() -> None:
    assert len({force.color for force in FORCES}) == len(FORCES)


@settings(deadline=None, max_examples=30)
@given(vector, st.floats(-180.0, 180.0))
def test_the_learned_right_camera_stands_beside_the_learned_left_one_as_on_the_tripod(
    place: np.ndarray, turn: float
) -> None:
    snapshot = a_snapshot(a_view(T_base_left=placed(place, turned(2, turn))))
    found = learned_cameras(snapshot.impedance, config, snapshot.poses)
    assert np.allclose(found["left"], placed(place, turned(2, turn)))
    true = np.linalg.inv(snapshot.poses["camera:left"]) @ snapshot.poses["camera:right"]
    assert np.allclose(np.linalg.inv(found["left"]) @ found["right"], true)
    assert not learned_cameras(a_view(T_base_left=None), config, snapshot.poses)


@settings(deadline=None, max_examples=40)
@given(st.floats(0.0, 2.0), st.floats(0.05, 0.5), vector, vector)
def test_a_shell_lies_all_around_its_segment_at_the_same_distance(
    length: float, radius: float, start: np.ndarray, direction: np.ndarray
) -> None:
    assume(np.linalg.norm(direction) > 0.1)
    end = start + length * direction / np.linalg.norm(direction)
    vertices, faces = shells.capsule(length, radius)
    T = shells.along(start, end)
    assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3)) and np.linalg.det(T[:3, :3]) > 0
    points = vertices @ T[:3, :3].T + T[:3, 3]
    share = np.clip((points - start) @ (end - start) / max(length**2, 1e-12), 0.0, 1.0)
    apart = np.linalg.norm(points - start - share[:, None] * (end - start), axis=1)
    assert np.allclose(apart, radius, atol=1e-5)
    a, b, c = vertices[faces].astype(float).transpose(1, 0, 2)
    outward = np.cross(b - a, c - a)
    middle = (a + b + c) / 3 - [0.0, 0.0, length / 2]
    assert ((outward * middle).sum(axis=1) >= -1e-9).all()


class Scene:
    """Takes the place of viser's scene: remembers what was made, and how."""

    def __init__(self) -> None:
        self.made: dict[str, Any] = {}

    def __getattr__(self, kind: str) -> Any:
        def add(name: str, *args: Any, **props: Any) -> Any:
            node = SimpleNamespace(**{"visible": True} | props, name=name, kind=kind, args=args)
            node.remove = lambda: self.made.pop(name)
            self.made[name] = node
            return node

        return add

    def shown(self) -> set[str]:
        return {name.removeprefix("/f/") for name, node in self.made.items() if node.visible}


def drawn(snapshot: Snapshot, scale: float = 200.0) -> Scene:
    scene = Scene()
    forces = Forces3D(scene, labels=False)  # type: ignore[arg-type]
    forces.build("/f", scale)
    forces.update(snapshot)
    return scene


def test_everything_of_the_mode_is_in_3d_at_its_place_and_gone_in_the_other_mode() -> None:
    scene, snapshot = Scene(), a_snapshot()
    forces = Forces3D(scene, labels=True)  # type: ignore[arg-type]
    forces.build("/f", 200.0)
    forces.update(replace(snapshot, scenario=stereo_scene("uvs")))
    assert not scene.made  # nothing was needed yet
    forces.update(snapshot)
    everything = {
        "goal", "mass", "mass axes", "forces", "target", "tool by joints", "tool by cameras", "camera left",
        "camera right", "shell near 0",
    }
    assert everything <= scene.shown()
    for key, pose in (
        ("mass", snapshot.impedance.T_base_mass), ("goal", snapshot.impedance.T_base_goal),
        ("target", snapshot.impedance.T_base_target), ("camera left", snapshot.impedance.T_base_left),
    ):
        node = scene.made[f"/f/{key}"]
        assert pose is not None and np.allclose(node.position, 200.0 * pose[:3, 3])
        turn = Rotation.from_quat(node.wxyz, scalar_first=True).as_matrix()
        assert np.allclose(turn, pose[:3, :3], atol=1e-6)
    forces.update(snapshot, shown=False)
    assert not scene.shown() & everything
    forces.update(snapshot)
    assert everything <= scene.shown()
    forces.update(replace(snapshot, scenario=stereo_scene("uvs")))
    assert not scene.shown() & everything


def test_a_body_is_wrapped_as_far_as_it_pushes_and_only_while_it_does() -> None:
    view = a_view()
    (part,) = view.obstacles
    shell = drawn(a_snapshot(view)).made["/f/shell near 0"]
    across = np.abs(np.asarray(shell.args[0])[:, 0]).max()
    assert np.isclose(across, part.radius + config.people_m, atol=1e-5)
    assert 0.0 < shell.opacity < 0.5
    calm = replace(view, forces={"target": view.forces["target"]})
    assert not any("shell" in name for name in drawn(a_snapshot(calm)).made)
    pushed = replace(view, forces={"table": frozen([0, 0, 3.0]), "base": frozen([2.0, 0, 0])})
    far = Capsule("human", frozen([2.0, 0.7, 0.2]), frozen([2.0, 0.7, 1.1]), 0.12)
    both = drawn(a_snapshot(replace(view, obstacles=(far, part)))).made
    assert "/f/shell near 1" in both and "/f/shell near 0" not in both  # the one that pushes
    made = drawn(a_snapshot(pushed)).made
    height = made["/f/shell table"].position[2] / 200.0
    assert np.isclose(height, config.table_z + config.table_m)
    assert np.isclose(np.hypot(*made["/f/shell base"].args[0][0, :2]), config.base_m)


def test_an_obstacle_that_nobody_drew_is_drawn_as_the_arm_knows_it() -> None:
    stranger = Capsule("scanner 3", frozen([0.3, 0.0, 0.2]), frozen([0.3, 0.0, 0.5]), 0.1)
    made = drawn(a_snapshot(a_view(obstacles=(stranger,), forces={}))).made
    assert "/f/shell body 0" in made
    known = a_view(forces={})
    assert "/f/shell body 0" not in drawn(a_snapshot(known)).made


def test_a_learned_camera_that_stands_elsewhere_is_named() -> None:
    scene = Scene()
    forces = Forces3D(scene, labels=True)  # type: ignore[arg-type]
    forces.build("/f", 200.0)

    def words() -> set[str]:
        return {n.args[0] for n in scene.made.values() if n.kind == "add_label" and n.visible}

    forces.update(a_snapshot())
    assert "left, as learned" not in words()
    astray = np.asarray(a_view().T_base_left) @ placed((0.1, 0, 0))
    forces.update(a_snapshot(a_view(T_base_left=astray)))
    assert {"left, as learned", "right, as learned"} <= words()


# Moving things with the mouse.

EYES = st.tuples(st.floats(1.5, 3.0), st.floats(-3.0, -1.5), st.floats(0.8, 2.0)).map(np.array)


@settings(deadline=None)
@given(EYES, vector, st.tuples(number, number).map(np.array), st.booleans())
def test_a_thing_stays_under_the_pointer_in_its_plane(
    eye: np.ndarray, touch: np.ndarray, move: np.ndarray, upright: bool
) -> None:
    """Oracle: the touched point is moved first, and then looked at."""
    origin, point = np.array([0.5, 0.1, 0.3]), np.array([0.5, 0.1, 0.3]) + 0.1 * touch
    moved = np.array([0.0, 0.0, 0.4 * move[0]]) if upright else np.array([*(0.4 * move), 0.0])
    found = Grip("target", origin, point, upright).at(eye, eye + 0.7 * (point + moved - eye))
    assert found is not None and np.allclose(found, inside(origin + moved), atol=1e-9)


def test_a_level_glance_does_not_throw_a_thing_out_of_the_room() -> None:
    grip = Grip("target", np.zeros(3), np.zeros(3))
    eye = np.array([2.0, 0.0, 1.0])
    assert grip.at(eye, eye + [-1.0, 0.0, 0.0]) is None  # along the plane
    assert grip.at(eye, eye + [-1.0, 0.0, 0.1]) is None  # away from it
    assert grip.at(eye, eye + [-1.0, 0.0, -0.01]) is None  # onto it, a hundred metres away
    assert np.abs(inside(np.array([9.0, -9.0, 9.0]))).max() <= 3.0


@settings(deadline=None, max_examples=30)
@given(vector, st.floats(-180.0, 180.0), st.floats(50.0, 1000.0), vector)
def test_a_place_on_the_board_is_found_again_in_the_scene(
    at: np.ndarray, turn: float, scale: float, place: np.ndarray
) -> None:
    world = World3D(Scene(), "/w", scale)  # type: ignore[arg-type]
    rotation = turned(0, 40.0) @ turned(2, turn)
    world.place(list(500.0 * at), rotation, True)
    assert np.allclose(world.metres(list(500.0 * at + rotation @ (scale * place))), place, atol=1e-9)


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def a_mover(snapshot: Snapshot | None = None) -> tuple[Mover, list[Any], Clock]:
    sent: list[Any] = []
    clock = Clock()
    return Mover(sent.append, lambda: snapshot or a_snapshot(), clock), sent, clock


def test_drags_are_thinned_out_and_the_last_place_always_counts() -> None:
    mover, sent, clock = a_mover()
    grip = mover.take("target", np.array(PLACES["target"]), upright=False)
    eye = np.array([2.0, -1.5, 1.5])
    for step in range(101):
        clock.now = 0.01 * step
        aim = np.array(PLACES["target"]) + [0.001 * step, 0.0, 0.0]
        mover.drag(grip, eye, aim, last=step == 100)
    assert 1.0 / PERIOD_S - 5 <= len(sent) <= 1.0 / PERIOD_S + 2
    assert all(cmd.action == "drag_target" and cmd.arguments["over_s"] == FOLLOW_S for cmd in sent)
    assert np.allclose(sent[-1].arguments["xyz"], np.array(PLACES["target"]) + [0.1, 0.0, 0.0], atol=1e-4)
    assert "rpy_deg" not in sent[-1].arguments  # it keeps its orientation
    assert mover.selected == "target"


def test_presses_add_up_before_the_scene_has_answered() -> None:
    """Oracle: one turn by the sum; the snapshot never changes."""
    mover, sent, clock = a_mover()
    mover.turn_by("tripod", 0, 20.0)
    for _ in range(3):
        clock.now += 0.2
        mover.turn_by("tripod", 2, 10.0)
    mover.turn_by("tripod", 1, 15.0)
    mover.raise_by("tripod", 0.05)
    turn = Rotation.from_euler("xyz", sent[-2].arguments["rpy_deg"], degrees=True).as_matrix()
    assert np.allclose(turn, turned(2, 30.0) @ turned(0, 20.0) @ turned(1, 15.0), atol=1e-5)
    assert np.allclose(sent[-1].arguments["xyz"], np.array(PLACES["tripod"]) + [0, 0, 0.05])
    clock.now += 10.0
    mover.raise_by("tripod", 0.05)  # long after: from where it stands
    assert np.allclose(sent[-1].arguments["xyz"], np.array(PLACES["tripod"]) + [0, 0, 0.05])


def test_only_loose_things_can_be_moved_and_only_in_this_mode() -> None:
    assert movable(a_snapshot()) == ("target", "human", "tripod")  # not the card that the tool carries
    assert movable(a_snapshot(scenario=stereo_scene("uvs"))) == ()
    mover, sent, _ = a_mover(a_snapshot(scenario=stereo_scene("uvs")))
    with pytest.raises(Exception, match="target"):
        mover.take("target", np.zeros(3), upright=False)
    assert not sent and mover.selected is None


# Words and figures.


def said(state: str, reason: str = "", **changes: Any) -> str:
    return explain(a_snapshot(a_view(**changes), Status(state, reason)))  # type: ignore[arg-type]


def without(*hidden: tuple[str, str]) -> dict[tuple[str, str], np.ndarray]:
    return {key: corners for key, corners in a_view().corners.items() if key not in hidden}


def test_each_phase_says_what_goes_on_and_what_to_do() -> None:
    assert said("servoing") == "Following the target: 12 mm, 0.8 deg."
    assert said("servoing", error_mm=2.31, error_deg=np.nan) == "Following the target: 2.3 mm."
    blind = said("servoing", corners=without(("left", "tool"), ("right", "tool")))
    assert "Marker 7 on the tool is not seen by the cameras left and right" in blind
    held = explain(a_snapshot(status=Status("servoing"), progress="held off by the table"))
    assert held == "Following the target: 12 mm, 0.8 deg; held off by the table."
    learning = said("learning", phase="calibrating")
    assert learning == "Learning where the cameras stand: 14 pairs, 2.1 mm."
    assert said("learning", "cameras_moved", phase="calibrating").startswith("Cameras moved: learning again")
    assert said("learning", "cameras_moved", phase="looking").startswith("Cameras moved: ")
    waiting = said("servoing", phase="waiting", corners=without(("left", "target")))
    assert "not seen by the left camera" in waiting and "Move the tripod or the target" in waiting
    looking = said("learning", phase="looking", corners=without(("left", "tool"), ("right", "tool")))
    assert "marker 7" in looking and "the cameras left and right" in looking
    looking = said("learning", phase="looking", corners=without(("right", "target")))
    assert "hold marker 5 so that both cameras see it" in looking
    assert "Marker 7" in said("idle", phase="idle", corners=without(("right", "tool")))
    assert "learn where the cameras stand" in said("idle", phase="idle", T_base_left=None)


STATES = "offline", "idle", "learning", "servoing", "hold", "done", "fault", "estop"


@pytest.mark.parametrize("state", STATES)
def test_no_state_is_left_without_a_word_and_a_reason_is_passed_on(state: str) -> None:
    assert said(state)
    told = explain(a_snapshot(status=Status(state, "why", "Because of that.")))  # type: ignore[arg-type]
    assert (told == "Because of that.") == (state not in MOVING_STATES)


@settings(deadline=None)
@given(
    st.sampled_from(["table", "base", "people", "singularity"]),
    st.tuples(st.floats(0.0, 100.0), st.floats(0.0, 100.0)),
)
def test_a_bar_is_never_longer_for_what_is_nearer(key: str, both: tuple[float, float]) -> None:
    near, far = sorted(both)

    def bar(distance: float) -> float:
        shown = rows(a_view(distances={key: distance}), config)
        return next(row.share for row in shown if row.force.key == key)

    assert 0.0 <= bar(near) <= bar(far) <= 1.0


def test_rows_say_who_pushes_how_hard_and_who_is_too_near() -> None:
    shown = {row.force.key: row for row in rows(a_view(), config)}
    assert shown["target"].word == "pulls 9.0 N" and shown["target"].value == "12 mm"
    assert (shown["people"].level, shown["people"].word) == ("warning", "pushes 4.1 N")
    assert (shown["table"].level, shown["table"].word) == ("good", "free")
    close = rows(a_view(distances={"people": 0.5 * config.stop_m}), config)
    assert next(row.level for row in close if row.force.key == "people") == "bad"
    off = rows(a_view(), replace(config, table_m=0.0))
    assert next(row.word for row in off if row.force.key == "table") == "switched off"
    nobody = rows(a_view(distances={}), config)
    assert next(row.word for row in nobody if row.force.key == "people") == "nobody near"
    html = force_bars(tuple(shown.values()))
    assert html.count('class="gauge"') == len(FORCES)
    assert all(f"background:#{r:02x}{g:02x}{b:02x}" in html for r, g, b in (f.color for f in FORCES))


def test_what_is_not_known_is_said_and_not_shown_as_a_number() -> None:
    new = a_view(phase="idle", T_base_left=None, pairs=0, error_mm=np.nan, error_deg=np.nan)
    blank = figures(new, config)
    assert "nan" not in blank and "not learned yet" in blank and 'class="now"' not in blank
    gone = without(("left", "target"), ("right", "target"))
    lost = figures(a_view(phase="waiting", corners=gone, target_age_s=1.26), config)
    assert "not seen, last 1.3 s ago" in lost
    half = figures(a_view(corners=without(("right", "target"))), config)
    assert "seen by the left camera only" in half
    assert "inf" not in figures(a_view(corners={}, target_age_s=np.inf), config)


# Pictures and plots.


def overlay(snapshot: Snapshot, camera: str) -> Any:
    cell = arrange({"left": (640, 480), "right": (640, 480)}, 1.3).cells["left"]
    return draw(camera, cell, snapshot, Composer(lambda command: None), 1.0, {}), cell


def test_markers_are_outlined_where_they_are_seen_and_missed_where_they_are_not() -> None:
    snapshot = a_snapshot(a_view(corners=without(("left", "tool"))))
    drawing, cell = overlay(snapshot, "left")
    points, _ = drawing.bold.arrays(cell, 0.0)
    corners = np.asarray(snapshot.impedance.corners["left", "target"])
    pixels = points[:4, 0, :2] / cell.scale - 0.5
    assert np.allclose(pixels, corners, atol=1e-3)
    assert {tag.text for tag in drawing.tags} == {"target 5", "tool 7 not seen"}
    drawing, _ = overlay(snapshot, "right")
    assert {tag.text for tag in drawing.tags} == {"target 5", "tool 7"}
    drawing, _ = overlay(snapshot, "overview")  # a camera of which this mode makes no use
    assert not drawing.tags and drawing.bold.empty


def test_the_plots_are_those_of_figure_7() -> None:
    view = a_view()
    assert view.tool_fk is not None and view.tool_seen is not None
    sample = position_sample(a_snapshot(view))
    assert np.allclose(sample, 1e3 * np.array([*view.tool_fk, *view.tool_seen]))
    apart = 1e3 * (view.tool_seen - view.tool_fk)
    assert np.allclose(difference_sample(a_snapshot(view)), [np.linalg.norm(apart), *apart])
    unknown = difference_sample(a_snapshot(replace(view, tool_seen=None)))
    assert np.isnan(unknown).all()


# The page as a whole, without anybody who looks.


@pytest.fixture(scope="module")
def app() -> Any:
    runner = FakeFollowing()
    app = App(runner, port=0)
    try:
        yield app
    finally:
        app.close()
        runner.close()


def test_what_was_never_measured_is_not_plotted_as_zero(app: App) -> None:
    plot = Known(app.server.gui, app.recovered.tabs[0], "mm", "Nothing yet.")
    series = ("a", (1, 2, 3)), ("b", (4, 5, 6))
    plot.feed(1.0, series, np.array([np.nan, np.nan]))
    plot.draw()
    assert plot._note._handle.visible and plot._plot._handle is None
    plot.feed(2.0, series, np.array([3.0, np.nan]))
    plot.draw()
    assert not plot._note._handle.visible and plot._plot._handle is not None
    assert len(plot._plot._handle.data) == 2 and plot._plot._handle.data[1][-1] == 3.0
    plot.feed(3.0, series, np.array([np.nan, 5.0]))
    plot.draw()
    assert plot._plot._handle is not None and len(plot._plot._handle.data) == 3


def test_every_setting_has_its_slider_and_a_change_becomes_a_command(app: App) -> None:
    panel = next(p for p in app.panels if isinstance(p, TuningPanel))
    tunable = {f.name for f in fields(ImpedanceConfig) if f.metadata}
    shown = [name for group, name in panel._numbers.inputs if group == "impedance"]
    assert sorted(shown) == sorted(tunable)
    assert {name for names in GROUPS.values() for name in names} <= tunable
    assert set(panel._switches) == {name for name, _, _ in SWITCHES.values()}
    for (group, name), handle in panel._numbers.inputs.items():
        if group == "impedance":
            assert handle.value == getattr(config, name)
            assert handle.min <= getattr(config, name) <= handle.max
    runner: Any = app.runner
    runner.submit(c.SetImpedance("stiffness", 250.0))
    wait_for(lambda: runner.snapshot().scenario.impedance.stiffness == 250.0, "the setting")
    panel.update(runner.snapshot())
    assert panel._numbers.inputs["impedance", "stiffness"].value == 250.0


def test_tabs_of_the_two_modes(app: App) -> None:
    def labels() -> list[tuple[str, ...]]:
        return [tabs._panel._tab_labels for tabs in app._tabs]

    first = [tab for tab in app._tabs[0]._tabs[UVS] if isinstance(tab, TwoFaced)]
    assert labels() == [
        ("Stereo", "Tuning", "Files", "View", "Faults"), ("Error", "Position", "Difference", "Joints")
    ]
    assert all(tab.face(IMPEDANCE).visible and not tab.face(UVS).visible for tab in first)
    app._show_tabs(a_snapshot(scenario=stereo_scene("uvs")))
    assert labels() == [("Task", "Servo", "Files", "View", "Faults"), ("Error", "Joints", "Knowledge")]
    assert all(tab.face(UVS).visible and not tab.face(IMPEDANCE).visible for tab in first)
    app._show_tabs(a_snapshot())
    assert labels()[0][0] == "Stereo"


def test_the_mode_is_not_changed_while_the_arm_moves_nor_into_itself(app: App) -> None:
    switch = next(v for v in vars(app.run).values() if isinstance(v, ModeSwitch))
    runner: Any = app.runner
    runner.log.clear()
    runner.submit(c.Start())
    wait_for(lambda: runner.snapshot().status.state == "servoing", "motion")
    with pytest.raises(NotNow, match="Stop the arm first"):
        switch.choose(UVS)
    switch.update(runner.snapshot())
    assert all(button.disabled for button in switch._buttons.values())
    app.run.stop()
    wait_for(lambda: runner.snapshot().status.state == "hold", "rest")
    switch.choose(IMPEDANCE)
    switch.choose(UVS)
    wait_for(lambda: runner.snapshot().scenario.mode == UVS, "the other mode")
    switch.choose(IMPEDANCE)
    wait_for(lambda: runner.snapshot().scenario.mode == IMPEDANCE, "the mode")
    asked = [cmd.mode for cmd in runner.log if isinstance(cmd, c.SetMode)]
    assert asked == [UVS, IMPEDANCE]


def test_nothing_is_composed_in_this_mode() -> None:
    sent: list[object] = []
    composer = Composer(sent.append)
    composer.arm("point_to_point")
    composer.reconcile(a_snapshot())
    assert composer.tool == SELECT  # what was in hand is put away
    composer.arm("point_to_point")
    composer.click(a_snapshot(), "left", (100.0, 100.0), None)
    assert composer.tool == SELECT and not sent
    composer.reconcile(a_snapshot(scenario=stereo_scene("uvs")))
    composer.arm("point_to_point")
    assert composer.tool == "point_to_point"


def test_the_force_words_name_all_that_the_view_may_hold() -> None:
    assert set(FORCE) == {"target", "table", "base", "singularity", "people"}
