"""Boxes with round edges around the things of a scene, and what on a segment is nearest to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vita.scenario.schema import ObjectSpec
from vita.sim.environment import BODY, TABLE_HEIGHT, TABLE_THICK, TABLE_X, TABLE_Y
from vita.sim.objects import build_object
from vita.sim.people import SEGMENTS
from vita.types import Array

FLOOR_HALF_M, FLOOR_THICK_M = 5.0, 0.5
INSIDE_M = 1e-6
"""A box within another one up to so much is left out [m]."""
TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes fixed to bodies; a capsule is a box without width but with a radius."""

    names: tuple[str, ...]
    """(b,) what people call the thing that each belongs to."""
    bodies: tuple[str, ...]
    """(b,) body that each is fixed to."""
    places: Array
    """(b, 4, 4) its frame in the body's: origin at its centre, axes along its edges [m]."""
    halves: Array
    """(b, 3) half lengths of its edges [m]."""
    radii: Array
    """(b,) by how much it is thickened all round [m]."""

    def __add__(self, other: Boxes) -> Boxes:
        return Boxes(
            self.names + other.names,
            self.bodies + other.bodies,
            np.concatenate([self.places, other.places]),
            np.concatenate([self.halves, other.halves]),
            np.concatenate([self.radii, other.radii]),
        )

    def placed(self, poses: Mapping[str, Array]) -> tuple[Array, Array]:
        """(b, 4, 4) their frames in the world, and their halves."""
        T = np.stack([poses[body] for body in self.bodies])
        return T @ self.places, self.halves


def room_boxes(table: bool) -> Boxes:
    """The table and the floor around it, or the floor on which the arm stands."""
    floor = -TABLE_HEIGHT if table else 0.0
    spans = [("the floor", (-FLOOR_HALF_M,) * 2, (FLOOR_HALF_M,) * 2, floor - FLOOR_THICK_M, floor)]
    if table:
        (x0, x1), (y0, y1) = TABLE_X, TABLE_Y
        spans.insert(0, ("the table", (x0, y0), (x1, y1), -TABLE_THICK, 0.0))
    lows = np.array([(*low, z0) for _, low, _, z0, _ in spans])
    highs = np.array([(*high, z1) for _, _, high, _, z1 in spans])
    return Boxes(
        tuple(name for name, *_ in spans), (BODY,) * len(spans), _at(0.5 * (lows + highs)),
        0.5 * (highs - lows), np.zeros(len(spans)),
    )  # fmt: skip


def boxes_of(objects: Sequence[ObjectSpec]) -> Boxes:
    """Boxes that contain all meshes of the objects, one for each mesh that is not within another's."""
    found = Boxes((), (), np.zeros((0, 4, 4)), np.zeros((0, 3)), np.zeros(0))
    for spec in objects:
        places, halves, radii = _boxes_of_kind(spec.kind)
        count = len(radii)
        found += Boxes((f"the {spec.name}",) * count, (spec.name,) * count, places, halves, radii)
    return found


@lru_cache(maxsize=32)
def _boxes_of_kind(kind: str) -> tuple[Array, Array, Array]:
    """(b, 4, 4) places, (b, 3) halves and (b,) radii of one kind of object, in its own frame."""
    if kind in SEGMENTS:
        starts, ends, radii = (np.array(column) for column in zip(*SEGMENTS[kind], strict=True))
        half = 0.5 * np.linalg.norm(ends - starts, axis=1)
        halves = np.zeros((len(half), 3))
        halves[:, 2] = half
        return _along(starts, ends), halves, radii
    corners = [(v.vertices.min(axis=0), v.vertices.max(axis=0)) for v in build_object(kind, kind)]
    kept: list[tuple[Array, Array]] = []
    for low, high in sorted(corners, key=lambda box: -float(np.prod(box[1] - box[0] + 1e-3))):
        if not any((low >= a - INSIDE_M).all() and (high <= b + INSIDE_M).all() for a, b in kept):
            kept.append((low, high))
    lows, highs = np.array([low for low, _ in kept]), np.array([high for _, high in kept])
    return _at(0.5 * (lows + highs)), 0.5 * (highs - lows), np.zeros(len(kept))


def nearest_on_boxes(starts: Array, ends: Array, placed: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """(s, b, 3) the point of each segment that is nearest to each box, (s, b, 3) unit vectors that lead
    away from the box there, and (s, b) the distances, negative inside [m].

    In the box's frame the squared distance is a convex piecewise quadratic of the place t on the segment,
    whose pieces end where a coordinate passes a face. Its derivative is linear on a piece, so the root is
    exact once the piece is found.
    """
    T, halves = placed
    R, centres = T[:, :3, :3], T[:, :3, 3]
    a = np.einsum("sbi,bij->sbj", starts[:, None] - centres, R)
    u = np.einsum("si,bij->sbj", ends - starts, R)
    steep = np.where(np.abs(u) > TINY, u, np.inf)
    t = np.empty((*a.shape[:2], 8))
    t[..., 0], t[..., 1] = 0.0, 1.0
    t[..., 2:5], t[..., 5:] = (halves - a) / steep, (-halves - a) / steep
    np.minimum(np.maximum(t, 0.0, out=t), 1.0, out=t)
    t.sort(axis=-1)
    p = a[..., None, :] + t[..., None] * u[..., None, :]
    outside = p - np.minimum(np.maximum(p, -halves[:, None]), halves[:, None])
    slope = np.einsum("sbkj,sbj->sbk", outside, u)  # Half the derivative, not falling along t.
    # The piece on which it passes zero: from the last breakpoint where it is negative to the next.
    k = np.minimum((slope < 0.0).sum(axis=-1), 7)[..., None]
    before = np.maximum(k - 1, 0)
    t1, t0 = (np.take_along_axis(t, i, -1)[..., 0] for i in (k, before))
    f1, f0 = (np.take_along_axis(slope, i, -1)[..., 0] for i in (k, before))
    rise = f1 - f0
    share = np.where((f0 < 0.0) & (f1 > 0.0), -f0 / np.where(rise > 0.0, rise, 1.0), 1.0)
    best = t0 + share * (t1 - t0)
    point = a + best[..., None] * u
    away = point - np.minimum(np.maximum(point, -halves), halves)
    far = np.sqrt((away * away).sum(-1))
    within = far < 1e-9
    if within.any():
        # Inside, the nearest face is the way out.
        room = halves - np.abs(point)
        face = np.eye(3)[room.argmin(axis=-1)] * np.where(point < 0.0, -1.0, 1.0)
        away = np.where(within[..., None], face, away)
        far = np.where(within, -room.min(axis=-1), far)
    normals = away / np.maximum(np.sqrt((away * away).sum(-1)), TINY)[..., None]
    on_arm = starts[:, None] + best[..., None] * (ends - starts)[:, None]
    return on_arm, np.einsum("sbj,bij->sbi", normals, R), far


def _at(centres: Array) -> Array:
    places = np.tile(np.eye(4), (len(centres), 1, 1))
    places[:, :3, 3] = centres
    return places


def _along(starts: Array, ends: Array) -> Array:
    """(b, 4, 4) frames at the middle of segments, z along them."""
    places = _at(0.5 * (starts + ends))
    for place, along in zip(places, ends - starts, strict=True):
        length = float(np.linalg.norm(along))
        if length > TINY:
            # Any two directions across will do.
            places_across = np.linalg.svd(along[None] / length)[2]
            z = along / length
            x = places_across[1]
            place[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return places
