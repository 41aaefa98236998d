"""The plain data that vita's parts hand to one another.

Everything here is frozen numpy data without behaviour: a rig gives an `Observation`, trackers
turn it into `Feature`s, constraints turn those into an `ErrorVector`, the servo answers with a
`JointStep`. Reading this file first makes the others easy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

DEPTH_STEP_PX = 4
"""A depth picture holds every fourth row and column of its camera's frame, from the first on."""


def frozen(values: object, dtype: type = np.float64) -> NDArray:
    """A read-only copy of `values`, so that data handed out can never change behind one's back."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class Joint:
    """One revolute joint as the servo sees it: a name and its limits."""

    name: str
    lower: float
    """Lowest allowed position [rad]."""
    upper: float
    """Highest allowed position [rad]."""
    max_speed: float
    """Highest allowed speed [rad/s]."""


@dataclass(frozen=True)
class Observation:
    """What a rig saw at one instant: joint positions and one frame per camera."""

    stamp: float
    """Rig time at which the frames were taken [s]."""
    number: int
    """Frame number; grows by at least one with every observation."""
    q: Array
    """(n,) measured joint positions at `stamp` [rad]."""
    frames: Mapping[str, Image]
    """Camera name to (height, width, 3) RGB frame, read-only."""
    depths: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    """Depth camera name to (height / 4, width / 4) distance along its optical axis, the top-left pixel of
    every block of 4 by 4; infinite where nothing is, NaN where it could not be measured (a lens that is
    dark or covered) [m]. Only cameras with `depth = true`."""
    stamps: Mapping[str, float] = field(default_factory=dict)
    """Camera name to the rig time at which its frame was taken, where that is not `stamp` [s]."""

    @property
    def oldest_s(self) -> float:
        """Rig time of the oldest frame [s]."""
        return min((self.stamp, *self.stamps.values()))


@dataclass(frozen=True)
class Feature:
    """What a tracker reports of one frame."""

    uv: Array
    """(2,) pixel (column, row); the last good one while lost."""
    status: Literal["ok", "lost"] = "ok"
    score: float = 1.0
    """How well the tracker recognises its target, 0 (not at all) to 1."""
    corners: Array | None = None
    """(4, 2) outline of the tracked region, top-left first and clockwise [px]; None without one."""
    detail: str = ""
    """A few words for people: why it is lost, or which method `auto` uses."""
    outline: Array | None = None
    """(k, 2) closed outline of a region that is no quadrangle, such as an ellipse [px]."""
    segment: Array | None = None
    """(2, 2) ends of a tracked line [px], of which `uv` is the middle; None for a point."""

    @property
    def ok(self) -> bool:
        return self.status == "ok"

    @property
    def points(self) -> Array:
        """(1, 2) or, for a line, (2, 2): the points that it gives to a constraint [px]."""
        return self.uv[None] if self.segment is None else self.segment


@dataclass(frozen=True)
class RowLabel:
    """Which constraint, camera and component an error row belongs to."""

    constraint: str
    camera: str
    component: str
    priority: int = 1
    """1 is the most important; rows of a higher number move the arm only where those of lower ones
    leave it free."""


@dataclass(frozen=True)
class ErrorVector:
    """The stacked error e = s - s* (thesis eq. 2.1), zero when the task is done.

    Values are residuals in pixels, not yet multiplied by the weights, and NaN in the rows whose
    trackers are lost.
    """

    values: Array
    """(m,) signed residuals [px]."""
    labels: tuple[RowLabel, ...]
    weights: Array
    """(m,) weight of each row."""

    @property
    def norm(self) -> float:
        """Euclidean norm over the visible rows [px]; NaN when no row is visible."""
        seen = self.values[np.isfinite(self.values)]
        return float(np.linalg.norm(seen)) if seen.size else float("nan")

    @property
    def largest(self) -> float:
        """Largest absolute component over the visible rows [px]; NaN when no row is visible."""
        seen = self.values[np.isfinite(self.values)]
        return float(np.abs(seen).max()) if seen.size else float("nan")

    def of(self, constraint: str) -> Array:
        """The residuals of one constraint [px]."""
        rows = [i for i, label in enumerate(self.labels) if label.constraint == constraint]
        return self.values[rows]


NO_ERROR = ErrorVector(frozen([]), (), frozen([]))


@dataclass(frozen=True)
class JointStep:
    """A joint motion asked of the robot: from `q_from` (where the frame was taken) by `dq`.

    The target q_from + dq is absolute on purpose: a late command then aims at the same point
    instead of adding motion to what has already been travelled.
    """

    dq: Array
    """(n,) wanted motion [rad]."""
    q_from: Array
    """(n,) joint positions of the observation that it answers [rad]."""
    stamp: float
    """Stamp of that observation [s]: the permission to move expires with the image."""
    speed_scale: float = 1.0
    """Share of the speed limits that may be used (below 1 while exploring)."""
    arrive_s: float = 0.0
    """Time after `stamp` before which the target is not to be reached, for motion that flows from one step
    into the next; 0 goes there as fast as the limits allow [s]."""


State = Literal["offline", "idle", "learning", "servoing", "hold", "done", "fault", "estop"]
MOVING_STATES: tuple[State, ...] = ("learning", "servoing")


@dataclass(frozen=True)
class Status:
    """The state of the machine and why it is there, for people and for scripts."""

    state: State = "idle"
    reason: str = ""
    """Short code such as `tracker_lost`; empty when there is nothing to explain."""
    message: str = ""
    """A sentence that names the culprit and the next step."""
    degraded: bool = False
    """Whether the arm goes on at half speed without the rows of a lost tracker."""


@dataclass(frozen=True)
class Notice:
    """A message to the people at the page: an edit was refused, a file was saved, ..."""

    id: int
    level: Literal["info", "warning", "error"]
    text: str
    instead: object | None = None
    """The command (`vita.commands`) that would have been taken in place of a refused one, if any."""


@dataclass(frozen=True)
class Timing:
    """Where the time of a tick went; medians over the last second."""

    loop_hz: float = 0.0
    ms: Mapping[str, float] = field(default_factory=dict)
    """Phase name (`render`, `track`, `servo`, `publish`, ...) to milliseconds per tick."""
    real_time_factor: float = 1.0
    """Simulated seconds per wall second."""


@dataclass(frozen=True, eq=False)
class Visual:
    """One drawable mesh, fixed to a body (robot link, object or `world`)."""

    body: str
    vertices: Array
    """(v, 3) in the body's frame [m]."""
    faces: NDArray[np.int32]
    """(f, 3) vertex indices, counter-clockwise seen from outside."""
    normals: Array
    """(v, 3) unit vertex normals; sharp edges have their vertices doubled."""
    color: tuple[float, float, float]
    """Diffuse colour, 0 to 1; multiplies the texture where there is one."""
    uv: Array | None = None
    """(v, 2) texture coordinates, (0, 0) at the texture's top-left pixel corner."""
    texture: Image | None = None
    """(h, w, 3) RGB."""
