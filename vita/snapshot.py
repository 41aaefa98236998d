"""The frozen picture of everything that the engine publishes after each tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from vita.impedance.view import ImpedanceView
from vita.scenario.schema import Scenario
from vita.servo.insight import Finding, Insight
from vita.types import NO_ERROR, Array, ErrorVector, Feature, Image, Joint, Notice, Status, Timing, frozen


@dataclass(frozen=True)
class Snapshot:
    """State, never deltas: whoever misses one loses nothing."""

    tick: int
    stamp: float
    """Rig time of the frames [s]."""
    status: Status
    q: Array
    """(n,) measured joint positions [rad]."""
    joints: tuple[Joint, ...]
    """Joints with the limits in force."""
    frames: Mapping[str, Image]
    """Camera name to RGB frame."""
    features: Mapping[str, Feature]
    """Tracker name to what it reported of these frames."""
    scenario: Scenario
    """Scene, cameras, trackers, constraints and the settings in force. A tracker's `at` is where
    it is now, so saving this saves what is seen."""
    error: ErrorVector = NO_ERROR
    progress: str = ""
    """What the servo is doing in a few words, e.g. `learning joint 2 of 4`."""
    jacobian: Array = field(default_factory=lambda: frozen(()))
    """(m, n) estimated image Jacobian [px/rad]; empty before it is learned."""
    can_undo: bool = False
    can_redo: bool = False
    notices: tuple[Notice, ...] = ()
    """The latest messages, oldest first; ids grow, so that a reader knows which are new."""
    timing: Timing = Timing()
    poses: Mapping[str, Array] = field(default_factory=dict)
    """Body name to (4, 4) T_world_body in simulation, for the 3D view only; see `SimulatedRig`."""
    insight: Insight | None = None
    """What the servo knows of its Jacobian; None before it has learned one."""
    findings: tuple[Finding, ...] = ()
    """The doctor's sentences on the task, and on the estimate once there is one."""
    ghost: Mapping[str, Array] = field(default_factory=dict)
    """Tracker name to (k, 2) where its feature is expected after the next step [px]; only features
    that are expected to move."""
    ghost_poses: Mapping[str, Array] = field(default_factory=dict)
    """Body name to (4, 4) T_world_body after the next step in simulation, for the 3D view only."""
    revision: int = 0
    """Grows with every change of state; a command that was made on an older one is stale."""
    injected: tuple[str, ...] = ()
    """Rows of the fault catalogue that are in force now (simulation only)."""
    evidence: str = ""
    """File of the recording that the last fault left, empty before the first."""
    impedance: ImpedanceView = ImpedanceView()
    """What the stereo-impedance mode sees and does. The mode in force is `scenario.mode`."""
