"""What is no picture, or not of now, stops the arm; a camera that is well again is offered, never taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sim_rig import KinematicRig, scenario

from vita import commands as cmd
from vita.borders import Borders
from vita.camera_watch import ASK_AGAIN_S, CameraWatch
from vita.engine import Engine
from vita.feeds import FROZEN_FRAMES, FrozenFeeds
from vita.servo.reasons import status_for
from vita.sound import Trackers
from vita.types import Feature, Observation, frozen

SIZE = (32, 24)
CAMERAS = ("left", "right")


def seen(number: int, **frames: object) -> Observation:
    good = frozen(np.full((SIZE[1], SIZE[0], 3), 100 + number % 100), np.uint8)
    shown = {name: frames.get(name, good) for name in CAMERAS}
    return Observation(number / 30, number, frozen([0.01 * number]), shown)  # type: ignore[arg-type]


def watch() -> CameraWatch:
    return CameraWatch(dict.fromkeys(CAMERAS, SIZE))


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (None, "there is none"),
        (np.zeros((24, 32, 3), np.uint8), "black"),
        (np.full((24, 32, 3), 0.5), "float64"),
        (np.full((24, 16, 3), 90, np.uint8), "16 x 24"),
        (np.full((24, 32), 90, np.uint8), "32 x 24"),
        ("picture", "str"),
    ],
)
def test_what_is_no_picture_is_named_and_replaced_by_a_blank_one(frame: object, said: str) -> None:
    cameras = watch()
    blank = cameras.take(seen(0, left=frame))
    assert blank.frames["left"].shape == (24, 32, 3) and blank.frames["right"].max() > 0
    trouble = cameras.trouble(blank, CAMERAS)
    assert trouble is not None and trouble.reason == "camera_lost"
    message = status_for(trouble.reason, **trouble.facts).message
    assert "'left'" in message and "'right'" not in message and said in message
    assert cameras.trouble(cameras.take(seen(1)), CAMERAS) is None


@pytest.mark.parametrize(("periods", "late"), [(3, False), (4, True)])
def test_pictures_older_than_three_periods_are_late(periods: int, late: bool) -> None:
    now = seen(9)
    old = replace(now, stamps=dict.fromkeys(CAMERAS, now.stamp - periods / 30))
    cameras = watch()
    trouble = cameras.trouble(cameras.take(old), CAMERAS)
    assert (trouble is not None and trouble.reason == "images_late") == late


@pytest.mark.parametrize(("periods", "apart"), [(1, False), (2, True)])
def test_pictures_that_were_not_taken_together_are_told_apart(periods: int, apart: bool) -> None:
    now = seen(9)
    cameras = watch()
    trouble = cameras.trouble(cameras.take(replace(now, stamps={"left": now.stamp - periods / 30})), CAMERAS)
    assert (trouble is not None and trouble.reason == "camera_skew") == apart


def test_an_observation_that_is_repeated_grows_old() -> None:
    cameras = watch()
    found = [cameras.trouble(cameras.take(seen(5)), CAMERAS) for _ in range(6)]
    assert [t is not None for t in found] == [False] * 4 + [True] * 2


def test_a_camera_is_asked_again_with_growing_pauses_and_a_failure_to_reach_it_harms_nobody() -> None:
    asked: list[float] = []

    def reopen(_: str) -> None:
        asked.append(number / 30)
        raise OSError("still unplugged")

    cameras = CameraWatch(dict.fromkeys(CAMERAS, SIZE), reopen)
    for number in range(30 * 100):
        cameras.take(seen(number, left=None))
    assert np.allclose(np.diff([0.0, *asked]), [*ASK_AGAIN_S, ASK_AGAIN_S[-1]], atol=0.04)


def test_a_servo_that_creeps_on_behind_a_frozen_picture_is_noticed() -> None:
    """At 0.4 mrad a period, less than what is judged from one picture to the next."""
    feeds = FrozenFeeds()
    told = []
    for k in range(20):
        q = 0.01 * min(k, 5) + 4e-4 * max(k - 5, 0)
        frame = frozen(np.full((4, 4, 3), min(k, 5)), np.uint8)
        told.append(bool(feeds.update(Observation(k / 30, k, frozen([q]), {"left": frame}), ["left"])))
    assert any(told) and not any(told[: 5 + FROZEN_FRAMES])


def test_a_read_that_raises_stops_the_arm_and_is_no_internal_error() -> None:
    engine = Engine(KinematicRig(), scenario())
    engine.apply(cmd.Start())
    engine.tick()

    def unplugged(_: Observation) -> Observation:
        raise OSError("no device")

    engine.tap.seen["V12"] = unplugged
    status = engine.tick().status
    assert (status.state, status.reason) == ("hold", "camera_lost") and "'left', 'right'" in status.message
    engine.apply(cmd.Mend())
    said = [engine.tick().status.message for _ in range(12)]
    assert "Press Start" in said[-1] and "is back" in said[-1] and not engine.moving


@pytest.mark.parametrize(
    ("u", "state"), [(25, "ok"), (23, "leaving"), (7, "lost"), (614, "ok"), (633, "lost")]
)
def test_a_feature_near_the_border_is_leaving_and_at_the_border_lost(u: float, state: str) -> None:
    features = {"tip": Feature(frozen([u, 240.0]))}
    for scale in (1.0, 0.5):
        there = {"tip": Feature(frozen(scale * features["tip"].uv))}
        out, leaving = Borders().judge(there, {"tip": (int(640 * scale), int(480 * scale))})
        assert (not out["tip"].ok, leaving == ("tip",)) == (state == "lost", state == "leaving")


@pytest.mark.parametrize(
    "uv", [None, np.array([np.nan, 1.0]), np.array([1.0, np.inf]), np.zeros(3), np.array([-5.0, 3.0]), "uv"]
)
def test_what_is_no_pixel_is_a_loss_at_the_last_good_place(uv: object) -> None:
    trackers = Trackers()
    good = Feature(frozen([3.0, 4.0]))
    assert trackers.checked("tip", good, (24, 32, 3)) is good
    bad = trackers.checked("tip", replace(good, uv=uv), (24, 32, 3))  # type: ignore[arg-type]
    assert not bad.ok and np.array_equal(bad.uv, good.uv) and bad.detail
    assert not trackers.checked("tip", None, (24, 32, 3)).ok
