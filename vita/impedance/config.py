"""The settings of the stereo-impedance mode, defined once: file, `--set`, sliders and docs read them here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.errors import BadInput
from vita.servo.config import check_ranges, setting

Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class ImpedanceConfig:
    """The `[impedance]` table of a scenario file. Numbers with a range are tunable while the arm moves."""

    # What is seen.
    left: str = "left"
    """The camera whose frame is the stereo system's."""
    right: str = "right"
    """The other camera."""
    rig_file: str = ""
    """File of `vita calibrate` that holds the lenses and how the cameras stand to one another, relative to
    the scenario's; empty takes what the scenario says of its cameras."""
    tool_marker: int = 7
    """Number of the ArUco marker (6 x 6 dictionary) on the tool."""
    target_marker: int = 5
    """Number of the marker on the target."""
    tool_marker_m: float = 0.05
    """Side of the tool's marker, black frame included [m]."""
    target_marker_m: float = 0.08
    """Side of the target's marker [m]."""
    tool_marker_xyz: Vector3 = (0.0, 0.0, 0.085)
    """The marker's centre in the tool frame [m]; the robot's own drawing gives it. The default is that of
    the tool `marker_tool`."""
    tool_marker_rpy_deg: Vector3 = (-90.0, 0.0, 90.0)
    """The marker's orientation in the tool frame [deg]: it looks along the tool's -x, with its up along -z,
    so that it faces cameras in front of the arm while the tool points down."""
    tool_tip_xyz: Vector3 = (0.0, 0.0, 0.14)
    """The tool's far end in the tool frame [m]: table and people are kept clear of it as well. The default is
    that of `marker_tool`."""
    offset_xyz: Vector3 = (0.0, 0.235, 0.0)
    """Where the tool frame is to be in the target marker's frame (x right, y up, z out of its face) [m]. By
    default the tool's marker ends 0.15 m above the target's, so that neither covers the other."""
    offset_rpy_deg: Vector3 = (90.0, 90.0, 0.0)
    """The tool's wanted orientation in the target marker's frame [deg]; by default the two are parallel."""
    depth: str = ""
    """Camera whose depth picture shows obstacles; empty uses the capsules that the rig knows of."""

    # The virtual mass (TUM eq. 13 to 17).
    mass_kg: float = setting(1.0, 0.1, 20.0, "kg", "Mass", "Virtual mass at the tool (eq. 13).")
    stiffness: float = setting(
        100.0, 5.0, 1000.0, "N/m", "Stiffness K_m", "Spring between the mass and the target (eq. 16)."
    )
    damping: float = setting(
        20.0, 1.0, 400.0, "N s/m", "Damping B_m", "Damper of the mass (eq. 16), counted once."
    )
    pull_n: float = setting(
        10.0, 0.5, 100.0, "N", "Largest pull", "The spring never pulls harder than this, however far."
    )
    feed_forward: float = setting(
        1.0, 0.0, 1.0, "", "Feed-forward", "Share of the target's velocity that the mass goes along with."
    )
    turn: bool = True
    """Whether the tool also takes the target's orientation; an arm of four joints cannot."""
    turn_stiffness: float = setting(
        100.0, 5.0, 1000.0, "/s2", "Turning stiffness", "Spring of the orientation, per unit of inertia."
    )
    turn_damping: float = setting(
        20.0, 1.0, 400.0, "/s", "Turning damping", "Damper of the orientation, per unit of inertia."
    )

    # Repulsion (TUM eq. 18 to 21): force K (exp(alpha (onset - distance)) - 1) within the onset.
    push_n: float = setting(
        12.0, 0.0, 100.0, "N", "Repulsion K", "Gain with which table, base and people repel (eq. 19 to 21)."
    )
    steepness: float = setting(
        20.0, 1.0, 100.0, "/m", "Steepness alpha", "How fast the repulsion grows with nearness."
    )
    table_m: float = setting(
        0.10, 0.0, 0.5, "m", "Table distance", "The table repels the tool below this height (eq. 19)."
    )
    table_z: float = 0.0
    """Height of the table's top in the robot's base frame [m]."""
    base_m: float = setting(
        0.35, 0.0, 1.0, "m", "Base distance", "The base's axis repels the tool within this radius (eq. 20)."
    )
    base_stop_m: float = setting(
        0.20, 0.0, 1.0, "m", "Base limit", "Nearer than this to the base's axis the tool only moves away."
    )
    people_m: float = setting(
        0.20, 0.02, 1.0, "m", "People distance", "Obstacles and people repel the arm within this (eq. 21)."
    )
    around: float = setting(
        0.3, 0.0, 1.0, "", "Go around", "Share of the repulsion that acts sideways, to pass an obstacle."
    )
    singular_deg: float = setting(
        25.0, 0.0, 90.0, "deg", "Singular distance", "An elbow straighter than this is pushed back (eq. 18)."
    )
    singular_n: float = setting(
        12.0, 0.0, 100.0, "N", "Singularity gain", "Gain of that push (eq. 18)."
    )
    singular_steepness: float = setting(
        12.0, 1.0, 50.0, "/rad", "Singularity alpha", "How fast that push grows (eq. 18)."
    )
    stop_m: float = setting(
        0.03, 0.0, 0.3, "m", "Stop distance", "Nearer than this to a person the arm only moves away."
    )
    top_speed: float = setting(
        0.5, 0.02, 2.0, "m/s", "Top speed", "The virtual mass never moves faster than this."
    )

    # On-line calibration (TUM II-C).
    wiggle_m: float = setting(
        0.06, 0.01, 0.2, "m", "Calibration motion", "How far the arm moves to each side to learn the cameras."
    )
    moved_mm: float = setting(
        30.0, 3.0, 200.0, "mm", "Moved cameras",
        "The cameras are taken to have moved when the tool is seen this far from where it is.",
    )
    moved_frames: int = 5
    """Pictures in a row that must say so."""

    # The end.
    follow: bool = True
    """Go on following; false ends the run as converged once the tool has come to rest at the target."""
    done_mm: float = setting(3.0, 0.1, 50.0, "mm", "Done within", "How near counts as arrived.")
    done_deg: float = setting(
        2.0, 0.1, 45.0, "deg", "Done within angle", "How well turned counts as arrived."
    )
    patience_s: float = setting(
        60.0, 1.0, 3600.0, "s", "Wait for the target", "How long to wait for a target that is not seen."
    )
    timeout_s: float = setting(
        120.0, 1.0, 3600.0, "s", "Give up after", "Longest time from Start to done; only without follow."
    )

    def __post_init__(self) -> None:
        check_ranges(self, "impedance")
        for name in ("left", "right", "depth", "rig_file"):
            if not isinstance(getattr(self, name), str):
                raise BadInput(f"expected a name, got {getattr(self, name)!r}", f"impedance.{name}")
        for name in ("turn", "follow"):
            if not isinstance(getattr(self, name), bool):
                raise BadInput(f"expected true or false, got {getattr(self, name)!r}", f"impedance.{name}")
        for name, lowest, highest in (
            ("tool_marker", 0, 249), ("target_marker", 0, 249), ("moved_frames", 1, 100),
        ):  # fmt: skip
            _check_whole(getattr(self, name), lowest, highest, f"impedance.{name}")
        for name, lowest, highest in (
            ("tool_marker_m", 0.005, 1.0), ("target_marker_m", 0.005, 1.0), ("table_z", -1.0, 2.0),
        ):  # fmt: skip
            _check_number(getattr(self, name), lowest, highest, f"impedance.{name}")
        for name in VECTORS:
            object.__setattr__(self, name, _vector(getattr(self, name), f"impedance.{name}"))
        if self.left == self.right:
            raise BadInput(f"two different cameras are needed, both are {self.left!r}", "impedance.right")
        if self.tool_marker == self.target_marker:
            why = f"tool and target need different markers, both have {self.tool_marker}"
            raise BadInput(why, "impedance.target_marker")


VECTORS = ("tool_marker_xyz", "tool_marker_rpy_deg", "tool_tip_xyz", "offset_xyz", "offset_rpy_deg")


def _check_whole(value: object, lowest: int, highest: int, path: str) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not lowest <= value <= highest:
        raise BadInput(f"expected a whole number from {lowest} to {highest}, got {value!r}", path)


def _check_number(value: object, lowest: float, highest: float, path: str) -> None:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not lowest <= value <= highest:  # type: ignore[operator]
        raise BadInput(f"expected a number from {lowest:g} to {highest:g} m, got {value!r}", path)


def _vector(value: object, path: str) -> Vector3:
    """Three finite numbers of at most 3600, as a client or a file may give them."""
    try:
        values = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        values = np.array(np.nan)
    if values.shape != (3,) or not np.isfinite(values).all() or np.abs(values).max() > 3600:
        raise BadInput(f"expected three finite numbers, got {value!r}", path)
    x, y, z = values.tolist()
    return x, y, z
