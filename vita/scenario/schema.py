"""A scenario: the whole of a task file as frozen data (TOML, `schema = 1`).

Field names are the file's keys. Degrees and metres appear as in the file; whoever uses a value
converts it once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from vita.impedance.config import ImpedanceConfig
from vita.servo.config import Limits, ServoConfig

SCHEMA = 1
Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class ObjectSpec:
    """A thing in the scene. `kind` names a builder in `vita.sim.objects`."""

    name: str
    kind: str
    xyz: Vector3 = (0.0, 0.0, 0.0)
    """Position of its origin in the world [m]."""
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw, applied as Rz(yaw) Ry(pitch) Rx(roll) [deg]."""
    mount: str | None = None
    """Robot link (or `tool`) that carries it; None stands it in the world."""


@dataclass(frozen=True)
class SceneSpec:
    """The `[scene]` table."""

    robot: str = "wam7"
    """`wam4`, `wam7`, `tx90`, `puma560`, or a path to a URDF."""
    q0_deg: tuple[float, ...] | None = None
    """Start pose [deg]; None is the robot's ready pose."""
    tool: str = "card_tool"
    """A named tool on the flange, or `none`."""
    objects: tuple[ObjectSpec, ...] = ()
    table: bool = True
    """Whether the arm stands beside its usual table."""
    dead_band_deg: float = 0.0
    """Joint motions smaller than this are not carried out (thesis 5.1.3, TOL) [deg]."""
    image_noise: float = 0.0
    """Standard deviation of the camera noise [grey levels]."""
    depth_noise_mm: float = 0.0
    """Standard deviation of measured depth at 1 m [mm]; it grows with the square of the distance."""


@dataclass(frozen=True)
class CameraSpec:
    """One `[[camera]]`: eye-to-hand by `look_from`/`look_at`, eye-in-hand by `mount`."""

    name: str
    look_from: Vector3 | None = None
    look_at: Vector3 | None = None
    mount: str | None = None
    """What carries the camera: a robot link, `tool`, `flange`, or an object such as a tripod."""
    xyz: Vector3 = (0.0, 0.0, 0.0)
    """Camera position in the mount's frame [m]."""
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    """Camera orientation in the mount's frame; the camera looks along its own +z [deg]."""
    fov_deg: float = 50.0
    """Vertical field of view [deg]."""
    size: tuple[int, int] = (640, 480)
    """Width and height [px]."""
    depth: bool = False
    """Whether it also measures depth, as an RGB-D camera does."""


@dataclass(frozen=True)
class AttachSpec:
    """A point fixed to a body: the pixel where it is seen in the first frame."""

    body: str
    point: Vector3 = (0.0, 0.0, 0.0)
    """In the body's frame [m]."""


@dataclass(frozen=True)
class NoiseSpec:
    """How a `projected` tracker errs."""

    kind: str = "perfect"
    """`perfect`, `integer` (whole pixels), `gaussian`, or `distance` (grows with it)."""
    sigma_px: float = 0.0
    """Standard deviation of `gaussian`, and of `distance` at `at_m` metres [px]."""
    at_m: float = 1.0
    """Distance to the camera at which the noise has the deviation `sigma_px`; only for `distance` [m]."""
    drift_px_s: float = 0.0
    """Speed at which it walks off, always in the same direction [px/s]."""
    occluded: tuple[tuple[float, float], ...] = ()
    """Spans of time, begin and end, during which it is lost [s]."""
    jump_px: float = 0.0
    """How far a single frame is off, every `jump_every_s` [px]."""
    jump_every_s: float = 0.0
    """Time from one such frame to the next [s]."""


@dataclass(frozen=True)
class TrackerSpec:
    """One `[[tracker]]`: placed by `at` or by `attach`."""

    name: str
    camera: str
    kind: str = "auto"
    at: tuple[float, float] | None = None
    """Pixel (column, row) in the first frame."""
    to: tuple[float, float] | None = None
    """The line's other end, as `at`; only for `line`."""
    attach: AttachSpec | None = None
    attach_to: AttachSpec | None = None
    """The line's other end, as `attach`; only for `line`."""
    noise: NoiseSpec | None = None
    """Only for `projected`."""
    size_px: float | None = None
    """Side of the square region that an image tracker holds on to; None lets it choose [px]."""


