"""A tracked line in a task: placing, moving, constraints and saving."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sim_rig import CAMERAS, KinematicRig, scenario

from vita import commands as cmd
from vita.engine import Engine
from vita.errors import BadInput
from vita.scenario.toml_io import dumps, loads
from vita.types import frozen


@pytest.fixture
def engine() -> Engine:
    """Both cameras see a bright half plane whose edge rises from (100, 300) to (500, 200)."""
    rig = KinematicRig()
    v, u = np.mgrid[0:480, 0:640]
    bright = np.clip(120 + 60 * (v - 300 + (u - 100) / 4), 60, 180).astype(np.uint8)
    picture = np.repeat(bright[:, :, None], 3, axis=2)
    rig._frames = {camera: frozen(picture, np.uint8) for camera in CAMERAS}
    return Engine(rig, scenario())


@pytest.mark.parametrize("kind", ["line", "auto"])
def test_two_pixels_make_a_line_that_a_saved_task_brings_back(engine: Engine, kind: str) -> None:
    engine.apply(cmd.AddTracker("left", (200.0, 275.0), kind, "edge", to=(400.0, 225.0)))
    engine.apply(cmd.AddConstraint("point_to_line", ("tip_left", "edge"), name="tip on edge"))
    saved = engine.tick().scenario
    # The rig of these tests has three joints, which no robot of a file has.
    as_file = replace(saved, scene=replace(saved.scene, q0_deg=None))
    assert loads(dumps(as_file)) == as_file
    engine.apply(cmd.LoadTask(saved))
    again = engine.tick()
    assert again.features["edge"].points.shape == (2, 2)
    assert np.isfinite(again.error.of("tip on edge")).all()


def test_a_line_dragged_by_its_middle_keeps_its_direction_and_length(engine: Engine) -> None:
    engine.apply(cmd.AddTracker("left", (200.0, 275.0), "line", "edge", to=(400.0, 225.0)))
    before = engine.tick().features["edge"].points
    engine.apply(cmd.MoveTracker("edge", tuple(before.mean(axis=0) + [40.0, -10.0])))
    after = engine.tick().features["edge"].points
    np.testing.assert_allclose(after - before, [[40.0, -10.0]] * 2, atol=0.5)


def test_a_line_where_a_point_is_asked_for_is_refused_and_changes_nothing(engine: Engine) -> None:
    engine.apply(cmd.AddTracker("left", (200.0, 275.0), "line", "edge", to=(400.0, 225.0)))
    task = engine.editor.task
    with pytest.raises(BadInput, match="stands for both ends"):
        engine.apply(cmd.AddConstraint("point_to_point", ("edge",)))
    with pytest.raises(BadInput, match="stands for both ends"):
        engine.apply(cmd.AddConstraint("point_to_line", ("edge", "tip_left")))
    assert engine.editor.task is task


def test_undo_brings_a_moved_line_back(engine: Engine) -> None:
    engine.apply(cmd.AddTracker("left", (200.0, 275.0), "line", "edge", to=(400.0, 225.0)))
    before = engine.tick().features["edge"].points
    engine.apply(cmd.MoveTracker("edge", (300.0, 250.0), to=(460.0, 210.0)))
    assert np.abs(engine.tick().features["edge"].points - before).max() > 20
    engine.apply(cmd.Undo())
    np.testing.assert_allclose(engine.tick().features["edge"].points, before, atol=0.1)
