"""From points to pixels: the ideal pinhole camera of TUM eq. 1 and 7."""

from __future__ import annotations

import numpy as np

from vita.stereo.base import Lens
from vita.types import Array

NEAREST_M = 1e-6
"""Nothing nearer than this to the plane of the lens is in front of the camera [m]."""


def project(lens: Lens, points: Array) -> Array:
    """(..., 2) undistorted pixels of (..., 3) points in the camera's own coordinates [m].

    NaN for a point that is not in front of the camera. Pixels outside of the picture are given as they
    are: the caller knows whether they matter.
    """
    points = np.asarray(points, dtype=float)
    depth = np.where(points[..., 2] > NEAREST_M, points[..., 2], np.nan)
    return points[..., :2] / depth[..., None] * (lens.fx, lens.fy) + (lens.cx, lens.cy)


def pixel_slope(lens: Lens, points: Array) -> Array:
    """(..., 2, 3) d pixel / d point [px/m] at (..., 3) points in front of the camera."""
    x, y, z = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    slope = np.zeros((*np.shape(z), 2, 3))
    slope[..., 0, 0], slope[..., 1, 1] = lens.fx / z, lens.fy / z
    slope[..., 0, 2], slope[..., 1, 2] = -lens.fx * x / z**2, -lens.fy * y / z**2
    return slope


def rays(lens: Lens, pixels: Array) -> Array:
    """(..., 3) directions, with z = 1, in which (..., 2) undistorted pixels are seen."""
    flat = (np.asarray(pixels, dtype=float) - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    return np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1)
