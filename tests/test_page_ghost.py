"""The ghost of the next step, without a browser: on the images and as a second arm."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from fake_runner import two_cameras
from hypothesis import given, settings
from hypothesis import strategies as st
from known import task

from vita.scenario.schema import TrackerSpec
from vita.snapshot import Snapshot
from vita.types import Feature, Status, Visual, frozen
from vita.ui import words as w
from vita.ui.compose import Composer
from vita.ui.ghost import APPEAR_PX, GHOST, POINTER_PX, RIM_PX, VANISH_PX, Ghosts
from vita.ui.ghost_arm import GhostArm
from vita.ui.layout import arrange
from vita.ui.mesh import Mesh
from vita.ui.overlay import draw


def ghost_points(snapshot: Snapshot, camera: str = "left", ghosts: Ghosts | None = None) -> np.ndarray:
    """(k, 2) pixels of all ghost strokes of a view; empty without any."""
    cell = arrange({"left": (640, 480), "right": (640, 480)}, 1.3).cells[camera]
    steps = (ghosts or Ghosts()).update(snapshot)
    drawing = draw(camera, cell, snapshot, Composer(lambda command: None), 1.0, {}, ghosts=steps)
    if drawing.ghost.empty:
        return np.zeros((0, 2))
    points, _ = drawing.ghost.arrays(cell, -1.0)
    return points[..., :2].reshape(-1, 2) / cell.scale - 0.5


PIXEL = st.tuples(st.floats(40, 600), st.floats(40, 440))


@settings(deadline=None)
@given(PIXEL, st.floats(0.0, 1.4) | st.floats(1.6, 13.9) | st.floats(14.1, 300.0), st.floats(0.0, 6.3))
def test_the_ghost_is_a_ring_where_the_feature_will_be_and_an_arrow_from_it(
    here: tuple[float, float], length: float, direction: float
) -> None:
    along = np.array([np.cos(direction), np.sin(direction)])
    there = tuple(np.array(here) + length * along)
    points = ghost_points(task(there, here))
    assert (len(points) > 0) == (length >= APPEAR_PX)
    if not len(points):
        return
    forward, aside = (points - here) @ along, (points - here) @ (-along[1], along[0])
    if length < RIM_PX:  # the marker would hide it: a pointer at its rim, straight the way that it goes
        assert forward.min() > RIM_PX - 1e-2 and abs(forward.max() - RIM_PX - POINTER_PX) < 1e-2
        assert abs(aside.min() + aside.max()) < 1e-2
        return
    ring = points[np.abs(np.linalg.norm(points - there, axis=1) - 7.0) < 1e-3]
    assert len(ring) >= 20
    assert np.linalg.norm(ring[:20].mean(axis=0) - there) < 0.7  # float32 on the board
    assert np.linalg.norm(points - here, axis=1).min() < 1e-2  # the arrow starts at the feature
    assert forward.min() > -1e-2 and forward.max() < length + 7.01


def test_a_ghost_is_drawn_in_its_own_view_only_and_vanishes_with_its_prediction() -> None:
    ghosts = Ghosts()
    assert len(ghost_points(task((240.0, 200.0)), ghosts=ghosts))
    assert not len(ghost_points(task((240.0, 200.0)), camera="right", ghosts=ghosts))
    assert not len(ghost_points(task(), ghosts=ghosts))
    lost = replace(task((240.0, 200.0)), features={"T1": Feature(frozen([200.0, 150.0]), "lost")})
    assert not len(ghost_points(lost))
    unknown = replace(task(), ghost={"T1": frozen([[np.nan, 3.0]]), "gone": frozen([[1.0, 2.0]])})
    assert not len(ghost_points(unknown))


def test_a_ghost_about_its_least_size_does_not_flicker() -> None:
    """It appears at one size and vanishes at a smaller one."""
    between = (APPEAR_PX + VANISH_PX) / 2
    ghosts, seen = Ghosts(), []
    for step in (between, APPEAR_PX + 0.1, between, APPEAR_PX - 0.1, VANISH_PX - 0.1, between):
        seen.append(len(ghost_points(task((200.0 + step, 150.0)), ghosts=ghosts)) > 0)
    assert seen == [False, True, True, True, False, False]


def test_the_ghost_of_a_line_is_drawn_as_it_will_lie() -> None:
    line = TrackerSpec("L1", "left", "line", (100.0, 100.0), (180.0, 100.0))
    scenario = replace(two_cameras(), tracker=(line,))
    segment = frozen([[100.0, 100.0], [180.0, 100.0]])
    feature = Feature(frozen([140.0, 100.0]), segment=segment)
    there = frozen([[120.0, 160.0], [200.0, 160.0]])
    snapshot = Snapshot(1, 0.0, Status(), frozen(()), (), {}, {"L1": feature}, scenario, ghost={"L1": there})
    points = ghost_points(snapshot)
    middle = points[(np.abs(points[:, 0] - 150.0) < 20.0) & (points[:, 1] > 130.0)]
    assert len(middle) > 4 and np.abs(middle[:, 1] - 160.0).max() < 1e-3
    # Another number of points than the feature has is not drawn at all.
    assert not len(ghost_points(replace(snapshot, ghost={"L1": frozen([[120.0, 160.0]])})))


def test_the_ghost_has_a_colour_that_no_mark_has() -> None:
    assert GHOST not in [*(k.color for k in w.KINDS), w.RED, w.TEAL, w.GREEN, w.AMBER]


# The ghost arm.


class Scene:
    """Takes the place of viser's scene: remembers what was made of which mesh."""

    def __init__(self) -> None:
        self.made: dict[str, SimpleNamespace] = {}

    def add_mesh_simple(self, name: str, vertices: np.ndarray, faces: np.ndarray, **props: object) -> object:
        node = SimpleNamespace(**props, name=name, position=None, wxyz=None)
        node.remove = lambda: self.made.pop(name)
        self.made[name] = node
        return node


def moved(x: float) -> np.ndarray:
    T = np.eye(4)
    T[0, 3] = x
    return T


def test_the_ghost_arm_shows_only_what_will_move_and_costs_nothing_when_off() -> None:
    scene = Scene()
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], float)
    faces = np.array([[0, 1, 2]], np.int32)
    meshes = [Mesh(b, Visual(b, corners, faces, corners, (1, 1, 1)), None) for b in ("base", "link", "world")]
    arm = GhostArm(scene)  # type: ignore[arg-type]
    arm.build("/ghost", meshes, 200.0)
    here = {"base": np.eye(4), "link": np.eye(4), "cup": np.eye(4)}
    arm.update({}, here)
    assert not scene.made
    arm.update({"base": np.eye(4), "link": moved(0.02), "cup": moved(0.5)}, here)
    (node,) = scene.made.values()
    assert node.visible and 0.0 < node.opacity < 1.0
    assert np.allclose(node.position, [4.0, 0.0, 0.0])
    for x, shown in ((0.002, True), (0.0005, False), (0.002, False), (0.02, True)):
        arm.update({"link": moved(x)}, here)
        assert node.visible is shown
    arm.update({}, here)
    assert not node.visible
    arm.build("/ghost2", meshes, 200.0)
    assert not scene.made
