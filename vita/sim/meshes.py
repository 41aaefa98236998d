"""From shapes to drawable `Visual`s: sharp edges doubled, texture coordinates where there is a picture.

`shape_visual` takes any triangle mesh (trimesh objects have `.vertices` and `.faces`); the others are
the primitives that scenes are made of. All sizes in metres, all poses 4x4 in the body's frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vita.errors import BadInput
from vita.sim.shading import shaded
from vita.types import Array, Image, Visual, frozen

Color = tuple[float, float, float]
Vector = Sequence[float] | Array


def make_visual(
    body: str,
    vertices: Array,
    faces: NDArray,
    normals: Array,
    color: Color,
    uv: Array | None = None,
    texture: Image | None = None,
    pose: Array | None = None,
) -> Visual:
    """A `Visual` with frozen copies of the arrays, moved by `pose` (a rigid motion) if given."""
    if pose is not None:
        vertices = np.asarray(vertices) @ pose[:3, :3].T + pose[:3, 3]
        normals = np.asarray(normals) @ pose[:3, :3].T
    normals = np.asarray(normals, dtype=float)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return Visual(
        body,
        frozen(vertices),
        frozen(faces, np.int32),
        frozen(normals / np.where(lengths > 0, lengths, 1.0)),
        color,
        None if uv is None else frozen(uv),
        None if texture is None else frozen(texture, np.uint8),
    )


def shape_visual(
    body: str,
    vertices: Array,
    faces: NDArray,
    color: Color,
    pose: Array | None = None,
    crease_deg: float = 35.0,
) -> Visual:
    """A triangle mesh, smooth across edges flatter than `crease_deg` and sharp across the others."""
    vertices, faces, normals = shaded(
        np.asarray(vertices, dtype=float), np.asarray(faces, np.int32), crease_deg
    )
    return make_visual(body, vertices, faces, normals, color, pose=pose)


def lathe_visual(
    body: str,
    profile: Sequence[tuple[float, float]],
    color: Color,
    pose: Array | None = None,
    segments: int = 32,
    crease_deg: float = 35.0,
) -> Visual:
    """A body turned about z. `profile` lists (radius, z) from the bottom to the top, outside to the right.

    A profile that starts or ends away from the axis is closed by a flat disc.
    """
    points = [(float(r), float(z)) for r, z in profile]
    points = ([(0.0, points[0][1])] if points[0][0] > 0 else []) + points
    points += [(0.0, points[-1][1])] if points[-1][0] > 0 else []
    angles = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    vertices = np.vstack([np.hstack([r * ring, np.full((segments, 1), z)]) for r, z in points])
    i = np.arange(segments)
    j = (i + 1) % segments
    faces = []
    for k in range(len(points) - 1):
        low, high = k * segments, (k + 1) * segments
        faces += [np.stack([low + i, low + j, high + j], 1), np.stack([low + i, high + j, high + i], 1)]
    return shape_visual(body, vertices, np.vstack(faces), color, pose, crease_deg)


def cylinder_visual(
    body: str,
    radius: float,
    z0: float,
    z1: float,
    color: Color,
    pose: Array | None = None,
    segments: int = 32,
) -> Visual:
    """A solid cylinder about z from `z0` to `z1`."""
    return lathe_visual(body, [(radius, z0), (radius, z1)], color, pose, segments)


def sphere_visual(
    body: str, radius: float, color: Color, center: Vector = (0.0, 0.0, 0.0), segments: int = 32
) -> Visual:
    """A ball."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    profile = [(radius * max(0.0, np.cos(t)), radius * np.sin(t)) for t in angles]
    profile[0], profile[-1] = (0.0, -radius), (0.0, radius)
    pose = np.eye(4)
    pose[:3, 3] = center
    return lathe_visual(body, profile, color, pose, segments, crease_deg=80.0)


