"""Solids are made standing along z; this lays them where a link needs them."""

from __future__ import annotations

import numpy as np

from vita.sim.shapes import Solid


def along_y(solid: Solid) -> Solid:
    """From along z to along y."""
    return solid.moved(np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]]))


def along_x(solid: Solid) -> Solid:
    """From along z to along x."""
    return solid.moved(np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]]))


def upright(solid: Solid, x: float = 0.0) -> Solid:
    """From a frame with z along the arm to a link frame whose z is the joint axis across it.

    That is Tx(x) Rx(pi/2): what stood along z points along -y.
    """
    return solid.moved(np.array([[1, 0, 0, x], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]]))


def mirrored_z(solid: Solid) -> Solid:
    """The same at the other side of the plane z = 0."""
    return Solid(solid.vertices * np.array([1, 1, -1]), solid.faces[:, ::-1].copy())
