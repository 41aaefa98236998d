"""What cameras and trackers can do wrong (rows V), one injected fault after the other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from bench import Bench, row, task

from vita import commands as cmd
from vita.engine import Engine
from vita.snapshot import Snapshot


@pytest.fixture(scope="module")
def made() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def bench(made: Bench) -> Bench:
    """Everything as new, on the same simulated world: building that is what takes long."""
    made.engine.tap.mend()
    made.rig.hard_reset(np.deg2rad(np.array(task().scene.q0_deg)))
    made.rig.release()
    made.engine = Engine(made.rig, task())
    return made


def goes_on_at_half_speed(bench: Bench, within: int = 1) -> Snapshot:
    """The fault degrades the run within so many periods, and the arm still gets there."""
    seen, ticks = bench.until(lambda s: s.status.degraded, within)
    assert seen.status.state == "servoing" and "tip0_l" in seen.status.message
    assert "half speed" in seen.status.message
    assert bench.engine.last_step is not None and bench.engine.last_step.speed_scale <= 0.5
    return seen


def goes_on_after_mending(bench: Bench) -> None:
    """Full speed by itself, and to the goal."""
    bench.engine.apply(cmd.Mend())
    bench.until(lambda s: s.status.state in ("servoing", "done") and not s.status.degraded, 20)
    assert bench.until("done")[0].status.reason == "converged"


def starts_again(bench: Bench) -> None:
    bench.engine.apply(cmd.Mend())
    bench.tick(12)
    bench.engine.apply(cmd.Start())
    assert bench.until("done")[0].status.reason == "converged"


@row("V1")
def test_a_lost_tracker_is_done_without_at_half_speed(bench: Bench) -> None:
    bench.start()
    bench.inject("V1")
    said = goes_on_at_half_speed(bench).status.message
    assert "10 of 12" in said
    goes_on_after_mending(bench)


@row("V2")
def test_a_camera_that_sees_nothing_stops_the_arm(bench: Bench) -> None:
    bench.start()
    bench.inject("V2")
    status = bench.tick().status
    assert (status.state, status.reason) == ("hold", "tracker_lost") and "left view" in status.message
    bench.rests_after()
    starts_again(bench)


@row("V3")
def test_what_is_no_pixel_is_a_loss_and_never_enters_the_error(bench: Bench) -> None:
    bench.start()
    bench.inject("V3")
    goes_on_at_half_speed(bench)
    for _ in range(6):
        seen = bench.tick()
        assert not seen.features["tip0_l"].ok and np.isfinite(seen.features["tip0_l"].uv).all()
        rows = [k for k, label in enumerate(seen.error.labels) if label.constraint == "meet 0 left"]
        assert np.isnan(seen.error.values[rows]).all()
        assert np.isfinite(np.delete(seen.error.values, rows)).all()
    goes_on_after_mending(bench)


@row("V4")
def test_a_tracker_that_stands_still_is_lost(bench: Bench) -> None:
    bench.start()
    bench.inject("V4")
    said = goes_on_at_half_speed(bench, within=3).status.message
    assert "not updating" in said
    goes_on_after_mending(bench)


@row("V5")
def test_a_frozen_camera_stops_the_arm(bench: Bench) -> None:
    bench.start(1)
    bench.inject("V5")
    seen, _ = bench.until("hold", 4)
    assert seen.status.reason == "frozen_feed" and "'left'" in seen.status.message
    bench.rests_after()
    starts_again(bench)


@row("V6")
def test_late_pictures_stop_the_arm(bench: Bench) -> None:
    bench.start(1)
    bench.inject("V6")
    seen, _ = bench.until("hold", 9)
    assert seen.status.reason == "images_late" and "133 ms" in seen.status.message
    assert "'left', 'right'" in seen.status.message
    bench.rests_after()
    bench.engine.apply(cmd.Mend())
    said = bench.tick(12).status
    assert said.state == "hold" and "in time again. Press Start" in said.message
    starts_again(bench)


@row("V7")
def test_a_single_jump_is_bridged_and_a_lasting_one_is_a_loss(bench: Bench) -> None:
    bench.start()
    bench.inject("V7")
    first = bench.tick()
    assert first.features["tip0_l"].ok and "jumped" in first.features["tip0_l"].detail
    assert not first.status.degraded
    goes_on_at_half_speed(bench)
    goes_on_after_mending(bench)


@row("V8")
def test_two_trackers_that_change_places_stop_the_arm(bench: Bench) -> None:
    bench.start()
    bench.inject("V8")
    seen, _ = bench.until("hold", 2)
    assert seen.status.reason == "trackers_swapped" and "left view" in seen.status.message
    bench.rests_after()
    starts_again(bench)


@row("V9")
def test_a_tracker_that_drifts_is_lost(bench: Bench) -> None:
    bench.start(1)
    bench.inject("V9")
    said = goes_on_at_half_speed(bench, within=15).status.message
    assert "does not move as the arm does" in said
    bench.until(lambda s: not bench.engine.moving)
    starts_again(bench)


@row("V10")
def test_a_feature_that_leaves_the_picture_is_driven_slowly(bench: Bench) -> None:
    bench.inject("V10")
    bench.until(lambda s: s.injected == ("V10",) and bench.engine.servoing.leaving != "", 60)
    bench.tick(5)
    bench.engine.apply(cmd.Start())
    seen, _ = bench.until("servoing")
    assert seen.status.degraded and "is leaving the left view" in seen.status.message
    assert bench.engine.last_step is not None and bench.engine.last_step.speed_scale <= 0.5
    bench.until("done")
    bench.engine.apply(cmd.Mend())
    bench.until(lambda s: not s.injected, 60)
    bench.engine.apply(cmd.ResetArm())
    bench.engine.apply(cmd.Start())
    assert not bench.until("servoing")[0].status.degraded
    assert bench.until("done")[0].status.reason == "converged"


@row("V12")
def test_a_camera_that_is_unplugged_stops_the_arm_and_is_asked_again(bench: Bench) -> None:
    asked: list[tuple[str, float]] = []
    bench.engine.cameras.reopen = lambda name: asked.append((name, bench.engine.observation.stamp))
    bench.start(1)
    bench.inject("V12")
    seen = bench.tick()
    assert (seen.status.state, seen.status.reason) == ("hold", "camera_lost")
    assert "'left'" in seen.status.message and "there is none" in seen.status.message
    assert seen.frames["left"].shape == (240, 320, 3)
    gone = seen.stamp
    bench.rests_after()
    bench.tick(30 * 4)
    assert {name for name, _ in asked} == {"left"}
    assert np.allclose(np.diff([gone, *(when for _, when in asked)]), [1, 2], atol=0.07)
    bench.engine.apply(cmd.Mend())
    said = bench.tick(12)
    assert said.status.state == "hold" and "'left' is back. Press Start" in said.status.message
    assert said.notices[-1].text == said.status.message
    starts_again(bench)


@row("V13")
def test_a_tracker_whose_code_fails_is_lost_and_logged_once_a_minute(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    bench.start()
    bench.inject("V13")
    said = goes_on_at_half_speed(bench).status.message
    assert "ZeroDivisionError" in said
    bench.tick(10)
    assert len([record for record in caplog.records if "tip0_l" in record.getMessage()]) == 1
    goes_on_after_mending(bench)
