"""The Barrett WAM with four and with seven joints, from its published figures.

The base frame of both arms is the shoulder (frame 0 of the Denavit-Hartenberg chain).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vita.sim.arm_spec import ArmSpec, Cylinder
from vita.sim.dh import DHChain
from vita.sim.wam_shapes import BODIES, COLORS

HALF = np.pi / 2
SHOULDER_HEIGHT = 0.346
"""Shoulder above the mounting plane, from the manufacturer's drawings [m]."""
SPEED = 2.0
"""Joint speed limit; published figures disagree, this is the flat one [rad/s]."""
BASE_MASS = 9.97
"""Mass of what does not move [kg]."""

LIMITS = ((-2.6, 2.6), (-2.0, 2.0), (-2.8, 2.8), (-0.9, 3.1), (-4.76, 1.24), (-1.6, 1.6), (-3.0, 3.0))
"""Joint limits [rad]."""
TORQUES = (77.3, 160.6, 95.6, 29.4, 11.6, 11.6, 2.7)
"""Joint torque limits [Nm]."""
UPPER_HULLS = (
    Cylinder(0.13, 0.2, (0, 0, -0.246)),
    Cylinder(0.14, 0.16, (0, 0, -0.06)),
    Cylinder(0.10, 0.16, (0, -0.07, 0), "y"),
    Cylinder(0.055, 0.40, (0, 0, 0.34)),
)
READY = {
    "wam4": (0.0, 0.75, 0.0, 2.0),
    "wam7": (0.0, 0.72, 0.0, 2.1, 0.0, 0.1, 0.0),
}
"""Start poses: elbow bent, hand pointing down in front of the arm [rad]."""

WAM4 = ArmSpec(
    name="wam4",
    folder="wam",
    chain=DHChain((0, 0, 0.045, -0.045), (0, 0, 0.55, 0), (-HALF, HALF, -HALF, HALF), (0,) * 4),
    base_height=SHOULDER_HEIGHT,
    tool_reach=0.35,
    limits=LIMITS[:4],
    speeds=(SPEED,) * 4,
    torques=TORQUES[:4],
    masses=(BASE_MASS, 10.77, 3.87, 1.80, 1.07),
    hulls=(*UPPER_HULLS, Cylinder(0.04, 0.33, (-0.045, -0.18, 0), "y")),
    meshes=("base", "link1", "link2", "link3", "outer"),
    ready=READY["wam4"],
    landmarks=(1, 3, 4),
    colors=COLORS,
    drawings=BODIES,
)
WAM7 = ArmSpec(
    name="wam7",
    folder="wam",
    chain=DHChain(
        (0, 0, 0.045, -0.045, 0, 0, 0),
        (0, 0, 0.55, 0, 0.30, 0, 0.0609),
        (-HALF, HALF, -HALF, HALF, -HALF, HALF, 0),
        (0,) * 7,
    ),
    base_height=SHOULDER_HEIGHT,
    tool_reach=0.0,
    limits=LIMITS,
    speeds=(SPEED,) * 7,
    torques=TORQUES,
    masses=(BASE_MASS, 10.77, 3.87, 1.80, 2.17, 0.357, 0.409, 0.075),
    hulls=(
        *UPPER_HULLS,
        Cylinder(0.045, 0.22, (-0.045, -0.11, 0), "y"),
        Cylinder(0.045, 0.08, (0, 0, 0.27)),
        Cylinder(0.035, 0.06, (0, 0, 0)),
        Cylinder(0.042, 0.02, (0, 0, 0.0509)),
    ),
    meshes=("base", "link1", "link2", "link3", "forearm", "wrist1", "wrist2", "flange"),
    ready=READY["wam7"],
    landmarks=(1, 3, 5),
    colors=COLORS,
    drawings=BODIES,
)
WAMS: Mapping[str, ArmSpec] = {"wam4": WAM4, "wam7": WAM7}
