"""How near the arm is to things and to itself: against other ways to find it out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from vita.scenario.schema import AttachSpec, ObjectSpec, Scenario, SceneSpec, TrackerSpec
from vita.sim.boxes import boxes_of, nearest_on_boxes, room_boxes
from vita.sim.objects import OBJECT_KINDS, build_object
from vita.sim.people import SEGMENTS
from vita.sim.props import Props
from vita.sim.proximity import Proximity, proximity_of, touched
from vita.sim.robots import ROBOTS, load_robot

H = 1e-6


def frames(rng, count):
    """(count, 4, 4) random poses."""
    T = np.tile(np.eye(4), (count, 1, 1))
    for one in T:
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        one[:3, :3] = turn * np.sign(np.linalg.det(turn))
        one[:3, 3] = rng.uniform(-1, 1, 3)
    return T


def to_box(point, T, half):
    """Distance of a point from a box."""
    p = T[:3, :3].T @ (point - T[:3, 3])
    return float(np.linalg.norm(p - np.clip(p, -half, half)))


def test_nearest_on_boxes_is_the_minimum() -> None:
    """Against a numeric search along each segment; boxes may be flat, thin or a point, segments a point."""
    rng = np.random.default_rng(3)
    T = frames(rng, 12)
    halves = rng.uniform(0, 0.6, (12, 3)) * rng.choice([0.0, 1.0], (12, 3), p=[0.3, 0.7])
    starts = rng.uniform(-1.5, 1.5, (15, 3))
    ends = starts + rng.normal(size=(15, 3)) * rng.choice([0.0, 0.1, 1.0], (15, 1))
    on_arm, normals, far = nearest_on_boxes(starts, ends, (T, halves))
    share = np.linspace(0, 1, 400)
    for i in range(15):
        for k in range(12):
            points = starts[i] + share[:, None] * (ends[i] - starts[i])
            best = min(to_box(p, T[k], halves[k]) for p in points)
            found = minimize(
                lambda t, i=i, k=k: to_box(starts[i] + t[0] * (ends[i] - starts[i]), T[k], halves[k]) ** 2,
                [0.5], bounds=[(0, 1)],
            )  # fmt: skip
            best = min(best, np.sqrt(max(found.fun, 0.0)))
            if best > 1e-6:
                assert far[i, k] == pytest.approx(best, abs=2e-6)
                assert far[i, k] == pytest.approx(to_box(on_arm[i, k], T[k], halves[k]), abs=1e-9)
            else:
                assert far[i, k] <= 1e-6
            assert np.linalg.norm(normals[i, k]) == pytest.approx(1.0)
            # Along the normal the box is left.
            step = on_arm[i, k] + 1e-4 * normals[i, k]
            if far[i, k] > 1e-9:
                assert to_box(step, T[k], halves[k]) == pytest.approx(far[i, k] + 1e-4, abs=1e-8)


@pytest.mark.parametrize("kind", OBJECT_KINDS)
def test_boxes_contain_every_mesh_of_their_thing(kind: str) -> None:
    boxes = boxes_of([ObjectSpec("thing", kind)])
    placed = boxes.placed({"thing": np.eye(4)})
    points = np.concatenate([visual.vertices for visual in build_object(kind, "thing")])[::3]
    _, _, far = nearest_on_boxes(points, points, placed)
    assert ((far - boxes.radii).min(axis=1) < 1e-6 + (0.02 if kind in SEGMENTS else 0.0)).all()


def test_the_table_is_under_the_arm_and_the_floor_around_it() -> None:
    for table, names in ((True, ("the table", "the floor")), (False, ("the floor",))):
        boxes = room_boxes(table)
        point = np.array([[0.5, 0.0, 0.2]])
        _, normals, far = nearest_on_boxes(point, point, boxes.placed({"world": np.eye(4)}))
        assert boxes.names == names and far[0, 0] == pytest.approx(0.2)
        assert normals[0, 0] == pytest.approx([0, 0, 1])


@pytest.mark.parametrize("robot", ROBOTS)
def test_gradients_are_the_change_of_the_distances(robot: str) -> None:
    """Against central differences at random poses, where the nearest points do not jump."""
    model = load_robot(robot)
    things = (ObjectSpec("ball", "ball", (0.5, 0.3, 0.5)), ObjectSpec("cube", "cube", (0.4, -0.4, 0.6)))
    near = Proximity(model, Scenario(scene=SceneSpec(robot=robot, objects=things)))
    poses = {"world": np.eye(4), **Props(things).standing(0.0)}
    rng = np.random.default_rng(5)
    smooth = 0
    for _ in range(4):
        q = np.array([rng.uniform(j.lower, j.upper) for j in model.joints]).clip(-2, 2)
        seen = near.look(q, poses, 0.0)
        steps = H * np.eye(model.n)
        ahead, behind = (
            np.array([near.look(q + s * step, poses, 0.0).distances for step in steps]).T for s in (1, -1)
        )
        # Where both one-sided slopes agree there is no kink, and the gradient must be theirs.
        one, other = (ahead - seen.distances[:, None]) / H, (seen.distances[:, None] - behind) / H
        clear = np.abs(one - other) < 1e-3
        smooth += clear.sum()
        assert np.abs(seen.gradients - 0.5 * (one + other))[clear].max() < 1e-4
        assert seen.gradients.shape == (seen.distances.size, model.n) == (len(near.pairs), model.n)
    assert smooth > 100


def test_what_is_meant_to_touch_is_not_watched() -> None:
    """The tool and what it carries, the base on its table, and the wrist with the things of the task."""
    things = (
        ObjectSpec("card", "card", (0.5, 0, 0)), ObjectSpec("post", "post", (0.6, 0.2, 0.25)),
        ObjectSpec("held", "cube", (0, 0, 0.1), mount="tool"), ObjectSpec("ball", "ball", (0.6, -0.3, 0.4)),
    )  # fmt: skip
    trackers = tuple(TrackerSpec(body, "left", attach=AttachSpec(body)) for body in ("card", "tool", "ball"))
    scenario = Scenario(scene=SceneSpec(objects=things), tracker=trackers)
    pairs = set(Proximity(load_robot("wam7"), scenario).pairs)
    assert touched(scenario) == {"card", "tool"}, "people and balls are never what a task touches"
    assert not any("held" in pair.second or pair.first == "the base" for pair in pairs if "the base" in pair)
    assert not any("held" in name or "tool" in name for pair in pairs for name in pair)
    assert ("the wrist", "the card") not in pairs and ("the forearm", "the card") in pairs
    assert {("the wrist", "the post"), ("the wrist", "the ball"), ("the forearm", "the table")} <= pairs
    assert not any(pair.first == "the base" for pair in pairs)


@pytest.mark.parametrize("robot", ROBOTS)
def test_nothing_is_near_in_the_ready_pose(robot: str) -> None:
    model = load_robot(robot)
    near = proximity_of(model, Scenario(scene=SceneSpec(robot=robot)))
    assert near is not None
    assert near.look(model.q_ready, {"world": np.eye(4)}, 0.0).distances.min() > 0.05


def test_the_forearm_on_the_table_is_contact() -> None:
    """Straight out and down, the arm is in the table; words name both."""
    model = load_robot("wam7")
    near = Proximity(model, Scenario())
    q = np.array([0.0, 1.9, 0.0, 0.3, 0.0, 0.0, 0.0])
    seen = near.look(q, {"world": np.eye(4)}, 0.0)
    touching = {near.pairs[i].touches for i in np.flatnonzero(seen.distances < 0.005)}
    assert "The forearm touches the table" in touching
    gradient = seen.gradients[seen.distances.argmin()]
    assert near.look(q + 0.01 * gradient, {"world": np.eye(4)}, 0.0).distances.min() > seen.distances.min()
