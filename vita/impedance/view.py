"""What this mode publishes of itself after every tick, for the page, recordings and experiments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from vita.types import Array

Phase = Literal["idle", "looking", "calibrating", "following", "waiting"]
"""`looking`: for the markers, before anything moves. `calibrating`: small motions to learn where the cameras
stand. `following`: drawn to the target. `waiting`: the target is not seen, the tool stays where it is."""


@dataclass(frozen=True, eq=False)
class Capsule:
    """A thick segment, in the robot's base frame: part of a person or obstacle."""

    body: str
    start: Array
    """(3,) one end of its axis [m]."""
    end: Array
    """(3,) the other end; the same point makes a sphere [m]."""
    radius: float
    """[m]."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Points of what a depth camera sees near the arm, in the robot's base frame; the arm itself, what it
    carries and the table are left out."""

    points: Array
    """(k, 3) [m]."""
    normals: Array
    """(k, 3) unit normals, towards the camera: D_h of TUM eq. 21."""


@dataclass(frozen=True, eq=False)
class ImpedanceView:
    """One instant. Positions are in the robot's base frame [m], forces in newtons; None is unknown."""

    phase: Phase = "idle"
    T_base_left: Array | None = None
    """(4, 4) where the left camera stands, as learned."""
    calibration_mm: float = float("nan")
    """What the calibration leaves of its pairs, root mean square [mm]."""
    pairs: int = 0
    """Pairs that the calibration rests on."""
    tool_fk: Array | None = None
    """(3,) centre of the tool's marker, by the joints."""
    tool_seen: Array | None = None
    """(3,) the same by the cameras and the learned calibration: the recovered position of TUM figure 7."""
    T_base_target: Array | None = None
    """(4, 4) the target marker, by the cameras and the learned calibration."""
    target_age_s: float = float("inf")
    """Time since the target was last seen [s]."""
    T_base_goal: Array | None = None
    """(4, 4) where the tool is to be."""
    T_base_mass: Array | None = None
    """(4, 4) the virtual mass: where the tool is sent."""
    forces: Mapping[str, Array] = field(default_factory=dict)
    """`target`, `table`, `base`, `singularity`, `people` to (3,) force on the mass; only those that act."""
    distances: Mapping[str, float] = field(default_factory=dict)
    """`table`, `base`, `people` to metres, `singularity` to degrees: how far each is."""
    energy_j: float = 0.0
    """Kinetic and potential energy of the mass [J]."""
    error_mm: float = float("nan")
    """Distance of the tool from its goal, as seen [mm]."""
    error_deg: float = float("nan")
    """Angle between the tool and its goal, as seen [deg]."""
    corners: Mapping[tuple[str, str], Array] = field(default_factory=dict)
    """(camera, `tool` or `target`) to (4, 2) corners of the marker in that picture [px]."""
    obstacles: tuple[Capsule, ...] = ()
    """What the arm keeps clear of now."""
    surface: Surface | None = None
    """The same from a depth camera, where one is used."""
