"""Snapshots and figures for tests of what the page says of the servo's self-knowledge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from fake_runner import two_cameras

from vita.scenario.schema import ConstraintSpec, TrackerSpec
from vita.servo.insight import Insight
from vita.snapshot import Snapshot
from vita.types import Feature, Status, frozen


def an_insight(**changes: object) -> Insight:
    """A servo that knows its task well: 4 of 7 joint motions held, nothing wrong."""
    good = Insight(
        singular_values=frozen([700.0, 500.0, 300.0, 100.0]), held=4, joints=7, condition=7.0, weakest=100.0,
        uncertainty=0.02, predicted=frozen([10.0, 0.0]), observed=frozen([10.0, 0.5]), weak_joint="elbow",
        weak_constraint="", next_dq=frozen(np.zeros(7)),
    )
    return replace(good, **changes)  # type: ignore[arg-type]


def task(there: tuple[float, float] | None = None, here: tuple[float, float] = (200.0, 150.0)) -> Snapshot:
    """One constraint in the left view; its moving tracker is expected at `there` next."""
    scenario = replace(
        two_cameras(),
        tracker=(TrackerSpec("T1", "left", "auto", here), TrackerSpec("G1", "left", "fixed", (330.0, 310.0))),
        constraint=(ConstraintSpec("c1", "point_to_point", ("T1", "G1")),),
    )
    features = {"T1": Feature(frozen(here)), "G1": Feature(frozen([330.0, 310.0]))}
    ghost = {} if there is None else {"T1": frozen([there])}
    return Snapshot(1, 0.0, Status("servoing"), frozen(()), (), {}, features, scenario, ghost=ghost)
