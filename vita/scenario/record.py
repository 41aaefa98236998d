"""What a run leaves behind: the verdict, and every tick's numbers as arrays."""

from __future__ import annotations

import json
import math
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput, MissingDependency
from vita.scenario.schema import Scenario
from vita.scenario.toml_io import dumps, loads
from vita.types import Array, Joint, RowLabel, frozen

_ARRAYS = ("stamp", "q", "error", "weights", "command", "uv", "seen", "jacobian")
_SERIES = "series_"
"""What the names of further arrays begin with in the file."""


@dataclass(frozen=True, eq=False)
class RunRecord:
    """A headless run, tick by tick. t ticks, n joints, m error rows, k trackers."""

    scenario: Scenario
    outcome: str
    """`converged`, `limited`, `held`, `fault` or `timeout`."""
    reason: str
    """Short code; empty when there is nothing to explain."""
    message: str
    """A sentence for people."""
    ticks: int
    sim_time_s: float
    final_error_px: float
    """Largest absolute component of the last error; NaN when nothing was seen [px]."""
    expect: Mapping[str, bool]
    """Which expectations of the scenario were met."""
    passed: bool
    stamp: Array
    """(t,) time of the frames [s]."""
    q: Array
    """(t, n) measured joint positions [rad]."""
    error: Array
    """(t, m) residuals, NaN where lost [px]."""
    labels: tuple[RowLabel, ...] = ()
    """The m rows of `error`."""
    weights: Array = field(default_factory=lambda: frozen(()))
    """(m,) weight of each row."""
    command: Array = field(default_factory=lambda: frozen(()))
    """(t, n) joint motion asked for, zero where none was [rad]."""
    state: tuple[str, ...] = ()
    """(t,) state of the machine."""
    trackers: tuple[str, ...] = ()
    """The k trackers of `uv` and `seen`."""
    uv: Array = field(default_factory=lambda: frozen(()))
    """(t, k, 2) pixel of each tracker [px]."""
    seen: NDArray[np.bool_] = field(default_factory=lambda: frozen((), bool))
    """(t, k) whether the tracker was on its target."""
    jacobian: Array = field(default_factory=lambda: frozen(()))
    """(t, m, n) estimated Jacobian, NaN before it is learned; empty when not recorded [px/rad]."""
    final_distance_mm: float | None = None
    """Ground truth at the end, where the scenario asks for it [mm]."""
    series: Mapping[str, Array] = field(default_factory=dict)
    """Further arrays over the ticks: what the stereo-impedance mode saw and did, and the truth."""
    name: str = ""
    """How the scenario was called on the command line."""
    events: tuple[Mapping[str, Any], ...] = ()
    """What happened between the ticks, oldest first: `stamp` [s], `kind` (`state`, `command`, `refused` or
    `notice`), `text`, `reason`, `message`."""
    joints: tuple[Joint, ...] = ()
    """The n joints with the limits in force at the end; none in recordings of before version 0.6."""

    def __post_init__(self) -> None:
        for key in _ARRAYS:
            object.__setattr__(self, key, frozen(getattr(self, key), bool if key == "seen" else np.float64))

    def summary(self) -> dict[str, Any]:
        """The verdict as `vita run --json` prints it; numbers that JSON cannot hold are null."""
        return {
            "scenario": self.name or self.scenario.title,
            "outcome": self.outcome,
            "reason": self.reason,
            "ticks": int(self.ticks),
            "sim_time_s": _finite(self.sim_time_s),
            "final_error_px": _finite(self.final_error_px),
            "expect": {key: bool(met) for key, met in self.expect.items()},
            "passed": bool(self.passed),
        }

    @property
    def stem(self) -> str:
        """A file name made from the scenario's name."""
        name = Path(self.name).stem if self.name else self.scenario.title
        return re.sub(r"[^A-Za-z0-9_.-]+", "_", name).strip("._")[:80] or "run"

    def save(self, folder: str | Path, stem: str | None = None, *, plot: bool = True) -> list[Path]:
        """Write STEM.npz (arrays), STEM.json (verdict and scenario) and, with matplotlib, STEM.png."""
        base = Path(folder) / (stem or self.stem)
        arrays = {key: getattr(self, key) for key in _ARRAYS}
        arrays |= {_SERIES + key: values for key, values in self.series.items()}
        arrays["state"] = np.array(self.state, dtype=np.str_)
        arrays["trackers"] = np.array(self.trackers, dtype=np.str_)
        arrays["labels"] = np.array(
            [(r.constraint, r.camera, r.component, r.priority) for r in self.labels], dtype=np.str_
        ).reshape(-1, 4)
        story = self.summary() | {
            "message": self.message,
            "final_distance_mm": None if self.final_distance_mm is None else _finite(self.final_distance_mm),
            "scenario_toml": dumps(self.scenario),
            "joints": [[j.name, j.lower, j.upper, j.max_speed] for j in self.joints],
            "events": [dict(event) for event in self.events],
        }
        # Once more in the arrays' file, so that this one alone is a recording, too.
        arrays["story"] = np.array(json.dumps(story, allow_nan=False), dtype=np.str_)
        written = [_with(base, ".npz"), _with(base, ".json")]
        try:
            base.parent.mkdir(parents=True, exist_ok=True)
            np.savez_compressed(written[0], allow_pickle=False, **arrays)
            written[1].write_text(json.dumps(story, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        except OSError as error:
            raise BadInput(f"cannot write the recording: {error.strerror or error}", str(base)) from None
        return written + self._plotted(_with(base, ".png")) if plot else written

    def _plotted(self, path: Path) -> list[Path]:
        try:
            from vita.scenario.plot import plot

            plot(self, path)
        except MissingDependency:
            return []  # The recording is whole without its picture.
        return [path]

    @classmethod
    def load(cls, path: str | Path) -> RunRecord:
        """The record of STEM.npz and STEM.json; `path` is either file or the stem. STEM.npz alone will do."""
        base = Path(path)
        if base.suffix in (".npz", ".json", ".png"):
            base = base.with_suffix("")
        try:
            with np.load(_with(base, ".npz"), allow_pickle=False) as file:
                arrays = {key: file[key] for key in file.files}
            inside, beside = str(arrays.pop("story", "")), _with(base, ".json")
            story = json.loads(inside if inside and not beside.exists() else beside.read_text("utf-8"))
            return cls(
                scenario=loads(story["scenario_toml"], source=str(_with(base, ".json"))),
                outcome=story["outcome"],
                reason=story["reason"],
                message=story["message"],
                ticks=story["ticks"],
                sim_time_s=_or_nan(story["sim_time_s"]),
                final_error_px=_or_nan(story["final_error_px"]),
                expect=story["expect"],
                passed=story["passed"],
                final_distance_mm=story["final_distance_mm"],
                name=story["scenario"],
                events=tuple(dict(event) for event in story.get("events", ())),
                joints=tuple(Joint(str(name), *map(float, rest)) for name, *rest in story.get("joints", ())),
                labels=tuple(_label(row) for row in arrays.pop("labels")),
                state=tuple(map(str, arrays.pop("state"))),
                trackers=tuple(map(str, arrays.pop("trackers"))),
                series={
                    key.removeprefix(_SERIES): frozen(values)
                    for key, values in arrays.items()
                    if key.startswith(_SERIES)
                },
                **{key: arrays[key] for key in _ARRAYS},
            )
        except OSError as error:
            raise BadInput(f"cannot read the recording: {error.strerror or error}", str(path)) from None
        except (KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise BadInput(f"is not a recording of vita: {error!r}", str(path)) from None
        except BadInput:
            raise
        except ValueError as error:
            raise BadInput(f"is not a recording of vita: {error}", str(path)) from None


def _with(base: Path, suffix: str) -> Path:
    """`base` with `suffix` appended; a dot in the stem is part of its name."""
    return base.with_name(base.name + suffix)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _label(row: Sequence[str]) -> RowLabel:
    """A row's label from its text; recordings of before there were priorities have none."""
    constraint, camera, component, *priority = map(str, row)
    return RowLabel(constraint, camera, component, *(int(p) for p in priority))


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else float(value)
