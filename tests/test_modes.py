"""The engine in its second mode, on rendered pictures: what it takes, what it refuses, what stops it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vita
from vita import commands as cmd
from vita.engine import Engine
from vita.errors import BadInput, NotNow, UnknownName
from vita.following import Following
from vita.scenario.toml_io import dumps, loads
from vita.sim.lockstep import LockstepRig
from vita.stereo.rig_file import save_rig
from vita.vision.stereo_rig import stereo_rig_of

SCENARIO = vita.load("reach_marker")


@pytest.fixture(scope="module")
def rig() -> Iterator[LockstepRig]:
    with LockstepRig(SCENARIO) as rig:
        yield rig


@pytest.fixture
def engine(rig: LockstepRig) -> Engine:
    rig.release()
    rig.hard_reset(rig.observe().q)
    return Engine(rig, SCENARIO)


def ticks(engine: Engine, count: int) -> None:
    for _ in range(count):
        engine.tick()


def test_a_mode_that_does_not_exist_is_refused_with_the_choices(engine: Engine) -> None:
    with pytest.raises(UnknownName, match="uvs, impedance"):
        engine.apply(cmd.SetMode("stereo"))
    assert engine.present().mode == "impedance"


def test_the_mode_is_changed_at_rest_only_and_saved_with_the_task(engine: Engine) -> None:
    engine.apply(cmd.SetMode("uvs"))
    assert engine.following is None and engine.tick().scenario.mode == "uvs"
    engine.apply(cmd.SetMode("impedance"))
    engine.apply(cmd.SetImpedance("stiffness", 60.0))
    saved = loads(dumps(engine.present()))
    assert saved.mode == "impedance" and saved.impedance.stiffness == 60.0
    engine.apply(cmd.Start())
    engine.tick()
    assert engine.moving
    with pytest.raises(NotNow, match="stop the arm"):
        engine.apply(cmd.SetMode("uvs"))
    with pytest.raises(NotNow, match="stop the arm"):
        engine.apply(cmd.SetImpedance("target_marker", 9))


def test_settings_that_could_hold_nothing_off_are_refused_and_nothing_changes(engine: Engine) -> None:
    with pytest.raises(BadInput, match=r"impedance\.\w+"):
        engine.apply(cmd.SetImpedance("push_n", 0.1))
    with pytest.raises(BadInput, match="outside"):
        engine.apply(cmd.SetImpedance("damping", -1.0))
    with pytest.raises(UnknownName, match="stiffness"):
        engine.apply(cmd.SetImpedance("stifness", 1.0))
    assert engine.present().impedance == SCENARIO.impedance


def test_a_camera_that_is_not_there_is_named() -> None:
    with pytest.raises(BadInput, match=r"impedance\.left.*'middle'|'middle'.*left, right"):
        loads(dumps(SCENARIO).replace("[impedance]", '[impedance]\nleft = "middle"'))


def test_tuning_while_it_moves_is_in_force_from_the_next_period_on(engine: Engine) -> None:
    engine.apply(cmd.Start())
    ticks(engine, 3)
    engine.apply(cmd.SetImpedance("top_speed", 0.05))
    snapshot = engine.tick()
    assert engine.moving and snapshot.scenario.impedance.top_speed == 0.05
    following = engine.following
    assert following is not None and following.controller.impedance.config.top_speed == 0.05


def test_stop_ends_the_motion_within_one_period(engine: Engine) -> None:
    engine.apply(cmd.Start())
    ticks(engine, 30)
    assert engine.moving and engine.last_step is not None
    engine.apply(cmd.Halt())
    assert engine.last_step is None and engine.status.reason == "stopped_by_user"
    ticks(engine, 10)
    q = engine.tick().q
    np.testing.assert_allclose(engine.tick().q, q, atol=1e-12)  # What is left is the motors settling.


def test_a_camera_that_repeats_itself_holds_the_arm_and_is_named(engine: Engine) -> None:
    engine.apply(cmd.Start())
    ticks(engine, 30)
    engine.apply(cmd.Perform("freeze_camera", {"camera": "right", "for_s": 1.0}))
    ticks(engine, 6)
    assert engine.status.state == "hold" and engine.status.reason == "frozen_feed"
    assert "'right'" in engine.status.message
    engine.apply(cmd.Perform("unfreeze_camera", {"camera": "right"}))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("turn", "yes"), ("follow", 1), ("table_z", "x"), ("table_z", float("nan")), ("tool_marker", "7"),
        ("target_marker", 2.5), ("moved_frames", "5"), ("tool_marker_m", True), ("offset_xyz", "abc"),
        ("offset_xyz", (1.0, 2.0)), ("tool_tip_xyz", (0.0, 0.0, float("inf"))), ("left", 3), ("mass_kg", "1"),
    ],
)  # fmt: skip
def test_a_setting_of_the_wrong_type_is_refused_by_its_name_and_nothing_changes(
    engine: Engine, field: str, value: object
) -> None:
    before = engine.present()
    with pytest.raises(BadInput, match=f"impedance.{field}"):
        engine.apply(cmd.SetImpedance(field, value))
    assert engine.present() == before


def test_a_file_whose_repulsion_could_hold_nothing_off_is_refused_when_it_is_read() -> None:
    text = dumps(SCENARIO).replace("[impedance]", "[impedance]\npush_n = 0.5\npull_n = 90.0", 1)
    with pytest.raises(BadInput, match="impedance"):
        loads(text)


def test_what_a_covered_depth_camera_cannot_see_is_not_taken_for_free_space() -> None:
    scenario = vita.load("keep_clear")
    with LockstepRig(scenario) as rig:
        engine = Engine(rig, scenario)
        engine.apply(cmd.Start())
        ticks(engine, 20)
        assert engine.moving
        camera = scenario.impedance.depth
        at, size = [320, 240], 300.0
        engine.apply(cmd.Perform("cover", {"camera": camera, "at": at, "size_px": size}))
        ticks(engine, 4)
        assert (engine.status.state, engine.status.reason) == ("hold", "depth_blind")
        assert repr(camera) in engine.status.message and engine.last_step is None
        engine.apply(cmd.Perform("uncover", {"camera": camera}))
        ticks(engine, 4)
        engine.apply(cmd.Start())
        ticks(engine, 5)
        assert engine.moving


def test_a_calibration_file_beside_the_scenario_takes_the_place_of_the_cameras_words(tmp_path: Path) -> None:
    own = stereo_rig_of(*SCENARIO.camera[:2])
    other = replace(own.left, fx=1.25 * own.left.fx, fy=1.25 * own.left.fy)
    sizes = SCENARIO.camera[0].size, SCENARIO.camera[1].size
    text = dumps(SCENARIO).replace("[impedance]", '[impedance]\nrig_file = "rig.toml"', 1)
    (tmp_path / "task.toml").write_text(text)
    with pytest.raises(BadInput, match=r"impedance\.rig_file.*rig\.toml"):
        vita.load(tmp_path / "task.toml")
    save_rig(tmp_path / "rig.toml", replace(own, left=other, right=other), sizes, 0.1)
    scenario = vita.load(tmp_path / "task.toml")
    assert loads(dumps(scenario)) == scenario
    with LockstepRig(scenario) as rig:
        eyes = Following(rig, scenario)
        eyes.see(rig.observe())
    with LockstepRig(SCENARIO) as rig:
        plain = Following(rig, SCENARIO)
        plain.see(rig.observe())
    # The same pixels through longer lenses come from farther away.
    seen, before = (f.controller.perception.target.at(0.0) for f in (eyes, plain))
    assert seen is not None and before is not None
    assert np.abs(seen.T_left_marker[:3, 3] - before.T_left_marker[:3, 3]).max() > 0.01


def test_the_check_says_what_each_camera_sees_and_whether_the_goal_is_in_reach() -> None:
    from vita.scenario.checkup import check_up

    found = check_up(SCENARIO)
    codes = [finding.code for finding in found.findings]
    assert codes.count("marker_seen") == 4 and "reachable" in codes
    far = loads(dumps(SCENARIO).replace("xyz = [0.6, -0.16, 0.26]", "xyz = [0.9, -0.16, 0.9]"))
    assert "out_of_reach" in [finding.code for finding in check_up(far).findings]
