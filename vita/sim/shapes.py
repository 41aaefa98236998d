"""The few solids that our own meshes are made of: lofts, lathes and rounded blocks.

Plain numpy on purpose: the same numbers come out with every version of every library, so that
the committed meshes can be checked against a regeneration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vita.types import Array

Point2 = tuple[float, float]

FLATNESS_M = 0.0006
"""How far a chord may stay behind its arc: below half a pixel of a 640x480 view from a metre away [m]."""


def arc_steps(radius: float, sweep: float, flatness: float = FLATNESS_M) -> int:
    """How many chords an arc of `radius` [m] over `sweep` [rad] needs to look round; at least one."""
    half = np.arccos(max(0.0, 1.0 - flatness / max(radius, 1e-9)))
    return max(1, round(sweep / (2 * half)))


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed triangle mesh, counter-clockwise seen from outside."""

    vertices: Array
    """(v, 3) [m]."""
    faces: NDArray[np.int32]
    """(f, 3) vertex indices."""

    def moved(self, T: Array) -> Solid:
        """The same solid after the rigid motion T (4, 4)."""
        return Solid(self.vertices @ T[:3, :3].T + T[:3, 3], self.faces)

    def shifted(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
        return Solid(self.vertices + np.array([x, y, z]), self.faces)


def joined(solids: Sequence[Solid]) -> Solid:
    """Several solids as one mesh (they may overlap; nothing is cut)."""
    starts = np.cumsum([0, *(len(s.vertices) for s in solids)])
    faces = [s.faces + start for s, start in zip(solids, starts, strict=False)]
    return Solid(np.concatenate([s.vertices for s in solids]), np.concatenate(faces).astype(np.int32))


def loft(rings: Array, closed: bool = False) -> Solid:
    """A skin over k rings of n points each, (k, n, 3), ended by a fan at both ends.

    The rings run counter-clockwise seen from the last ring's side. With `closed` the last ring is
    joined to the first instead, which makes a hoop.
    """
    k, n, _ = rings.shape
    j = np.arange(n)
    following = (j + 1) % n
    faces = []
    for i in range(k if closed else k - 1):
        low, high = i * n, (i + 1) % k * n
        faces.append(np.stack([low + j, low + following, high + following], axis=1))
        faces.append(np.stack([low + j, high + following, high + j], axis=1))
    if closed:
        return Solid(rings.reshape(-1, 3), np.concatenate(faces).astype(np.int32))
    bottom, top = k * n, k * n + 1
    faces.append(np.stack([np.full(n, bottom), following, j], axis=1))
    last = (k - 1) * n
    faces.append(np.stack([np.full(n, top), last + j, last + following], axis=1))
    ends = np.stack([rings[0].mean(axis=0), rings[-1].mean(axis=0)])
    return Solid(np.concatenate([rings.reshape(-1, 3), ends]), np.concatenate(faces).astype(np.int32))


def fillet(profile: Sequence[Point2], radius: float) -> list[Point2]:
    """Round the inner corners of an open polyline with arcs of at most `radius`."""
    points = [np.array(p, dtype=float) for p in profile]
    rounded = [points[0]]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        u, v = before - corner, after - corner
        reach_u, reach_v = np.linalg.norm(u), np.linalg.norm(v)
        u, v = u / reach_u, v / reach_v
        half = np.arccos(np.clip(u @ v, -1, 1)) / 2
        if half > np.pi / 2 - 0.05:  # nearly straight: there is no corner to round
            rounded.append(corner)
            continue
        cut = min(radius / np.tan(half), 0.45 * reach_u, 0.45 * reach_v)
        r = cut * np.tan(half)
        bisector = (u + v) / np.linalg.norm(u + v)
        center = corner + bisector * r / np.sin(half)
        start, end = corner + u * cut - center, corner + v * cut - center
        sweep = np.arccos(np.clip(start @ end / (r * r), -1, 1))
        for t in np.linspace(0, 1, arc_steps(float(r), float(sweep)) + 1):
            arc = (np.sin((1 - t) * sweep) * start + np.sin(t * sweep) * end) / np.sin(sweep)
            rounded.append(center + arc)
    rounded.append(points[-1])
    return [(float(x), float(y)) for x, y in rounded]


def lathe(profile: Sequence[Point2], sections: int = 0, closed: bool = False) -> Solid:
    """A solid of revolution about z from a profile of (radius, z), outer side from bottom to top.

    Without a number of sections, thick parts get more than thin ones. A profile that starts or ends
    flat on the axis loses that point, as the fan that ends a loft is the same disc with fewer triangles.
    """
    points = list(profile)
    if not closed:
        for end, following in ((0, 1), (-1, -2)):
            if len(points) > 2 and points[end][0] < 0.002 and points[end][1] == points[following][1]:
                points.pop(end)
    sections = sections or 2 * int(np.clip(arc_steps(max(r for r, _ in points), np.pi), 4, 18))
    angle = np.arange(sections) * (2 * np.pi / sections)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rings = [np.column_stack([r * circle, np.full(sections, z)]) for r, z in points]
    return loft(np.array(rings), closed)


def drum(radius: float, low: float, high: float, edge: float = 0.004, sections: int = 0) -> Solid:
    """A cylinder about z from `low` to `high` with rounded edges [m]."""
    flat = radius * 1e-3
    return lathe(fillet([(flat, low), (radius, low), (radius, high), (flat, high)], edge), sections)


def hoop(inner: float, outer: float, low: float, high: float) -> Solid:
    """A ring with a square section about z [m]."""
    return lathe([(inner, low), (outer, low), (outer, high), (inner, high)], closed=True)


def band(radius: float, low: float, high: float) -> Solid:
    """What looks like a ring around a thinner, solid bar: a plain disc, for half the triangles [m]."""
    return lathe([(radius, low), (radius, high)])


def ball(radius: float, sections: int = 28, rings: int = 12) -> Solid:
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings)[1:-1]
    return lathe([(radius * float(np.cos(t)), radius * float(np.sin(t))) for t in angle], sections)


