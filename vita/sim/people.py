"""People and other obstacles: figures to look at, and the thick segments that enclose them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vita.sim.meshes import shape_visual, sphere_visual
from vita.sim.paints import CANVAS, DARK, DENIM, HAIR, ORANGE, SKIN, TEAL
from vita.sim.shapes import Solid, capsule, loft
from vita.sim.shapes import ball as round_solid
from vita.types import Visual

Point = tuple[float, float, float]
Color = tuple[float, float, float]

BALL_RADIUS = 0.06
FLOOR = -0.76
"""Where a person's feet are: the floor beside the table, in the frame of the mounting plane [m]."""
HAND: Point = (0.50, -0.12, 0.14)
"""The hand that is stretched forward: a target's handle belongs here, in the person's frame [m]."""
ELBOW: Point = (0.20, -0.23, 0.31)
SHOULDER: Point = (0.0, -0.20, 0.58)
HIPS = ((0.0, 0.06, 0.12), (0.04, 0.096, 0.16), (0.13, 0.10, 0.164))
JUMPER = (
    (0.10, 0.104, 0.170), (0.112, 0.112, 0.177), (0.22, 0.108, 0.174), (0.34, 0.104, 0.168),
    (0.48, 0.112, 0.19), (0.57, 0.105, 0.20), (0.625, 0.075, 0.15), (0.66, 0.045, 0.06),
)  # fmt: skip
OTHER_ARM: tuple[Point, Point, Point] = ((0.0, 0.20, 0.58), (-0.03, 0.25, 0.30), (0.08, 0.23, 0.03))


def person(body: str) -> tuple[Visual, ...]:
    """A standing figure, 1.75 m tall, that looks along its x axis with its right hand stretched forward.

    The origin is on its axis at the height of the mounting plane; the feet are FLOOR below it, the crown
    0.99 m above.
    """
    drawn = [
        _trunk(body, HIPS, DENIM),
        _trunk(body, JUMPER, TEAL),
        _solid(body, capsule((0.0, 0.0, 0.64), (0.01, 0.0, 0.74), 0.05, 0.046), SKIN),
        _solid(body, _stretched(0.105, (0.015, 0.0, 0.855), (0.95, 0.82, 1.16)), SKIN),
        _solid(body, _stretched(0.107, (-0.008, 0.0, 0.878), (0.93, 0.87, 1.04)), HAIR),
        _solid(body, _stretched(0.016, (0.118, 0.0, 0.845), (1.0, 0.8, 1.2)), SKIN),
        *(sphere_visual(body, 0.012, DARK, (0.104, y, 0.875), segments=16) for y in (-0.035, 0.035)),
    ]
    for y in (-0.09, 0.09):
        drawn += [
            _solid(body, capsule((0.0, y, FLOOR + 0.10), (0.0, 0.9 * y, 0.10), 0.055, 0.08), DENIM),
            _solid(body, _stretched(0.05, (0.05, y, FLOOR + 0.05), (2.8, 1.0, 1.0)), CANVAS),
        ]
    for shoulder, elbow, hand in ((SHOULDER, ELBOW, HAND), OTHER_ARM):
        drawn += [
            _solid(body, capsule(shoulder, elbow, 0.056, 0.046), TEAL),
            _solid(body, capsule(elbow, hand, 0.046, 0.036), TEAL),
            _solid(body, _stretched(0.045, hand, (1.0, 0.9, 1.0)), SKIN),
        ]
    return tuple(drawn)


def ball(body: str) -> tuple[Visual, ...]:
    """A plain ball of radius BALL_RADIUS about the origin: the simplest obstacle."""
    return (sphere_visual(body, BALL_RADIUS, ORANGE, segments=36),)


SEGMENTS: dict[str, tuple[tuple[Point, Point, float], ...]] = {
    "person": (
        *(((0.0, y, FLOOR + 0.10), (0.0, 0.9 * y, 0.10), 0.09) for y in (-0.09, 0.09)),
        *(((-0.04, y, FLOOR + 0.05), (0.14, y, FLOOR + 0.05), 0.055) for y in (-0.09, 0.09)),
        *(((0.0, y, 0.09), (0.0, y, 0.54), 0.14) for y in (-0.08, 0.08)),
        ((0.005, 0.0, 0.66), (0.005, 0.0, 0.87), 0.135),
        *((a, b, 0.058) for a, b in ((SHOULDER, ELBOW), (ELBOW, HAND))),
        *((a, b, 0.058) for a, b in zip(OTHER_ARM, OTHER_ARM[1:], strict=False)),
    ),
    "ball": (((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), BALL_RADIUS),),
}
"""Object kind to the segments (start, end, radius) in its own frame that enclose all of it [m]."""


def _trunk(body: str, levels: Sequence[tuple[float, float, float]], color: Color) -> Visual:
    """A part of the trunk: ellipses of (height, half depth, half width)."""
    turn = np.linspace(0.0, 2 * np.pi, 32, endpoint=False)
    rings = [
        np.column_stack([depth * np.cos(turn), wide * np.sin(turn), np.full(turn.shape, z)])
        for z, depth, wide in levels
    ]
    return _solid(body, loft(np.array(rings)), color)


def _stretched(radius: float, centre: Point, by: Point) -> Solid:
    """An ellipsoid whose half axes are `radius` times `by`."""
    solid = round_solid(radius, sections=24, rings=16)
    return Solid(solid.vertices * np.array(by) + np.array(centre), solid.faces)


def _solid(body: str, solid: Solid, color: Color) -> Visual:
    return shape_visual(body, solid.vertices, solid.faces, color)
