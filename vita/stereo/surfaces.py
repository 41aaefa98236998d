"""Surfaces of obstacles from the picture of a depth camera: "the normal directions of the environment
provided by the Kinect sensor" (TUM IV-C), which eq. 21 calls D_h.

The arm, what it carries and the table are in the picture too, and so they are left out by where they are
known to be. What is left near the arm and has neighbours that were left as well is an obstacle; a pixel on
its own is noise. On a plane the inverse of the distance is linear in the pixel, so that the normal is the
gradient of a small linear fit, exactly.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.stereo.base import Lens
from vita.stereo.projection import rays
from vita.stereo.segments import clearances
from vita.types import DEPTH_STEP_PX, Array, frozen

Floats = NDArray[np.float32]

MARGIN_M = 0.03
"""Left out around the arm and above the table as well, for the errors of depth and of the camera's place:
half a degree is 13 mm at 1.5 m. Of what comes nearer than that to the arm, only the rest is seen [m]."""
STEEP = 4.0
"""Neighbouring pixels are on one surface if their distances differ by less than this times how far apart
they are; what is tilted by more than atan(4) = 76 degrees against the image is an edge."""
SUPPORT = 4
"""So many of the 24 pixels around one must be on its surface for it to count."""
MOST = 500
"""With more pixels than that on obstacles, those far from the arm are thinned out."""
THINNED = ((0.15, 2), (0.5, 4))
"""From these shares of the reach on, only every second, then every fourth row and column is then reported."""
FACING = 0.002
"""Pulls the slope towards zero where the pixels around do not tell it, as on a thin post [pixels squared]."""


def surfaces(
    depth: NDArray[np.float32],
    lens: Lens,
    T_base_camera: Array,
    starts: Array,
    ends: Array,
    radii: Array,
    table_z: float,
    reach_m: float = 0.5,
    stride: int = 1,
    margin_m: float = MARGIN_M,
) -> tuple[Array, Array]:
    """(k, 3) points of obstacles [m] and their (k, 3) unit normals towards the camera, in the base frame.

    depth: (h, w) of `Observation.depths`; infinite or NaN pixels give nothing. lens: of the whole picture,
    whose distortion has been taken off. T_base_camera: (4, 4) [m]. starts, ends: (s, 3) segments along the
    arm in the base frame [m], and radii: (s,) within which everything is arm [m]. table_z: nothing below is
    reported [m]. reach_m: nothing farther from the arm is [m]. stride: uses only every stride-th pixel.
    margin_m: this much beyond the radii and above the table is left out as well [m].
    """
    depth = np.asarray(depth, dtype=np.float32)
    if depth.ndim != 2 or stride < 1:
        raise BadInput(f"needs a picture and a stride of 1 or more, got {depth.shape}, {stride}", "depth")
    z = depth[::stride, ::stride]
    step = DEPTH_STEP_PX * stride
    directions = _directions(lens, z.shape, step)
    T = np.asarray(T_base_camera, dtype=np.float32)
    arm = tuple(np.asarray(values, dtype=np.float32) for values in (starts, ends, radii))
    shapes = [values.shape for values in arm]
    count = len(arm[2]) if arm[2].ndim else 0
    if not count or shapes != [(count, 3), (count, 3), (count,)]:
        raise BadInput(f"needs (s, 3) starts, (s, 3) ends and (s,) radii of an arm, got {shapes}", "starts")
    rows, columns, points, away = _near(z, directions, T, arm, table_z, reach_m, margin_m)
    kept = np.zeros(z.shape, dtype=bool)
    kept[rows, columns] = True
    dense = np.ones(len(rows), dtype=bool)
    for share, every in THINNED if len(rows) > MOST else ():
        dense &= (away < share * reach_m) | ((rows % every == 0) & (columns % every == 0))
    rows, columns, points = rows[dense], columns[dense], points[dense]
    normals, sound = _fit(z, kept, rows, columns, directions, (step / lens.fx, step / lens.fy))
    return points[sound].astype(float), normals[sound] @ np.asarray(T_base_camera, dtype=float)[:3, :3].T


@lru_cache(maxsize=8)
def _directions(lens: Lens, shape: tuple[int, int], step: int) -> NDArray[np.float32]:
    """(3, h, w) where each pixel looks, with z = 1."""
    rows, columns = step * np.indices(shape, dtype=float)
    return frozen(np.moveaxis(rays(lens, np.stack([columns, rows], axis=-1)), -1, 0), np.float32)


def _near(
    z: Floats,
    directions: Floats,
    T: Floats,
    arm: tuple[Floats, ...],
    table_z: float,
    reach_m: float,
    margin_m: float,
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats, Floats]:
    """Rows, columns, (k, 3) points and (k,) clearances of the pixels that show something near the arm which
    is neither arm nor table."""
    starts, ends, radii = arm
    far = (radii + reach_m)[:, None]
    low = np.minimum(starts - far, ends - far).min(axis=0)
    high = np.maximum(starts + far, ends + far).max(axis=0)
    low[2] = max(low[2], table_z + margin_m)
    seen = np.where(np.isfinite(z), z, np.float32(0.0))
    inside = seen > 0
    places = (T[:3, :3] @ directions.reshape(3, -1)).reshape(directions.shape)
    for along, origin, least, most in zip(places, T[:3, 3], low, high, strict=True):
        along *= seen
        along += origin
        inside &= along > least
        inside &= along < most
    rows, columns = np.nonzero(inside)
    points = places[:, rows, columns].T
    away = clearances(points, starts, ends, radii).min(axis=1, initial=np.inf)
    near = (away > margin_m) & (away < reach_m)
    return rows[near], columns[near], points[near], away[near]


_DV, _DU = (offset.ravel() for offset in np.mgrid[-2:3, -2:3])
_AWAY = np.maximum(np.maximum(abs(_DU), abs(_DV)), 1).astype(np.float32)
_WEIGHTS = np.exp(-(_DU**2 + _DV**2) / (2 * 1.5**2))
"""Near a rim, where all pixels lie on one side, the close ones know the slope better."""
_TERMS = np.stack([np.ones(25), _DU, _DV, _DU**2, _DV**2, _DU * _DV], axis=1)
_MOMENTS = (_WEIGHTS[:, None] * _TERMS).astype(np.float32)
_OPPOSITE = ((11, 13), (7, 17), (6, 18), (8, 16))
"""Neighbours on either side of the middle one, of 25 in reading order."""


def _fit(
    z: Floats,
    kept: NDArray[np.bool_],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    directions: Floats,
    pitch: tuple[float, float],
) -> tuple[Array, NDArray[np.bool_]]:
    """(k, 3) unit normals towards the camera, in its coordinates, of the pixels at `rows`, `columns`, and
    (k,) which of them have enough neighbours on their surface."""
    wide = z.shape[1] + 4
    padded, part = np.full((z.shape[0] + 4, wide), np.nan, np.float32), np.zeros((z.shape[0] + 4, wide), bool)
    padded[2:-2, 2:-2], part[2:-2, 2:-2] = z, kept
    at = ((rows + 2) * wide + columns + 2)[:, None] + (_DV * wide + _DU)
    around, own = padded.ravel()[at], z[rows, columns, None]
    gap = np.float32(STEEP * max(pitch)) * own * _AWAY
    with np.errstate(invalid="ignore"):
        rise = around - own
        on = part.ravel()[at] & (np.abs(rise) < gap)
        # A pixel between something nearer and something farther is where two surfaces blend at an edge.
        blend = np.zeros(len(rows), dtype=bool)
        for a, b in _OPPOSITE:
            blend |= (rise[:, a] < -gap[:, a]) & (rise[:, b] > gap[:, b])
            blend |= (rise[:, b] < -gap[:, b]) & (rise[:, a] > gap[:, a])

    # Least squares of 1 / z = c + a x + b y over the pixels `on` the surface, about their middle. What is
    # fitted is how it differs from the pixel itself, or single precision would not do.
    total, x, y, xx, yy, xy = (on.astype(np.float32) @ _MOMENTS).T.astype(float)
    bend = np.where(on, -rise / (np.where(on, around, np.float32(1.0)) * own), np.float32(0.0))
    mean, wx, wy = (bend @ _MOMENTS[:, :3]).T.astype(float)
    xx, yy, xy = xx - x * x / total + FACING, yy - y * y / total + FACING, xy - x * y / total
    wx, wy = wx - x * mean / total, wy - y * mean / total
    scale = xx * yy - xy * xy
    a, b = (wx * yy - wy * xy) / scale / pitch[0], (wy * xx - wx * xy) / scale / pitch[1]
    # A plane n . p = 1 has 1 / z = n . direction.
    right, down, _ = directions[:, rows, columns]
    middle = 1.0 / own[:, 0] + mean / total
    c = middle - a * (right + x / total * pitch[0]) - b * (down + y / total * pitch[1])
    normals = -np.stack([a, b, c], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, (on.sum(axis=1) > SUPPORT) & ~blend  # It counts itself.
