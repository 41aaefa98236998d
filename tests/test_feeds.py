"""A frozen camera is noticed, a camera that does not see the arm is left alone."""

from __future__ import annotations

import numpy as np
import pytest

import vita
from vita import commands as cmd
from vita.engine import Engine
from vita.feeds import FROZEN_FRAMES, FrozenFeeds
from vita.sim.lockstep import LockstepRig
from vita.types import Observation, frozen


def seen(number: int, q: float, picture: int) -> Observation:
    frame = frozen(np.full((4, 4, 3), picture), np.uint8)
    return Observation(number / 30, number, frozen([q]), {"left": frame})


def verdicts(pictures: list[int], step: float = 0.01) -> list[bool]:
    feeds = FrozenFeeds()
    return [bool(feeds.update(seen(i, step * i, p), ["left"])) for i, p in enumerate(pictures)]


def test_the_same_picture_for_three_moving_frames_is_a_frozen_feed() -> None:
    assert verdicts([0, 1, 2, 2, 2, 2]) == [False] * 5 + [True]


def test_a_camera_that_never_showed_the_motion_is_not_judged() -> None:
    assert not any(verdicts([7] * 30))


def test_an_arm_at_rest_proves_nothing() -> None:
    assert not any(verdicts([0, 1, 2, 2, 2, 2, 2, 2], step=0.0))


def test_a_new_picture_clears_the_suspicion() -> None:
    assert not any(verdicts([0, 1, 1, 1, 2, 2, 2, 3, 3, 3]))


@pytest.mark.timeout(120)
def test_a_frozen_camera_of_the_simulation_holds_the_arm_within_its_frames() -> None:
    scenario = vita.load("point_to_point_wam4")
    with LockstepRig(scenario) as rig:
        engine = Engine(rig, scenario)
        engine.apply(cmd.Start())
        while engine.tick().status.state != "servoing":
            pass
        engine.tick()
        engine.apply(cmd.Perform("freeze_camera", {"camera": "left"}))
        states = [engine.tick().status for _ in range(FROZEN_FRAMES + 2)]
        assert (states[-1].state, states[-1].reason) == ("hold", "frozen_feed")
        assert "'left'" in states[-1].message
