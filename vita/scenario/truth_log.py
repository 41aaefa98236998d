"""Ground truth along a run, for judging only: how well the tool followed, and how near the arm came.

Nothing here is seen by what moves the arm.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from vita.errors import BadInput
from vita.poses import pose_matrix
from vita.rig import SimulatedRig
from vita.scenario.schema import ClearanceSpec, FollowSpec, Scenario
from vita.snapshot import Snapshot
from vita.types import Array, frozen

NAN3 = np.full(3, np.nan)


@dataclass
class _Tick:
    """One instant of the truth."""

    stamp: float
    follow: list[tuple[Array, float]]
    """For each `follow` of the scenario: the offset from the wanted place (3,) [m] and the angle [rad]."""
    clearance: list[float]
    """For each `clearance`: the smallest distance [m]."""
    marker: Array
    """(3,) the true centre of the tool's marker [m]."""
    target: Array
    """(3,) the true place of the first `follow`'s target [m]."""
    seen: Array = field(default_factory=lambda: NAN3)
    """(3,) the tool's marker as recovered from the cameras [m]."""


class TruthLog:
    """Looks at the simulation after every tick."""

    def __init__(self, rig: SimulatedRig, scenario: Scenario) -> None:
        self._rig = rig
        expect = scenario.expect
        self.follow: tuple[FollowSpec, ...] = expect.follow if expect else ()
        self.clearance: tuple[ClearanceSpec, ...] = expect.clearance if expect else ()
        config = scenario.impedance
        self._offset = pose_matrix(config.offset_xyz, config.offset_rpy_deg)
        self._marker = pose_matrix(config.tool_marker_xyz, config.tool_marker_rpy_deg)
        self._tip = np.asarray(config.tool_tip_xyz, dtype=float)
        self._arm = rig.arm_model() if self.clearance else None
        self._ticks: list[_Tick] = []

    def note(self, snapshot: Snapshot) -> None:
        """Take down the truth at the pictures of `snapshot`."""
        poses = self._rig.poses()
        marker = (poses["tool"] @ self._marker)[:3, 3] if "tool" in poses else NAN3
        target = poses[self.follow[0].to][:3, 3] if self.follow else NAN3
        seen = snapshot.impedance.tool_seen
        self._ticks.append(
            _Tick(
                snapshot.stamp,
                [self._gap(spec) for spec in self.follow],
                [self._distance(spec, snapshot.q) for spec in self.clearance],
                marker,
                target,
                NAN3 if seen is None else seen,
            )
        )

    def _gap(self, spec: FollowSpec) -> tuple[Array, float]:
        poses = self._rig.poses()
        wanted, is_ = poses[spec.to] @ self._offset, poses[spec.of]
        turn = Rotation.from_matrix(wanted[:3, :3].T @ is_[:3, :3])
        return is_[:3, 3] - wanted[:3, 3], float(turn.magnitude())

    def _distance(self, spec: ClearanceSpec, q: Array) -> float:
        """Smallest distance between the arm's skeleton, from the elbow to the tool's tip, and a body [m]."""
        assert self._arm is not None
        joints = self._arm.outer(self._arm.frames(q), self._tip)
        if spec.to == "table":
            return float(joints[:, 2].min())
        parts = [part for part in self._rig.obstacles() if part.body == spec.to]
        if not parts:
            raise BadInput(f"nothing is known of the shape of {spec.to!r}", "expect.clearance")
        return min(
            between_segments(a, b, part.start, part.end) - part.radius
            for a, b in zip(joints[:-1], joints[1:], strict=True)
            for part in parts
        )

    # ---- figures -----------------------------------------------------------------------------------

    def figures(self, index: int) -> dict[str, float]:
        """`rms_mm`, `rms_deg` and `mean_mm` of a `follow` over its span of time; NaN when it is empty."""
        spec = self.follow[index]
        span = [t.follow[index] for t in self._ticks if spec.from_s <= t.stamp <= spec.until_s]
        if not span:
            return dict.fromkeys(("rms_mm", "rms_deg", "mean_mm"), np.nan)
        gaps, angles = np.array([gap for gap, _ in span]), np.array([angle for _, angle in span])
        return {
            "rms_mm": 1e3 * float(np.sqrt((gaps**2).sum(axis=1).mean())),
            "rms_deg": float(np.degrees(np.sqrt((angles**2).mean()))),
            "mean_mm": 1e3 * float(np.linalg.norm(gaps.mean(axis=0))),
        }

    def nearest_mm(self, index: int) -> float:
        """Smallest distance of a `clearance` over the run [mm]."""
        return 1e3 * min((t.clearance[index] for t in self._ticks), default=np.nan)

    def recovered_mm(self) -> float:
        """Distance between true and recovered place of the tool's marker when it was last seen [mm]."""
        seen = [t for t in self._ticks if np.isfinite(t.seen).all()]
        return 1e3 * float(np.linalg.norm(seen[-1].seen - seen[-1].marker)) if seen else np.nan

    def series(self) -> dict[str, Array]:
        """Arrays over the ticks for the recording."""
        if not self._ticks:
            return {}
        series = {
            "tool_true": frozen([t.marker for t in self._ticks]),
            "tool_recovered": frozen([t.seen for t in self._ticks]),
            "target_true": frozen([t.target for t in self._ticks]),
        }
        for i in range(len(self.follow)):
            series[f"follow_{i}_mm"] = frozen([1e3 * np.linalg.norm(t.follow[i][0]) for t in self._ticks])
            series[f"follow_{i}_deg"] = frozen([np.degrees(t.follow[i][1]) for t in self._ticks])
        for i in range(len(self.clearance)):
            series[f"clearance_{i}_mm"] = frozen([1e3 * t.clearance[i] for t in self._ticks])
        return series


def between_segments(a: Array, b: Array, c: Array, d: Array) -> float:
    """Distance between the segments from a to b and from c to d, each (3,) [m]."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = u @ u, u @ v, v @ v, u @ w, v @ w
    best = np.inf
    det = uu * vv - uv * uv
    if det > 1e-15:
        s, t = (uv * vw - vv * uw) / det, (uu * vw - uv * uw) / det
        if 0 <= s <= 1 and 0 <= t <= 1:
            best = float(np.linalg.norm(w + s * u - t * v))
    # Otherwise the nearest pair of points holds an end of one of them.
    for point, start, way in ((a, c, v), (b, c, v), (c, a, u), (d, a, u)):
        length = way @ way
        share = float(np.clip((point - start) @ way / length, 0, 1)) if length > 0 else 0.0
        best = min(best, float(np.linalg.norm(point - start - share * way)))
    return best