def capsule(
    start: Sequence[float] | Array, end: Sequence[float] | Array, r0: float, r1: float, sections: int = 0
) -> Solid:
    """A round-ended, possibly tapering bar between two points."""
    a, b = np.array(start, dtype=float), np.array(end, dtype=float)
    length = float(np.linalg.norm(b - a))
    t = np.linspace(0.15, np.pi / 2, 4)
    low = [(r0 * float(np.sin(s)), -r0 * float(np.cos(s))) for s in t]
    high = [(r1 * float(np.sin(s)), length + r1 * float(np.cos(s))) for s in t[::-1]]
    return lathe(low + high, sections).moved(frame_along(a, b - a))


def slab(outline: Array, low: float, high: float, edge: float = 0.003) -> Solid:
    """A prism over a convex outline (n, 2), counter-clockwise, with bevelled edges [m]."""
    center = outline.mean(axis=0)
    inset = center + (outline - center) * (1 - edge / np.abs(outline - center).max())
    soft = center + (outline - center) * (1 - 0.3 * edge / np.abs(outline - center).max())
    levels = [(inset, low), (outline, low + edge), (outline, high - edge), (inset, high)]
    if edge >= 0.006:  # A small bevel need not be round.
        levels[1:1], levels[-1:-1] = [(soft, low + 0.3 * edge)], [(soft, high - 0.3 * edge)]
    return loft(np.array([np.column_stack([ring, np.full(len(ring), z)]) for ring, z in levels]))


def rounded_rectangle(x: float, y: float, radius: float) -> Array:
    """(n, 2) outline centred at the origin, counter-clockwise [m]."""
    steps = arc_steps(radius, np.pi / 2)
    angle = np.linspace(0, np.pi / 2, steps + 1)
    arc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    corner = np.array([x / 2 - radius, y / 2 - radius])
    turns = [np.array([[c, -s], [s, c]]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    signs = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    pairs = zip(turns, signs, strict=True)
    return np.concatenate([arc @ turn.T + corner * np.array(sign) for turn, sign in pairs])


def stadium(start: Point2, end: Point2, r0: float, r1: float) -> Array:
    """(n, 2) outline of a link plate: two discs and what lies between, counter-clockwise [m]."""
    steps = arc_steps(max(r0, r1), np.pi) + 1
    a, b = np.array(start), np.array(end)
    along = float(np.arctan2(*(b - a)[::-1]))
    lean = float(np.arcsin(np.clip((r0 - r1) / np.linalg.norm(b - a), -1, 1)))
    front = along + np.linspace(-np.pi / 2 + lean, np.pi / 2 - lean, steps)
    back = along + np.linspace(np.pi / 2 - lean, 3 * np.pi / 2 + lean, steps)
    ring = [b + r1 * np.stack([np.cos(front), np.sin(front)], axis=1)]
    ring += [a + r0 * np.stack([np.cos(back), np.sin(back)], axis=1)]
    return np.concatenate(ring)


def frame_along(origin: Sequence[float] | Array, z_axis: Sequence[float] | Array) -> Array:
    """(4, 4) a frame at `origin` whose z points along `z_axis`."""
    z = np.array(z_axis, dtype=float)
    z = z / np.linalg.norm(z)
    helper = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    y = np.cross(z, helper)
    y = y / np.linalg.norm(y)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = np.cross(y, z), y, z, origin
    return T
