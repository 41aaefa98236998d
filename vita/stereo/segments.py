"""Thick segments along an arm, and what is nearest to them, as plain arrays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vita.types import Array


class Nearest(NamedTuple):
    """The pair of points at which an arm and a surface are closest."""

    distance: float
    """From the arm's axis, or its skin where radii were given, to the surface; infinite without one [m]."""
    on_arm: Array
    """(3,) on the segment's axis; NaN without a surface [m]."""
    segment: int
    """Index of the segment; -1 without a surface."""
    normal: Array
    """(3,) of the surface, towards the camera that saw it; zero without one."""
    on_surface: Array
    """(3,) the surface point; NaN without one [m]."""


def feet(points: Array, starts: Array, ends: Array) -> Array:
    """(k, s, 3) the point of each segment's axis that is nearest to each of the (k, 3) points [m]. A segment
    may be a single point."""
    along = np.asarray(ends, dtype=float) - starts
    square = np.einsum("si,si->s", along, along)
    share = (points @ along.T - np.einsum("si,si->s", starts, along)) / np.where(square > 0, square, 1.0)
    return starts + np.clip(share, 0.0, 1.0)[..., None] * along


def clearances(
    points: NDArray[Any], starts: NDArray[Any], ends: NDArray[Any], radii: NDArray[Any]
) -> NDArray[Any]:
    """(k, s) distance of each of the (k, 3) points from each segment's skin; negative inside [m].

    Single precision goes in and out where all are of it.
    """
    x, y, z = np.ascontiguousarray(np.transpose(points))
    away = np.empty((len(starts), len(points)), np.result_type(points, starts))
    # Segment by segment: a picture full of points would feel every array with three axes.
    for row, start, along, radius in zip(away, starts, ends - starts, radii, strict=True):
        u, v, w = x - start[0], y - start[1], z - start[2]
        share = u * along[0] + v * along[1] + w * along[2]
        share /= along @ along or 1
        np.clip(share, 0, 1, out=share)
        u -= share * along[0]
        v -= share * along[1]
        w -= share * along[2]
        np.sqrt(u * u + v * v + w * w, out=row)
        row -= radius
    return away.T


def nearest_each(
    points: Array, normals: Array, starts: Array, ends: Array, radii: Array | None = None
) -> list[Nearest]:
    """For every segment the surface point that is nearest to it."""
    radii = np.zeros(len(starts)) if radii is None else np.asarray(radii, dtype=float)
    if len(points) == 0:
        nothing = np.full(3, np.nan)
        return [Nearest(np.inf, nothing, -1, np.zeros(3), nothing) for _ in starts]
    on_arm = feet(points, starts, ends)
    gaps = points[:, None] - on_arm
    away = np.sqrt(np.einsum("ksi,ksi->ks", gaps, gaps)) - radii
    best = away.argmin(axis=0)
    return [Nearest(float(away[k, s]), on_arm[k, s], s, normals[k], points[k]) for s, k in enumerate(best)]


def nearest(
    points: Array, normals: Array, starts: Array, ends: Array, radii: Array | None = None
) -> Nearest:
    """The closest pair of all: distance, point on the arm, index of the segment, normal, surface point.

    points, normals: (k, 3) of `surfaces`, in the frame of starts, ends: (s, 3). Without any point the
    distance is infinite, which is also what a blind camera gives: that must be told apart beforehand.
    """
    return min(nearest_each(points, normals, starts, ends, radii), key=lambda found: found.distance)
