"""An industrial arm of the dimensions of a Staubli TX90, from its published figures.

The base's frame is on the mounting plane; at zero the arm points straight up.
"""

from __future__ import annotations

import numpy as np

from vita.sim.arm_spec import ArmSpec, Cylinder
from vita.sim.dh import DHChain
from vita.sim.tx90_shapes import BODIES, COLORS

HALF = np.pi / 2

TX90 = ArmSpec(
    name="tx90",
    folder="tx90",
    chain=DHChain(
        (0.05, 0.425, 0, 0, 0, 0),
        (0.478, 0.05, 0, 0.425, 0, 0.1),
        (-HALF, 0, HALF, -HALF, HALF, 0),
        (0, -HALF, HALF, 0, 0, 0),
    ),
    base_height=0.0,
    tool_reach=0.0,
    limits=((-3.14, 3.14), (-2.27, 2.57), (-2.53, 2.53), (-4.71, 4.71), (-2.01, 2.44), (-4.71, 4.71)),
    speeds=(4.36, 3.49, 5.24, 7.50, 6.11, 10.47),
    # Torques and the shares of the arm's 111 kg are estimates: the maker publishes neither.
    torques=(318.0, 166.0, 76.0, 34.0, 29.0, 11.0),
    masses=(26.0, 34.0, 26.0, 14.0, 8.0, 2.4, 0.6),
    hulls=(
        Cylinder(0.14, 0.20, (0, 0, 0.10)),
        Cylinder(0.125, 0.26, (0.025, 0, 0.40)),
        Cylinder(0.105, 0.44, (0.2125, 0, 0.165), "x"),
        Cylinder(0.092, 0.17, (0, -0.06, -0.01), "y"),
        Cylinder(0.066, 0.26, (0, 0, 0.30)),
        Cylinder(0.042, 0.09, (0, -0.02, 0), "y"),
        Cylinder(0.037, 0.027, (0, 0, 0.0865)),
    ),
    meshes=("base", "link1", "link2", "link3", "link4", "link5", "link6"),
    ready=(-0.0894, 0.5602, 1.8561, 0.0, 0.7253, -0.0894),
    landmarks=(1, 2, 4),
    colors=COLORS,
    drawings=BODIES,
)
