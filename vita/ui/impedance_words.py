"""The words, colours and figures of the stereo-impedance mode. Pure, without viser."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vita.impedance.config import ImpedanceConfig
from vita.impedance.view import ImpedanceView
from vita.scenario.schema import Scenario
from vita.servo.insight import Level
from vita.snapshot import Snapshot
from vita.types import MOVING_STATES
from vita.ui.words import AMBER, BLUE, GREEN, ORANGE, RED, TEAL, Rgb
from vita.ui.words import explain as explain_uvs

PURPLE: Rgb = (147, 51, 234)
BROWN: Rgb = (146, 84, 14)
BY_JOINTS, BY_CAMERAS = TEAL, ORANGE
"""What the joints say is teal and what the cameras say is orange: in 3D, on the pictures and in the plots."""
LEAST_N = 0.05
"""A weaker force is not shown as acting [N]."""
FAR_M = 0.2
"""From this far from the goal the target's bar is empty [m]."""


@dataclass(frozen=True)
class Force:
    """One of the forces on the virtual mass."""

    key: str
    label: str
    color: Rgb
    onset: str
    """The setting that says from where on it acts; empty for the target, which always pulls."""
    hint: str


FORCES: tuple[Force, ...] = (
    Force("target", "Target", GREEN, "", "The spring that pulls the tool to its place at the target."),
    Force("table", "Table", BROWN, "table_m", "Height of the tool above the table, which pushes it up."),
    Force("base", "Own base", PURPLE, "base_m", "Distance of the tool from the arm's own base."),
    Force("people", "People", RED, "people_m", "Distance of the arm from the nearest person or obstacle."),
    Force("singularity", "Elbow", BLUE, "singular_deg", "How far the elbow is from being stretched out."),
)
FORCE = {force.key: force for force in FORCES}

STEPS = ("Look", "Learn", "Follow")
_STEP = {"idle": -1, "looking": 0, "calibrating": 1, "following": 2, "waiting": 2}


def step(view: ImpedanceView) -> int:
    """Index into `STEPS` of what goes on; -1 before Start."""
    return _STEP[view.phase]


def strength(view: ImpedanceView, key: str) -> float:
    """Size of a force, 0 when it does not act [N]."""
    force = view.forces.get(key)
    size = 0.0 if force is None else float(np.linalg.norm(force))
    return size if math.isfinite(size) and size >= LEAST_N else 0.0


def millimetres(value: float) -> str:
    """A distance in words [mm]."""
    if not math.isfinite(value):
        return "–"
    if abs(value) >= 999.5:
        return f"{value / 1000:.2f} m"
    return f"{value:.1f} mm" if abs(value) < 9.95 else f"{value:.0f} mm"


def degrees(value: float) -> str:
    if not math.isfinite(value):
        return "–"
    return f"{value:.1f} deg" if abs(value) < 9.95 else f"{value:.0f} deg"


# Sentences.

NO_MARKERS = (
    "No camera sees the markers that this mode follows. Show me an example, below, opens Follow target."
)

CHIPS: dict[str, tuple[str, Rgb]] = {
    "looking": ("Looking", BLUE), "calibrating": ("Learning", BLUE), "following": ("Following", TEAL),
    "waiting": ("Waiting", AMBER),
}


def chip(snapshot: Snapshot) -> tuple[str, Rgb] | None:
    """Word and colour of the state while the arm is at work; None leaves it to the state."""
    return CHIPS.get(snapshot.impedance.phase) if snapshot.status.state in MOVING_STATES else None


def unseen(view: ImpedanceView, config: ImpedanceConfig, marker: str) -> tuple[str, ...]:
    """The cameras, of the two, that do not see the `tool` or the `target` in the last pictures."""
    return tuple(name for name in (config.left, config.right) if (name, marker) not in view.corners)


def cameras(names: Sequence[str]) -> str:
    """`the left camera`, or `the cameras left and right`."""
    return f"the {names[0]} camera" if len(names) == 1 else f"the cameras {' and '.join(names)}"


def errors(view: ImpedanceView) -> str:
    """`2.3 mm, 0.8 deg`; empty while the target is not known."""
    parts = [millimetres(view.error_mm)] if math.isfinite(view.error_mm) else []
    if math.isfinite(view.error_deg):
        parts.append(degrees(view.error_deg))
    return ", ".join(parts)


def calibration(view: ImpedanceView) -> str:
    """`14 pairs, 2.1 mm`."""
    pairs = f"{view.pairs} pair{'' if view.pairs == 1 else 's'}"
    return f"{pairs}, {millimetres(view.calibration_mm)}" if math.isfinite(view.calibration_mm) else pairs


