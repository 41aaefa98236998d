"""A simple three-finger hand for the flange, drawn in the tool frame (z points out of the flange)."""

from __future__ import annotations

import numpy as np

from vita.sim.shapes import (
    Solid,
    band,
    capsule,
    drum,
    fillet,
    frame_along,
    joined,
    lathe,
    rounded_rectangle,
    slab,
    stadium,
)
from vita.sim.urdf_visuals import visual
from vita.sim.wam_shapes import COLORS
from vita.types import Array, Visual

PALM = 0.078
"""Height of the palm above the flange [m]."""
FINGERS_DEG = (0.0, 125.0, 235.0)
"""Directions of the three fingers about z: one against two."""
KNUCKLE_RADIUS = 0.040
"""Distance of the knuckles from the axis [m]."""
BEND_DEG = (32.0, -14.0)
"""Lean of the inner and the outer finger link away from z."""
LENGTHS = (0.070, 0.056)
"""Lengths of the inner and the outer finger link [m]."""


def hand_visuals() -> tuple[Visual, ...]:
    """The hand in the body `tool`, half open, about 0.2 m long."""
    parts: dict[str, list[Solid]] = {"white": [], "black": [], "metal": []}
    profile = [(0.001, 0.0), (0.044, 0.0), (0.044, 0.022), (0.038, 0.030), (0.001, 0.030)]
    wrist = lathe(fillet(profile, 0.003))
    palm = slab(rounded_rectangle(0.088, 0.084, 0.034), 0.028, PALM, 0.006)
    pad = drum(0.026, PALM - 0.002, PALM + 0.002, 0.001)
    parts["metal"].append(wrist)
    parts["white"].append(palm)
    parts["black"] += [band(0.0448, 0.006, 0.014), pad]
    for direction in FINGERS_DEG:
        for color, solid in _finger():
            parts[color].append(solid.moved(_about_z(direction)))
    return tuple(visual("tool", joined(solids), COLORS[color]) for color, solids in parts.items())


def _finger() -> list[tuple[str, Solid]]:
    """One finger in the plane y = 0, leaning towards +x."""
    knuckle = np.array([KNUCKLE_RADIUS, 0.0, PALM + 0.002])
    lean = [np.radians(b) for b in BEND_DEG]
    ways = [np.array([np.sin(t), 0.0, np.cos(t)]) for t in lean]
    middle = knuckle + LENGTHS[0] * ways[0]
    tip = middle + LENGTHS[1] * ways[1]
    inner = slab(stadium((0.0, 0.0), (0.0, LENGTHS[0]), 0.0125, 0.0095), -0.0085, 0.0085, 0.002)
    joints = [
        drum(0.0145, -0.014, 0.014, 0.002).moved(_pin(knuckle, ways[0])),
        drum(0.0098, -0.011, 0.011, 0.002).moved(_pin(middle, ways[0])),
    ]
    outer = capsule(middle, tip, 0.0085, 0.006)
    pad = capsule(middle + 0.6 * (tip - middle), tip + 0.001 * ways[1], 0.0078, 0.0068)
    return [
        ("white", inner.moved(_pin(knuckle, ways[0]))),
        ("black", joined(joints)),
        ("metal", outer),
        ("black", pad),
    ]


def _pin(at: Array, along: Array) -> Array:
    """(4, 4) a frame whose z is the pin of a finger joint (the y axis) and whose y runs along the link."""
    T = frame_along(at, [0.0, 1.0, 0.0])
    T[:3, 1] = along
    T[:3, 0] = np.cross(T[:3, 1], T[:3, 2])
    return T


def _about_z(degrees: float) -> Array:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
