"""Things that stand on the table: what tasks are about. Everything printed can hold a tracker.

Flat things lie in their own xy plane with the printed face up (+z) and their origin at its centre.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vita.errors import UnknownName
from vita.sim import textures
from vita.sim.meshes import (
    box_visual,
    cylinder_visual,
    shape_visual,
    sheet_visual,
    slab_visuals,
    sphere_visual,
)
from vita.sim.paints import DARK, PAPER, STEEL
from vita.sim.people import ball, person
from vita.sim.stereo_things import target, tripod
from vita.types import Array, Visual


def rectangle(width: float, height: float) -> Array:
    """(4, 2) corners about the origin, counter-clockwise."""
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (0.5 * width, 0.5 * height)


def card(body: str) -> tuple[Visual, ...]:
    """A printed card, 0.06 x 0.08 m, 2 mm thick; the top face's corners are (+-0.03, +-0.04, 0)."""
    picture = textures.poster((288, 384), "harbour", seed=11, margin=0.035, bold=1.5)
    return slab_visuals(body, rectangle(0.06, 0.08), -0.002, 0.0, PAPER, top=picture)


def board(body: str) -> tuple[Visual, ...]:
    """A printed board, 0.30 x 0.22 m, 4 mm thick."""
    picture = textures.poster((640, 468), "garden", seed=22, margin=0.03)
    return slab_visuals(body, rectangle(0.30, 0.22), -0.004, 0.0, PAPER, top=picture)


def cube(body: str) -> tuple[Visual, ...]:
    """A 0.06 m cube about its origin with a different picture on each face."""
    h = 0.03
    # Face by face: the picture's top-left corner, its right edge and its lower edge.
    sides = [
        ((h, -h, h), (0, 1, 0), (0, 0, -1), "harbour"),
        ((-h, h, h), (0, -1, 0), (0, 0, -1), "berry"),
        ((h, h, h), (-1, 0, 0), (0, 0, -1), "ice"),
        ((-h, -h, h), (1, 0, 0), (0, 0, -1), "night"),
        ((-h, h, h), (1, 0, 0), (0, -1, 0), "clay"),
        ((-h, -h, -h), (1, 0, 0), (0, 1, 0), "garden"),
    ]
    return tuple(
        sheet_visual(
            body,
            origin,
            2 * h * np.array(right),
            2 * h * np.array(down),
            texture=textures.poster((224, 224), palette, seed=33 + k, margin=0.045, bold=1.5),
        )
        for k, (origin, right, down, palette) in enumerate(sides)
    )


def frame(body: str) -> tuple[Visual, ...]:
    """A square picture frame, 0.16 m outside, with an opening of 0.09 m, 12 mm thick."""
    outer, inner = rectangle(0.16, 0.16), rectangle(0.09, 0.09)
    picture = textures.poster((400, 400), "clay", seed=44, bold=0.8)
    visuals: list[Visual] = []
    low, high = -0.012, 0.0
    faces, points, uv = [], [], []
    for k in range(4):
        n = (k + 1) % 4
        quad = [outer[k], outer[n], inner[n], inner[k]]
        faces += [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]
        points += [(*p, high) for p in quad]
        uv += [(p[0] / 0.16 + 0.5, 0.5 - p[1] / 0.16) for p in quad]
        under = [(*p, low) for p in quad]
        walls = [(*outer[k], low), (*outer[n], low), (*outer[n], high), (*outer[k], high)]
        hole = [(*inner[n], low), (*inner[k], low), (*inner[k], high), (*inner[n], high)]
        plain = np.array(under[::-1] + walls + hole)
        visuals.append(shape_visual(body, plain, _quads(3), (0.35, 0.22, 0.15)))
    normals = np.tile([0.0, 0.0, 1.0], (16, 1))
    white = (1.0, 1.0, 1.0)
    top = Visual(body, np.array(points), np.array(faces, np.int32), normals, white, np.array(uv), picture)
    return (*visuals, top)


def post(body: str) -> tuple[Visual, ...]:
    """A slim post, 0.25 m tall, with a small orange ball on top; the origin is the ball's centre."""
    return (
        sphere_visual(body, 0.008, (0.98, 0.42, 0.06), segments=28),
        cylinder_visual(body, 0.005, -0.245, -0.008, STEEL, segments=20),
        cylinder_visual(body, 0.035, -0.25, -0.244, DARK, segments=40),
    )