def sheet_visual(
    body: str,
    origin: Vector,
    right: Vector,
    down: Vector,
    color: Color = (1.0, 1.0, 1.0),
    texture: Image | None = None,
    area: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0),
    steps: int = 1,
) -> Visual:
    """A flat printed parallelogram, seen from the side where `right` x `down` points away.

    `origin` is the picture's top-left corner, `right` and `down` its edges [m]; `area` is the part of
    the texture (u0, v0, u1, v1) that it shows. `steps` cells a side: TinyRenderer wants small triangles.
    """
    o, r, d = (np.asarray(v, dtype=float) for v in (origin, right, down))
    t = np.linspace(0.0, 1.0, steps + 1)
    u, v = (grid.reshape(-1, 1) for grid in np.meshgrid(t, t))
    cell = (np.arange(steps)[:, None] * (steps + 1) + np.arange(steps)).reshape(-1, 1)
    faces = np.vstack([cell + [0, steps + 1, steps + 2], cell + [0, steps + 2, 1]])
    normal = np.cross(d, r)
    u0, v0, u1, v1 = area
    uv = np.hstack([u0 + (u1 - u0) * u, v0 + (v1 - v0) * v])
    return make_visual(
        body,
        o + u * r + v * d,
        faces,
        np.tile(normal, (len(u), 1)),
        color,
        None if texture is None else uv,
        texture,
    )


def box_visual(
    body: str,
    size: Vector,
    color: Color,
    pose: Array | None = None,
) -> Visual:
    """A plain box about its centre."""
    half = 0.5 * np.asarray(size, dtype=float)
    vertices = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    quads = [(4, 6, 7, 5), (0, 1, 3, 2), (2, 3, 7, 6), (0, 4, 5, 1), (1, 5, 7, 3), (0, 2, 6, 4)]
    faces = np.array([[q[i] for i in tri] for q in quads for tri in ((0, 1, 2), (0, 2, 3))])
    return shape_visual(body, vertices, faces, color, pose)


def slab_visuals(
    body: str,
    outline: Array,
    z0: float,
    z1: float,
    color: Color,
    pose: Array | None = None,
    top: Image | None = None,
    bottom: Image | None = None,
) -> tuple[Visual, ...]:
    """A flat solid with a simple (k, 2) `outline`, counter-clockwise from above, between z0 and z1.

    `top` and `bottom` are pictures stretched over the outline's box, upright with +y upwards; the
    bottom's is mirrored, so that it reads right from below. Sides, and faces without a picture, are plain.
    """
    outline = np.asarray(outline, dtype=float)
    k, triangles = len(outline), ear_clip(outline)
    low, span = outline.min(axis=0), np.ptp(outline, axis=0)
    share = (outline - low) / span
    i = np.arange(k)
    j = (i + 1) % k
    ring = np.vstack([np.hstack([outline, np.full((k, 1), z)]) for z in (z0, z1)])
    wall: list[NDArray] = [np.stack([i, j, k + j], 1), np.stack([i, k + j, k + i], 1)]
    sheets: list[Visual] = []
    for picture, flip, z in ((top, False, z1), (bottom, True, z0)):
        faces = triangles[:, ::-1] if flip else triangles
        if picture is None:
            wall.append(faces if flip else faces + k)
            continue
        uv = np.stack([1 - share[:, 0] if flip else share[:, 0], 1 - share[:, 1]], axis=1)
        flat = np.hstack([outline, np.full((k, 1), z)])
        normals = np.tile([0.0, 0.0, -1.0 if flip else 1.0], (k, 1))
        sheets.append(make_visual(body, flat, faces, normals, (1.0, 1.0, 1.0), uv, picture, pose))
    return (shape_visual(body, ring, np.vstack(wall), color, pose), *sheets)


def ear_clip(outline: Array) -> NDArray[np.int32]:
    """(k - 2, 3) triangles of a simple counter-clockwise polygon (k, 2), by cutting ears off."""
    left, triangles = list(range(len(outline))), []

    def turn(a: int, b: int, c: int) -> float:
        (ax, ay), (bx, by), (cx, cy) = outline[a], outline[b], outline[c]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    while len(left) > 3:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            if turn(a, b, c) <= 0:
                continue
            others = (p for p in left if p not in (a, b, c))
            if not any(min(turn(a, b, p), turn(b, c, p), turn(c, a, p)) >= 0 for p in others):
                triangles.append((a, b, c))
                left.pop(k)
                break
        else:
            raise BadInput("the outline crosses itself or runs clockwise", "outline")
    return np.array([*triangles, tuple(left)], np.int32)
