"""Thin bodies of revolution for the 3D view: what is kept clear of, and from how far."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vita.types import Array

SIDES = 20
"""Corners of each ring."""
Body = tuple[NDArray[np.float32], NDArray[np.uint32]]
"""(v, 3) vertices [m] and (f, 3) faces, counter-clockwise seen from outside."""


def capsule(length: float, radius: float) -> Body:
    """A cylinder along z from 0 to `length` with a half sphere on each end."""
    quarter = np.linspace(0.0, np.pi / 2, 6)
    rings = [(np.cos(a) * radius, -np.sin(a) * radius) for a in quarter[::-1]]
    rings += [(np.cos(a) * radius, length + np.sin(a) * radius) for a in quarter]
    return _turned(rings)


def tube(length: float, radius: float) -> Body:
    """An open cylinder along z from 0 to `length`."""
    return _turned([(radius, 0.0), (radius, length)])


def sheet(radius: float) -> Body:
    """A disc in z = 0, seen from above."""
    return _turned([(radius, 0.0), (0.0, 0.0)])


def _turned(rings: list[tuple[float, float]]) -> Body:
    """The body whose outline is the points (distance from the axis, height), from below to above."""
    turn = np.linspace(0.0, 2 * np.pi, SIDES, endpoint=False)
    vertices = np.array([[r * np.cos(t), r * np.sin(t), z] for r, z in rings for t in turn], np.float32)
    faces = []
    for ring in range(len(rings) - 1):
        for side in range(SIDES):
            a, b = ring * SIDES + side, ring * SIDES + (side + 1) % SIDES
            faces += [[a, b, b + SIDES], [a, b + SIDES, a + SIDES]]
    return vertices, np.array(faces, np.uint32)


def along(start: Array, end: Array) -> Array:
    """(4, 4) pose whose origin is `start` and whose z axis points to `end`, each (3,) [m]."""
    direction = np.asarray(end, float) - start
    length = float(np.linalg.norm(direction))
    z = direction / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, np.cross(z, x), z, start
    return T