def explain(snapshot: Snapshot) -> str:
    """The sentence under the state chip: what goes on, and what to do next."""
    status, view, config = snapshot.status, snapshot.impedance, snapshot.scenario.impedance
    move = f"Move the {stand(snapshot.scenario)}"
    if status.state in MOVING_STATES:
        return _doing(view, config, status.reason == "cameras_moved", snapshot.progress, move)
    if status.message:
        return status.message
    if status.state == "idle":
        return NO_MARKERS if lacks_markers(snapshot) else _ready(view, config, move)
    return explain_uvs(status, 0, 0, "")


def stand(scenario: Scenario) -> str:
    """What people move to move the cameras."""
    tripods = any(thing.kind == "tripod" for thing in scenario.scene.objects)
    return "tripod" if tripods else "cameras"


def lacks_markers(snapshot: Snapshot) -> bool:
    """Whether nothing in this scene is made for this mode: no target, and no camera sees a marker of it."""
    made = any(thing.kind == "target" for thing in snapshot.scenario.scene.objects)
    return not made and not snapshot.impedance.corners


def _ready(view: ImpedanceView, config: ImpedanceConfig, move: str) -> str:
    hidden = unseen(view, config, "tool")
    if hidden:
        return (
            f"Marker {config.tool_marker} on the tool is not seen by {cameras(hidden)}. "
            f"{move}, then press Start."
        )
    if view.T_base_left is None:
        return "Press Start. The arm makes small moves to learn where the cameras stand, then it follows."
    return f"The cameras' place is known. Press Start to follow marker {config.target_marker}."


def _doing(view: ImpedanceView, config: ImpedanceConfig, moved: bool, limited: str, move: str) -> str:
    before = "Cameras moved: " if moved else ""
    if view.phase == "looking":
        hidden = unseen(view, config, "tool")
        if hidden:
            return (
                f"{before or 'Looking for the markers: '}marker {config.tool_marker} on the tool is not seen "
                f"by {cameras(hidden)}. {move} until both see it."
            )
        if moved:
            return "Cameras moved: learning again as soon as they stand still."
        return (
            f"Looking for the markers: hold marker {config.target_marker} so that both cameras see it."
            if unseen(view, config, "target") else "Looking for the markers: keep the cameras still."
        )
    if view.phase == "calibrating":
        what = "learning again" if moved else "Learning"
        return f"{before}{what} where the cameras stand: {calibration(view)}."
    if view.phase == "waiting":
        return f"Waiting: {_out_of_sight(view, config)}. {move} or the target."
    found, hidden = errors(view), unseen(view, config, "tool")
    doing = f"Following the target: {found}" if found else "Following the target"
    if len(hidden) == 2:  # Nobody would notice that the cameras were moved.
        return f"{doing}. Marker {config.tool_marker} on the tool is not seen by {cameras(hidden)}: show it."
    return f"{doing}; {limited}." if limited else f"{doing}."


def _out_of_sight(view: ImpedanceView, config: ImpedanceConfig) -> str:
    """What the arm waits for: the target has to be seen by both cameras, the tool by one."""
    target, tool = unseen(view, config, "target"), unseen(view, config, "tool")
    if len(tool) < 2:
        return f"the target is not seen by {cameras(target)}" if target else "the target is hard to see"
    if len(target) < 2:
        also = f", nor the target by {cameras(target)}" if target else ""
        return f"the tool is not seen by {cameras(tool)}{also}"
    return f"neither the target nor the tool is seen by {cameras(tool)}"


# Figures.


@dataclass(frozen=True)
class Row:
    """One force with how near its cause is."""

    force: Force
    value: str
    share: float
    """Length of the bar, 0 to 1; longer is better."""
    level: Level
    word: str


def rows(view: ImpedanceView, config: ImpedanceConfig) -> tuple[Row, ...]:
    return tuple(_row(force, view, config) for force in FORCES)


def _row(force: Force, view: ImpedanceView, config: ImpedanceConfig) -> Row:
    newton = strength(view, force.key)
    if force.key == "target":
        if not math.isfinite(view.error_mm):
            return Row(force, "–", 0.0, "info", "not known")
        level = "good" if view.error_mm <= config.done_mm else "info"
        share = 1.0 - min(1e-3 * view.error_mm / FAR_M, 1.0)
        word = f"pulls {newton:.1f} N" if newton else "no pull"
        return Row(force, millimetres(view.error_mm), share, level, word)
    distance, onset = view.distances.get(force.key, math.nan), float(getattr(config, force.onset))
    if not math.isfinite(distance):
        return Row(force, "–", 0.0, "info", "nobody near" if force.key == "people" else "not known")
    value = degrees(distance) if force.key == "singularity" else millimetres(1e3 * distance)
    if onset <= 0.0:
        return Row(force, value, 1.0, "info", "switched off")
    share = min(max(distance / (2.0 * onset), 0.0), 1.0)
    if distance <= (config.stop_m if force.key == "people" else 0.0):
        level, word = "bad", "too near"
    else:
        level, word = ("warning", "near") if newton or distance < onset else ("good", "free")
    return Row(force, value, share, level, f"pushes {newton:.1f} N" if newton else word)

