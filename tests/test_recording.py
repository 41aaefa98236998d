"""Recordings of runs: what is saved is what is loaded, and the verdict is plain JSON."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from task_text import TASK

from vita.errors import BadInput
from vita.scenario.record import RunRecord
from vita.scenario.toml_io import loads
from vita.types import RowLabel

SUMMARY_KEYS = [
    "scenario", "outcome", "reason", "ticks", "sim_time_s", "final_error_px", "expect", "passed"
]  # fmt: skip


def make_record(ticks: int = 40, **changes: object) -> RunRecord:
    """A run that decays as a good one does, with a tracker that is lost for a while."""
    t = np.arange(ticks) / 30.0
    error = np.exp(-t)[:, None] * [80.0, -35.0]
    error[ticks // 3 : ticks // 2, 0] = np.nan
    record = RunRecord(
        scenario=loads(TASK),
        outcome="converged",
        reason="",
        message="Every error component is below 0.5 px.",
        ticks=ticks,
        sim_time_s=ticks / 30.0,
        final_error_px=0.31,
        expect={"outcome": True, "within_s": True},
        passed=True,
        stamp=5.0 + t,
        q=np.cumsum(np.full((ticks, 7), 0.01), axis=0) * np.arange(7.0),
        error=error,
        labels=(RowLabel("tip_on_corner_l", "left", "u"), RowLabel("tip_on_corner_l", "left", "v")),
        weights=np.ones(2),
        command=np.full((ticks, 7), 0.01),
        state=("learning",) * (ticks // 3) + ("servoing",) * (ticks - ticks // 3),
        trackers=("tip_l", "corner_l", "goal_h"),
        uv=np.zeros((ticks, 3, 2)),
        seen=np.ones((ticks, 3), bool),
        jacobian=np.full((ticks, 2, 7), np.nan),
        final_distance_mm=1.25,
        name="demo",
    )
    return dataclasses.replace(record, **changes)


def same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray):
        assert isinstance(b, np.ndarray)
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return a == b or (a != a and b != b)


@pytest.mark.parametrize(
    "record",
    [
        make_record(),
        make_record(final_error_px=math.nan, final_distance_mm=None, passed=False, reason="tracker_lost"),
        make_record(jacobian=np.zeros(0)),
        make_record(0, state=(), labels=(), trackers=(), error=np.zeros((0, 0)), uv=np.zeros((0, 0, 2))),
        make_record(1),
    ],
    ids=["whole", "nothing seen", "without jacobian", "no ticks", "one tick"],
)
def test_a_recording_loads_back_identical(record: RunRecord, tmp_path: Path) -> None:
    record.save(tmp_path)
    for path in (tmp_path / "demo", tmp_path / "demo.npz", tmp_path / "demo.json"):
        again = RunRecord.load(path)
        for f in dataclasses.fields(RunRecord):
            assert same(getattr(record, f.name), getattr(again, f.name)), f.name


def test_the_summary_has_exactly_the_promised_keys() -> None:
    assert list(make_record().summary()) == SUMMARY_KEYS


def test_numbers_that_json_cannot_hold_become_null() -> None:
    summary = make_record(final_error_px=math.nan, sim_time_s=np.float64(1.5), ticks=np.int64(3)).summary()  # type: ignore[arg-type]
    text = json.dumps(summary, allow_nan=False)
    assert json.loads(text)["final_error_px"] is None and json.loads(text)["ticks"] == 3


def test_arrays_of_a_record_cannot_be_changed() -> None:
    """Neither through the record nor through the array that it was made from."""
    q = np.zeros((40, 7))
    record = make_record(q=q)
    q[0] = 1.0
    assert not record.q.any()
    with pytest.raises(ValueError):
        record.q[0] = 1.0


def test_files_are_named_after_the_scenario(tmp_path: Path) -> None:
    written = make_record(name="some/folder/my task.v2.toml").save(tmp_path / "new" / "folder")
    assert [path.name for path in written] == ["my_task.v2.npz", "my_task.v2.json", "my_task.v2.png"]
    assert RunRecord.load(written[0]).outcome == "converged"
    assert make_record(name="../../.").stem == "run"


def test_a_plot_is_a_picture_with_something_on_it(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    scenario = dataclasses.replace(loads(TASK), title="Costs $5 and $x^ of luck")  # no formula
    (*_, png) = make_record(scenario=scenario).save(tmp_path)
    pixels = np.asarray(image.open(png).convert("RGB"))
    assert pixels.shape[0] > 400 and pixels.std() > 10


def test_a_place_that_cannot_be_written_is_a_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot write the recording"):
        make_record().save(tmp_path / "file" / "sub")


def test_what_is_no_recording_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cannot read"):
        RunRecord.load(tmp_path / "nothing")
    make_record().save(tmp_path)
    (tmp_path / "demo.npz").write_bytes(b"PK not an archive")
    with pytest.raises(BadInput, match="not a recording"):
        RunRecord.load(tmp_path / "demo")
    for text in ("{}", "[]", "nonsense", "null"):
        make_record().save(tmp_path)
        (tmp_path / "demo.json").write_text(text)
        with pytest.raises(BadInput, match="not a recording"):
            RunRecord.load(tmp_path / "demo")
