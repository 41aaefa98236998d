"""The stereo-impedance controller in closed loop: noisy corners, exact kinematics, the real gate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from vita.experiments.stereo_world import StereoWorld, Truth
from vita.impedance.config import ImpedanceConfig
from vita.impedance.perception import Seen
from vita.impedance.view import Capsule
from vita.poses import look_at, pose_matrix
from vita.sim.robots import load_robot
from vita.stereo.base import MarkerCorners
from vita.types import Array

CONFIG = ImpedanceConfig()
EYE, SEEN = (1.75, 0.0, 0.65), (0.55, 0.0, 0.35)


def world(
    robot: str = "wam7", truth: Truth | None = None, config: ImpedanceConfig = CONFIG, **options: Any
) -> StereoWorld:
    model = load_robot(robot)
    return StereoWorld(model.arm_model(), model.q_ready, truth or still(robot), config, **options)


def target_at(robot: str, shift: tuple[float, float, float] = (0.0, 0.06, 0.02)) -> Array:
    """(4, 4) a target whose goal is `shift` away from where the tool is at the ready pose."""
    model = load_robot(robot)
    offset = pose_matrix(CONFIG.offset_xyz, CONFIG.offset_rpy_deg)
    T = model.poses(model.q_ready)["tool"] @ np.linalg.inv(offset)
    T[:3, 3] += shift
    return T


def still(robot: str = "wam7", **options: Any) -> Truth:
    target, left = target_at(robot), look_at(EYE, SEEN)
    return Truth(lambda now: target, lambda now: left, **options)


def run(w: StereoWorld, seconds: float) -> None:
    for _ in range(round(30 * seconds)):
        w.tick()


def test_it_learns_where_the_cameras_stand_and_brings_the_tool_to_its_goal() -> None:
    w = world()
    w.controller.start()
    run(w, 6.0)
    assert w.controller.phase == "following"
    gap, angle = w.gap()
    assert 1e3 * np.linalg.norm(gap) < 2.0 and np.degrees(angle) < 1.0
    assert 1e3 * w.recovered() < 3.0
    T = w.controller.perception.estimate.T_base_left  # type: ignore[union-attr]
    true = look_at(EYE, SEEN)
    turn = np.arccos(np.clip((np.trace(T[:3, :3].T @ true[:3, :3]) - 1) / 2, -1, 1))
    assert np.degrees(turn) < 0.7


def test_cameras_that_are_moved_are_noticed_and_learned_anew_within_seven_seconds() -> None:
    before = look_at(EYE, SEEN)
    after = look_at((1.62, -0.16, 0.68), SEEN) @ pose_matrix((0, 0, 0), (0, 0, 20.0))
    target = target_at("wam7")
    w = world(truth=Truth(lambda now: target, lambda now: before if now < 5.0 else after))
    w.controller.start()
    run(w, 5.0)
    assert w.controller.phase == "following"
    run(w, 1.0)
    assert "moved" in w.controller.notice and w.controller.phase in ("looking", "calibrating")
    run(w, 6.0)
    assert w.controller.phase == "following"
    assert np.linalg.norm(w.gap()[0]) < 0.01 and w.recovered() < 0.01


def test_a_target_out_of_sight_is_waited_for_at_rest_and_followed_again() -> None:
    hidden = lambda now: 5.0 <= now < 7.5  # noqa: E731
    w = world(truth=still(hidden=hidden))
    w.controller.start()
    run(w, 6.0)
    assert w.controller.phase == "waiting" and w.controller.status.state == "servoing"
    assert "5" in w.controller.status.message and "target" in w.controller.status.message
    q = w.q.copy()
    run(w, 1.4)
    assert np.abs(w.q - q).max() < np.radians(0.2)
    run(w, 1.2)
    assert w.controller.phase == "following"


def test_an_arm_that_gave_way_goes_back_to_where_it_saw_the_target_last() -> None:
    """Or, had it come to stand before the target, it would wait for ever."""
    hidden = lambda now: now >= 5.0  # noqa: E731

    def visitor(now: float) -> list[Capsule]:
        """Somebody who comes at the tool's side and leaves again."""
        if not 5.5 <= now < 7.5:
            return []
        y = -0.30 + 0.16 * min(now - 5.5, 1.0)
        place = np.array([*tool[:2], tool[2]]) + (0.0, y, 0.0)
        return [Capsule("visitor", place, place, 0.05)]

    tool = (target_at("wam7") @ pose_matrix(CONFIG.offset_xyz, CONFIG.offset_rpy_deg))[:3, 3]
    w = world(truth=still(hidden=hidden, obstacles=visitor))
    w.controller.start()
    run(w, 5.0)
    before = w.arm.pose(w.q)[:3, 3]
    run(w, 2.3)
    assert w.controller.phase == "waiting"
    assert np.linalg.norm(w.arm.pose(w.q)[:3, 3] - before) > 0.02  # It did give way.
    run(w, 3.5)
    assert w.controller.phase == "waiting"
    assert np.linalg.norm(w.arm.pose(w.q)[:3, 3] - before) < 0.005