def rail(body: str) -> tuple[Visual, ...]:
    """A bar of 0.40 x 0.03 x 0.03 m along x with tick marks; the origin is the top face's centre."""
    visuals = []
    for k, (top_left, right, down) in enumerate(
        [
            ((-0.2, 0.015, 0.0), (0.4, 0, 0), (0, -0.03, 0)),
            ((-0.2, -0.015, 0.0), (0.4, 0, 0), (0, 0, -0.03)),
            ((0.2, 0.015, 0.0), (-0.4, 0, 0), (0, 0, -0.03)),
        ]
    ):
        picture = textures.ruler((960, 72), seed=55 + k)
        visuals.append(sheet_visual(body, top_left, right, down, texture=picture))
    for x in (-1, 1):
        visuals.append(sheet_visual(body, (0.2 * x, -0.015 * x, 0), (0, 0.03 * x, 0), (0, 0, -0.03), PAPER))
    visuals.append(sheet_visual(body, (-0.2, -0.015, -0.03), (0.4, 0, 0), (0, 0.03, 0), DARK))
    return tuple(visuals)


def bolt(body: str) -> tuple[Visual, ...]:
    """A hexagon bolt, upright; its head is 32 mm across flats, 16 mm high, and printed on top.

    The origin is the centre of the hexagon's face, two of whose flats are parallel to x; the shank
    reaches down to z = -0.06.
    """
    radius = 0.016 / np.cos(np.pi / 6)
    angles = np.arange(6) * np.pi / 3
    outline = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    picture = textures.poster((256, 222), "night", seed=66, bold=1.4)
    sides = []
    for k in range(6):
        a, b = outline[k], outline[(k + 1) % 6]
        face = textures.poster(
            (112, 80), ("harbour", "ice", "berry", "clay", "garden", "night")[k], seed=67 + k, bold=1.6
        )
        sides.append(sheet_visual(body, (*a, 0.0), (*(b - a), 0.0), (0, 0, -0.016), texture=face))
    head = slab_visuals(body, outline, -0.016, 0.0, STEEL, top=picture)
    return (
        *head[1:],
        *sides,
        *_underside(body, outline),
        cylinder_visual(body, 0.008, -0.06, -0.016, STEEL),
    )


def marker(body: str) -> tuple[Visual, ...]:
    """ArUco code 5 of the 6 x 6 dictionary, 0.08 m over its black frame, on a 0.09 m plate of 2 mm."""
    picture = textures.marker(5, px=40, quiet=0.5)
    return slab_visuals(body, rectangle(0.09, 0.09), -0.002, 0.0, PAPER, top=picture)


def screen(body: str) -> tuple[Visual, ...]:
    """A plain grey panel of 0.25 x 0.25 m, 4 mm thick, to cover things with."""
    pose = np.eye(4)
    pose[2, 3] = -0.002
    return (box_visual(body, (0.25, 0.25, 0.004), (0.52, 0.53, 0.54), pose),)


def _quads(count: int) -> NDArray[np.int32]:
    """(2 * count, 3) triangles of `count` quads whose corners follow one another."""
    return np.array([[4 * k, 4 * k + 1 + s, 4 * k + 2 + s] for k in range(count) for s in (0, 1)], np.int32)


def _underside(body: str, outline: Array) -> tuple[Visual, ...]:
    """The plain lower face of the bolt's head."""
    points = np.hstack([outline, np.full((6, 1), -0.016)])
    return (shape_visual(body, points, np.array([[0, k + 1, k] for k in range(1, 5)]), STEEL),)


_BUILDERS: dict[str, Callable[[str], tuple[Visual, ...]]] = {
    builder.__name__: builder
    for builder in (
        card, board, cube, frame, post, rail, bolt, marker, screen, target, tripod, person, ball,
    )  # fmt: skip
}
OBJECT_KINDS: tuple[str, ...] = tuple(_BUILDERS)


def build_object(kind: str, name: str) -> tuple[Visual, ...]:
    """The meshes of one object of `kind`, in a body called `name`."""
    if kind not in _BUILDERS:
        raise UnknownName("object kind", kind, OBJECT_KINDS)
    return _BUILDERS[kind](name)
