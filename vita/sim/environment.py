"""The workshop around the arm: a wooden table, a tiled floor and two walls, all in the body `world`."""

from __future__ import annotations

import numpy as np

from vita.sim import room_textures
from vita.sim.meshes import box_visual, sheet_visual
from vita.types import Visual

BODY = "world"
TABLE_X, TABLE_Y = (-0.45, 1.15), (-0.75, 0.75)
"""Extent of the table top, on which the arm stands at the origin [m]."""
TABLE_THICK, TABLE_HEIGHT = 0.045, 0.76
WOOD = (0.62, 0.43, 0.27)
WALL_X, WALL_Y, ROOM_HEIGHT = -2.1, 2.6, 2.9
FLOOR_SIDE = 6.4


def build_environment(table: bool) -> tuple[Visual, ...]:
    """Floor, walls and, with `table`, a table whose top is z = 0 under and before the arm.

    Without the table the arm stands on the floor, which is then z = 0.
    """
    floor = -TABLE_HEIGHT if table else 0.0
    return (*(_table() if table else ()), *_room(floor))


def _room(floor: float) -> tuple[Visual, ...]:
    """The floor, and walls at the back and at the sides; from outside one sees through the walls."""
    far, half = WALL_X + FLOOR_SIDE, 0.5 * FLOOR_SIDE
    down = (0.0, 0.0, -ROOM_HEIGHT)
    top = floor + ROOM_HEIGHT
    plaster = room_textures.wall((1024, 464), seed=3)
    side = room_textures.wall((512, 232), seed=4)
    return (
        sheet_visual(
            BODY,
            (far, half, floor),
            (0, -FLOOR_SIDE, 0),
            (-FLOOR_SIDE, 0, 0),
            texture=room_textures.tiles(768, 14, 1),
            steps=16,
        ),
        sheet_visual(BODY, (WALL_X, -half, top), (0, FLOOR_SIDE, 0), down, texture=plaster, steps=8),
        sheet_visual(BODY, (WALL_X, half, top), (FLOOR_SIDE, 0, 0), down, texture=side, steps=8),
        sheet_visual(BODY, (far, -half, top), (-FLOOR_SIDE, 0, 0), down, texture=side, steps=8),
    )


def _table() -> tuple[Visual, ...]:
    """The table top with its printed grain, its rim and four legs."""
    (x0, x1), (y0, y1) = TABLE_X, TABLE_Y
    wide, deep = x1 - x0, y1 - y0
    grain = room_textures.wood((960, 1024), 8, seed=2)
    top = sheet_visual(BODY, (x0, y0, 0.0), (0, deep, 0), (wide, 0, 0), texture=grain[::-1], steps=10)
    centre = (0.5 * (x0 + x1), 0.5 * (y0 + y1), -0.5 * TABLE_THICK - 0.0005)
    rim = box_visual(BODY, (wide, deep, TABLE_THICK - 0.001), WOOD, _at(centre))
    legs, long = [], TABLE_HEIGHT - TABLE_THICK
    for x in (x0 + 0.08, x1 - 0.08):
        for y in (y0 + 0.08, y1 - 0.08):
            legs.append(
                box_visual(
                    BODY, (0.07, 0.07, long), (0.25, 0.27, 0.30), _at((x, y, -TABLE_THICK - 0.5 * long))
                )
            )
    return (top, rim, *legs)


def _at(xyz: tuple[float, float, float]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    return pose
