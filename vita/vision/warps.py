"""Homographies that carry a tracked region from its own square [-1, 1]^2 into the image.

A warp is a (3, 3) matrix W with W[2, 2] = 1. Small motions are given in the region's own
coordinates by the first 2, 4, 6 or 8 of eight numbers (translation, similarity, affine,
projective), see `motions`, so that one set of formulas serves every number of degrees of freedom.
"""

from __future__ import annotations

import math

import numpy as np

from vita.types import Array

_EYE = np.eye(3)
_CORNERS = np.array([[-1.0, 1.0, 1.0, -1.0], [-1.0, -1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]])


def square(center: Array, half: float) -> Array:
    """The warp of an upright square region with half side `half` [px] around pixel `center`."""
    return np.array([[half, 0.0, center[0]], [0.0, half, center[1]], [0.0, 0.0, 1.0]])


def shift(by: Array) -> Array:
    """The warp that moves everything by (2,) `by` [px]."""
    return np.array([[1.0, 0.0, by[0]], [0.0, 1.0, by[1]], [0.0, 0.0, 1.0]])


def turned(turn: float, scale: float) -> Array:
    """The warp that turns by `turn` [rad] and scales about the origin."""
    c, s = scale * math.cos(turn), scale * math.sin(turn)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def motions(x: Array, y: Array) -> Array:
    """(8, 2, k) displacement of the points (x, y) per unit of each number of a small motion.

    In turn: shift along x and y, rotation, scale, aspect, shear, perspective along x and y.
    """
    one, zero = np.ones_like(x), np.zeros_like(x)
    return np.array(
        [(one, zero), (zero, one), (-y, x), (x, y), (x, -y), (y, x), (x * x, x * y), (x * y, y * y)]
    )


def undo(warp: Array, p: list[float]) -> Array:
    """`warp` composed with the inverse of the small motion `p` (2, 4, 6 or 8 numbers).

    The inverse is taken to second order, exp(-A) = I - A + A^2/2: cheaper than inverting, and
    exact in the limit where registration ends.
    """
    x, y, turn, scale, aspect, shear, lean_x, lean_y = p + [0.0] * (8 - len(p))
    a = np.array(
        [[scale + aspect, shear - turn, x], [shear + turn, scale - aspect, y], [-lean_x, -lean_y, 0.0]]
    )
    moved = warp @ (_EYE - a + 0.5 * (a @ a))
    return moved / moved[2, 2]


def apply(warp: Array, points: Array) -> Array:
    """(k, 2) points carried by `warp`."""
    carried = points @ warp[:, :2].T + warp[:, 2]
    return carried[:, :2] / carried[:, 2:]


def corners(warp: Array) -> Array:
    """(4, 2) region outline in the image, top-left first and clockwise [px]."""
    carried = warp @ _CORNERS
    return (carried[:2] / carried[2]).T


def area(quad: Array) -> float:
    """Signed area of a (4, 2) outline [px^2]; positive when it is clockwise as seen."""
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = quad.tolist()
    return 0.5 * ((x2 - x0) * (y3 - y1) - (x3 - x1) * (y2 - y0))


def is_convex(quad: Array) -> bool:
    """Whether a (4, 2) outline is convex and not mirrored."""
    edges = [(b[0] - a[0], b[1] - a[1]) for a, b in _around(quad.tolist())]
    return all(a[0] * b[1] - a[1] * b[0] > 0 for a, b in _around(edges))


def _around(ring: list) -> list[tuple]:
    """Each element of a ring with the one after it."""
    return list(zip(ring, ring[1:] + ring[:1], strict=True))