@dataclass(frozen=True)
class ConstraintSpec:
    """One `[[constraint]]`: a kind and the trackers that it ties, moving feature(s) first."""

    name: str
    kind: str
    points: tuple[str, ...]
    weight: float = 1.0
    priority: int = 1
    """1 is the most important; a constraint of a higher number moves the arm only where those of lower
    numbers leave it free."""


@dataclass(frozen=True)
class ScriptSpec:
    """One `[[script]]` entry: what happens at which simulated time."""

    at_s: float
    do: str
    arguments: dict[str, Any] = field(default_factory=dict, metadata={"prefix": ""})
    """The entry's other keys, passed to the action."""


@dataclass(frozen=True)
class DistanceSpec:
    """Ground truth for judging: the distance of a point of `of` to a point of `to`."""

    of: str
    to: str
    max: float
    """Largest allowed distance [mm]."""
    point: Vector3 = (0.0, 0.0, 0.0)
    """In the frame of `of` [m]."""
    at: Vector3 = (0.0, 0.0, 0.0)
    """In the frame of `to` [m]."""
    along: Vector3 | None = None
    """Direction in the frame of `to` along which being off does not count, for goals that are lines."""


@dataclass(frozen=True)
class FollowSpec:
    """Ground truth for judging: how well `of` keeps its wanted pose relative to `to` (the target) over time.

    The wanted pose is that of `[impedance]`: `offset_xyz`, `offset_rpy_deg`.
    """

    to: str
    of: str = "tool"
    from_s: float = 0.0
    until_s: float = 1e5
    rms_mm: float | None = None
    """Largest root mean square distance [mm]."""
    rms_deg: float | None = None
    """Largest root mean square angle [deg]."""
    mean_mm: float | None = None
    """Largest length of the mean offset: a stationary bias [mm]."""


@dataclass(frozen=True)
class ClearanceSpec:
    """Ground truth for judging: how near the arm may come to a body during the whole run."""

    to: str
    """An object, or `table`."""
    min: float
    """Smallest allowed distance between the arm's skeleton and the body's surface [mm]."""


@dataclass(frozen=True)
class ExpectSpec:
    """The `[expect]` table: what a headless run must end with; None leaves a row unchecked."""

    outcome: str | None = None
    reason: str | None = None
    within_s: float | None = None
    final_error_px: float | None = None
    final_distance_mm: DistanceSpec | None = None
    max_joint_motion_after_deg: float | None = None
    """Largest joint motion after the run's end is declared: proof that the arm is at rest [deg]."""
    follow: tuple[FollowSpec, ...] = ()
    clearance: tuple[ClearanceSpec, ...] = ()
    recovered_mm: float | None = None
    """Largest distance at the end between the tool's true position and the one recovered from the cameras
    with the learned calibration [mm]."""


@dataclass(frozen=True)
class Scenario:
    """A whole scenario file."""

    title: str = "Untitled task"
    seed: int = 0
    scene: SceneSpec = SceneSpec()
    camera: tuple[CameraSpec, ...] = ()
    tracker: tuple[TrackerSpec, ...] = ()
    constraint: tuple[ConstraintSpec, ...] = ()
    servo: ServoConfig = ServoConfig()
    impedance: ImpedanceConfig = ImpedanceConfig()
    limits: Limits = Limits()
    script: tuple[ScriptSpec, ...] = ()
    expect: ExpectSpec | None = None
    description: str = ""
    """A sentence or two shown in the page when the task is opened."""
    mode: str = "uvs"
    """What Start does: `uvs`, uncalibrated visual servoing of the drawn constraints, or `impedance`,
    following a marker seen in stereo with a virtual mass (`[impedance]`)."""
    schema: int = SCHEMA
    extra: dict[str, Any] = field(default_factory=dict, hash=False, metadata={"prefix": "x-"})
    """What other programs put into the file, under top-level keys that begin with `x-`; kept and written
    back."""
