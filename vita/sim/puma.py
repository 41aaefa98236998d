"""The Puma 560 from its published figures, in Corke's standard form.

The base's frame is at the height of the shoulder; at zero the upper arm points forwards and the forearm up.
"""

from __future__ import annotations

import numpy as np

from vita.sim.arm_spec import ArmSpec, Cylinder
from vita.sim.dh import DHChain
from vita.sim.puma_shapes import BODIES, COLORS

HALF = np.pi / 2
LIMITS_DEG = ((-160, 160), (-45, 225), (-225, 45), (-110, 170), (-100, 100), (-266, 266))
SPEEDS_DEG = (82, 74, 122, 228, 241, 228)
"""Joint speeds [deg/s]. Publications disagree (some allow several times as much for short times); these are
the cautious ones that are usually given for the arm with its own controller."""

PUMA = ArmSpec(
    name="puma560",
    folder="puma560",
    chain=DHChain(
        (0.0, 0.4318, 0.0203, 0.0, 0.0, 0.0),
        (0.0, 0.0, 0.15005, 0.4318, 0.0, 0.0),
        (HALF, 0.0, -HALF, HALF, -HALF, 0.0),
        (0.0,) * 6,
    ),
    base_height=0.6718,
    tool_reach=0.05625,  # The chain ends in the middle of the wrist, the arm at its flange.
    limits=tuple((float(np.radians(low)), float(np.radians(high))) for low, high in LIMITS_DEG),
    speeds=tuple(float(np.radians(speed)) for speed in SPEEDS_DEG),
    torques=(97.6, 186.4, 89.4, 24.2, 20.1, 21.3),
    # Links 2 to 6 as weighed by Armstrong and others; base and link 1 are estimates.
    masses=(20.0, 13.0, 17.4, 4.8, 0.82, 0.34, 0.09),
    hulls=(
        Cylinder(0.10, 0.52, (0, 0, -0.41)),
        Cylinder(0.104, 0.30, (0, -0.038, 0), "y"),
        Cylinder(0.085, 0.58, (0.16, 0, 0.243), "x"),
        Cylinder(0.058, 0.46, (0.012, 0.15, 0.15), "y"),
        Cylinder(0.036, 0.06, (0, 0, 0.42)),
        Cylinder(0.027, 0.05, (0, 0, 0)),
        Cylinder(0.031, 0.02, (0, 0, 0.046)),
    ),
    meshes=("base", "link1", "link2", "link3", "link4", "link5", "link6"),
    ready=(0.2713, 0.4974, -3.2127, 0.0, -0.4263, 0.2713),
    landmarks=(1, 2, 4),
    colors=COLORS,
    drawings=BODIES,
)