def test_a_tool_out_of_sight_is_not_moved_on_for_nobody_could_tell_whether_the_cameras_stand() -> None:
    w = world()
    w.controller.start()
    run(w, 4.0)
    assert w.controller.phase == "following"
    seen = w.look

    def blind() -> dict[str, Seen]:
        return seen() | {"tool": Seen(MarkerCorners(None, None), None)}

    w.look = blind  # type: ignore[method-assign]
    run(w, 1.5)
    assert w.controller.phase == "waiting" and "tool" in w.controller.status.message
    w.look = seen  # type: ignore[method-assign]
    run(w, 1.0)
    assert w.controller.phase == "following"


def test_halting_ends_the_motion_at_once_and_start_goes_on_without_learning_again() -> None:
    w = world()
    w.controller.start()
    run(w, 4.0)
    w.controller.halt("stopped_by_user")
    run(w, 0.5)
    q = w.q.copy()
    run(w, 0.5)
    assert np.array_equal(w.q, q)
    w.controller.start()
    w.tick()
    assert w.controller.phase == "following"


def test_without_follow_the_run_is_done_when_the_tool_rests_at_its_goal() -> None:
    w = world(config=replace(CONFIG, follow=False))
    w.controller.start()
    run(w, 8.0)
    assert w.controller.status.state == "done" and w.controller.status.reason == "arrived"
    assert np.linalg.norm(w.gap()[0]) < 1e-3 * CONFIG.done_mm + 1e-3


def test_a_tool_that_nobody_sees_is_not_moved_and_the_cameras_that_miss_it_are_named() -> None:
    away = look_at(EYE, (3.0, 0.0, 0.6))
    target = target_at("wam7")
    w = world(truth=Truth(lambda now: target, lambda now: away))
    q = w.q.copy()
    w.controller.start()
    run(w, 5.5)
    assert np.array_equal(w.q, q)
    assert w.controller.status.reason == "tool_unseen" and w.controller.status.state == "hold"
    assert "'left' and 'right'" in w.controller.status.message


@pytest.mark.parametrize("robot", ["wam4", "wam7", "tx90"])
def test_every_arm_follows_a_target_that_is_carried_along_a_circle(robot: str) -> None:
    start = target_at(robot, (0.0, 0.0, 0.03))

    def target(now: float) -> Array:
        T = start.copy()
        angle = max(0.0, now - 4.0)
        T[1, 3] += 0.1 * np.sin(angle)
        T[2, 3] += 0.1 * (1 - np.cos(angle))
        return T

    left = look_at(EYE, SEEN)
    w = world(robot, Truth(target, lambda now: left))
    w.controller.start()
    run(w, 5.5)
    gaps = []
    for _ in range(75):
        w.tick()
        gaps.append(w.gap()[0])
    assert 1e3 * np.sqrt((np.array(gaps) ** 2).sum(axis=1).mean()) < 5.0
