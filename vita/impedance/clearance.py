"""How near the arm's outer links come to people, obstacles, table and base, and which way leads away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vita.impedance.view import Surface
from vita.types import Array

TINY = 1e-9


@dataclass(frozen=True, eq=False)
class Gap:
    """One closest approach."""

    distance: float
    """Between the two surfaces; negative where they overlap [m]."""
    normal: Array
    """(3,) unit vector along which the arm gets away."""
    point: Array
    """(3,) on the arm's own axis [m]."""
    segment: int
    """Which of the arm's segments it is on."""
    coming: float = 0.0
    """Speed at which the obstacle comes nearer by its own motion; 0 where it goes away [m/s]."""


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Capsules as arrays, for all distances are taken at once."""

    starts: Array
    """(c, 3) [m]."""
    ends: Array
    """(c, 3) [m]."""
    radii: Array
    """(c,) [m]."""
    start_speeds: Array
    """(c, 3) velocity of one end of the axis [m/s]."""
    end_speeds: Array
    """(c, 3) and of the other."""


def between_segments(a0: Array, a1: Array, b0: Array, b1: Array) -> tuple[Array, Array]:
    """(s, c), (s, c) where along segments a (s, 3) and b (c, 3), 0 to 1 each, they are nearest to another.

    The squared distance is a convex quadratic of the two parameters. From the best place on a's line, held
    within a, the best on b follows, held within b, and from that again the best on a: the minimum.
    """
    u, v = a1 - a0, b1 - b0
    w = a0[:, None] - b0[None]
    uu, vv, uv = (u * u).sum(-1)[:, None], (v * v).sum(-1)[None], u @ v.T
    uw, vw = (u[:, None] * w).sum(-1), (v[None] * w).sum(-1)
    across = uu * vv - uv * uv
    free = (uv * vw - vv * uw) / np.where(across > TINY * uu * vv, across, np.inf)
    s = np.minimum(np.maximum(free, 0.0), 1.0)
    t = np.minimum(np.maximum((s * uv + vw) / np.maximum(vv, TINY), 0.0), 1.0)
    s = np.minimum(np.maximum((t * uv - uw) / np.maximum(uu, TINY), 0.0), 1.0)
    return s, t


def to_obstacles(starts: Array, ends: Array, radii: Array, others: Obstacles, fallback: Array) -> list[Gap]:
    """The closest approach of the arm's segments (s, 3) with `radii` (s,) to each obstacle. `fallback` (3,)
    is the way out where the axes meet and no direction is better than another."""
    if not len(others.radii):
        return []
    s, t = between_segments(starts, ends, others.starts, others.ends)
    on_arm = starts[:, None] + s[..., None] * (ends - starts)[:, None]
    apart = on_arm - others.starts - t[..., None] * (others.ends - others.starts)
    axes = np.sqrt((apart * apart).sum(-1))
    surface = axes - radii[:, None] - others.radii
    gaps = []
    for j, i in enumerate(surface.argmin(axis=0).tolist()):
        far = float(axes[i, j])
        normal = apart[i, j] / far if far > 1e-6 else fallback
        share = float(t[i, j])
        speed = (1.0 - share) * others.start_speeds[j] + share * others.end_speeds[j]
        coming = max(float(speed @ normal), 0.0)
        gaps.append(Gap(float(surface[i, j]), normal, on_arm[i, j], i, coming))
    return gaps


NEARBY = 0.02
"""Points of a seen surface up to this much farther than the nearest have a say in its normal [m]."""


def to_surface(starts: Array, ends: Array, radii: Array, surface: Surface) -> list[Gap]:
    """The closest approach of each of the arm's segments to the points that a depth camera sees; the way out
    is the seen normal (D_h of TUM eq. 21), averaged over the nearest points so that noise cancels."""
    points = np.asarray(surface.points, dtype=float).reshape(-1, 3)
    if not len(points):
        return []
    gaps = []
    for i in range(len(starts)):
        along = ends[i] - starts[i]
        s = np.clip((points - starts[i]) @ along / max(float(along @ along), TINY), 0.0, 1.0)
        apart = starts[i] + s[:, None] * along - points
        far = np.sqrt((apart * apart).sum(1))
        k = int(np.argmin(far))
        near = far < far[k] + NEARBY
        normal = surface.normals[near].sum(0)
        straight = apart[k] / max(float(far[k]), TINY)
        # Beside an edge the normal points past the arm; there the straight way off it is the better one.
        if float(normal @ straight) <= 0.3 * float(np.linalg.norm(normal)):
            normal = straight
        normal = normal / max(float(np.linalg.norm(normal)), TINY)
        on_arm = starts[i] + s[k] * along
        gaps.append(Gap(float(far[k] - radii[i]), normal, on_arm, i))
    return gaps


def to_axis(point: Array) -> tuple[float, Array]:
    """Distance of a point (3,) from the base's axis [m] and (3,) the direction away from it (TUM eq. 20)."""
    far = float(np.hypot(point[0], point[1]))
    return far, np.array([point[0] / far, point[1] / far, 0.0]) if far > 1e-6 else np.array([1.0, 0.0, 0.0])
