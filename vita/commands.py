"""Everything that a person or script can ask of the engine while it lives, as plain data.

The page, scripts and tests all speak through these; the engine applies them at the start of a
tick (`Engine.apply`), one after the other. Stop and emergency stop are not among the queued ones: they
are flags on the runner, so that nothing can stand in front of them.
"""

from __future__ import annotations

from dataclasses import dataclass

from vita.scenario.schema import Scenario


@dataclass(frozen=True)
class Start:
    """Learn the Jacobian and drive the error to zero."""

    relearn: bool = True
    """False keeps the Jacobian of the last run where every row is still known."""


@dataclass(frozen=True)
class Halt:
    """Stop in a script; the page uses `Runner.stop()`, which does not queue."""


@dataclass(frozen=True)
class Acknowledge:
    """Leave a fault for idle. Never moves the arm."""


@dataclass(frozen=True)
class Reset:
    """Leave an emergency stop for idle. Never moves the arm; Start is a second act."""

    confirm: bool = False
    """Whoever sends it has been asked whether it is safe, and has said yes."""


@dataclass(frozen=True)
class Inject:
    """Make a fault of the catalogue happen (`vita.faults`); simulation only."""

    fault: str
    """Row of the catalogue, such as `V5`."""


@dataclass(frozen=True)
class Mend:
    """Take back every fault that was injected."""


@dataclass(frozen=True)
class AddTracker:
    """Place a tracker at a pixel of the current frame."""

    camera: str
    uv: tuple[float, float]
    kind: str = "auto"
    name: str | None = None
    """None picks the next free name."""
    to: tuple[float, float] | None = None
    """The other end of a line."""


@dataclass(frozen=True)
class MoveTracker:
    """Place a tracker afresh at `uv`; a line keeps its direction and length unless `to` is given."""

    name: str
    uv: tuple[float, float]
    to: tuple[float, float] | None = None


@dataclass(frozen=True)
class RenameTracker:
    name: str
    new: str


@dataclass(frozen=True)
class DeleteTracker:
    """Delete a tracker and the constraints that use it (undo brings both back)."""

    name: str


@dataclass(frozen=True)
class AddConstraint:
    kind: str
    points: tuple[str, ...]
    weight: float = 1.0
    name: str | None = None


@dataclass(frozen=True)
class DeleteConstraint:
    name: str


@dataclass(frozen=True)
class SetWeight:
    name: str
    weight: float


@dataclass(frozen=True)
class SetPriority:
    name: str
    priority: int
    """1 is the most important."""


@dataclass(frozen=True)
class ClearTask:
    """Delete every tracker and constraint (undo brings them back)."""


@dataclass(frozen=True)
class Undo:
    pass


@dataclass(frozen=True)
class Redo:
    pass


@dataclass(frozen=True)
class SetServo:
    """Change one field of `ServoConfig`; in force from the next control period on."""

    field: str
    value: object


@dataclass(frozen=True)
class SetMode:
    """Choose what Start does: `uvs` or `impedance`. Not while the arm moves."""

    mode: str


@dataclass(frozen=True)
class SetImpedance:
    """Change one field of `ImpedanceConfig`; in force from the next control period on."""

    field: str
    value: object


@dataclass(frozen=True)
class SetLimits:
    """Change one field of `Limits` (`speed_rad_s`, ...)."""

    field: str
    value: float


@dataclass(frozen=True)
class SetJointLimit:
    """Change one joint's limits; None keeps the present value."""

    joint: int
    lower_deg: float | None = None
    upper_deg: float | None = None
    speed_rad_s: float | None = None


@dataclass(frozen=True)
class ResetArm:
    """Put the simulated arm and scene back to the start."""


@dataclass(frozen=True)
class LoadTask:
    """Take the trackers, constraints, servo settings and limits of a scenario.

    When its scene or cameras differ from the rig's, the runner builds a new rig first.
    """

    scenario: Scenario


@dataclass(frozen=True)
class Perform:
    """A script action on the simulated rig (move_camera, freeze_camera, drag_target, ...)."""

    action: str
    arguments: dict[str, object]


Command = (
    Start
    | Halt
    | Acknowledge
    | Reset
    | Inject
    | Mend
    | AddTracker
    | MoveTracker
    | RenameTracker
    | DeleteTracker
    | AddConstraint
    | DeleteConstraint
    | SetWeight
    | SetPriority
    | ClearTask
    | Undo
    | Redo
    | SetServo
    | SetMode
    | SetImpedance
    | SetLimits
    | SetJointLimit
    | ResetArm
    | LoadTask
    | Perform
)
