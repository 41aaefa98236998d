"""What nobody can see of solids that are stuck into one another: the faces inside of a neighbour."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vita.sim.shapes import Solid
from vita.types import Array

SURELY_INSIDE = 0.9
"""A winding number is 1 inside, 0 outside and one half on the surface."""


def without_hidden(solids: Sequence[Solid]) -> list[Solid]:
    """The solids without the faces that lie inside another one of them.

    On software OpenGL a hidden triangle costs nearly as much as one that is seen. A face counts as
    hidden when its corners, its centre and the middles of its edges are all inside the same solid.
    """
    return [
        Solid(solid.vertices, solid.faces[~_hidden(solid, [s for s in solids if s is not solid])])
        for solid in solids
    ]


def _hidden(solid: Solid, others: Sequence[Solid]) -> NDArray[np.bool_]:
    corners = solid.vertices[solid.faces]
    between = np.stack([corners.mean(axis=1), *(corners[:, [k, k - 1]].mean(axis=1) for k in range(3))])
    hidden = np.zeros(len(solid.faces), bool)
    for other in others:
        open_ = np.flatnonzero(~hidden)
        if open_.size:
            # Few faces have their corners inside; only their middles need to be looked at.
            used = np.unique(solid.faces[open_])
            within = np.zeros(len(solid.vertices), bool)
            within[used] = inside(solid.vertices[used], other)
            open_ = open_[within[solid.faces[open_]].all(axis=1)]
        if open_.size:
            middles = between[:, open_]
            hidden[open_] = inside(middles.reshape(-1, 3), other).reshape(4, -1).all(axis=0)
    return hidden


def inside(points: Array, solid: Solid) -> NDArray[np.bool_]:
    """(k,) whether each of the points (k, 3) is within a closed solid."""
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    within = ((points > low) & (points < high)).all(axis=1)
    within[within] = _winding(points[within], solid) > SURELY_INSIDE
    return within


def _winding(points: Array, solid: Solid) -> Array:
    """(k,) how often the solid's skin goes around each point: the sum of the triangles' solid angles."""
    # Component by component, each of shape (points, corners): an axis of three at the end is slow.
    x, y, z = (solid.vertices[:, k] - points[:, k, None] for k in range(3))
    away = np.sqrt(x * x + y * y + z * z)
    a, b, c = ((x[:, i], y[:, i], z[:, i]) for i in solid.faces.T)
    la, lb, lc = (away[:, i] for i in solid.faces.T)
    volume = (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    rest = la * lb * lc
    for u, v, opposite in ((a, b, lc), (b, c, la), (c, a, lb)):
        rest += (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]) * opposite
    return 2 * np.arctan2(volume, rest).sum(axis=1) / (4 * np.pi)
