"""What stands about in the stereo experiment: the target that is carried, and two cameras on a tripod."""

from __future__ import annotations

import numpy as np

from vita.sim import textures
from vita.sim.meshes import box_visual, cylinder_visual, shape_visual, slab_visuals, sphere_visual
from vita.sim.paints import DARK, GLASS, ORANGE, PAPER, STEEL
from vita.sim.shapes import Solid, capsule, drum, rounded_rectangle
from vita.types import Array, Visual

HALF_BASELINE = 0.1
"""Where the lenses of the tripod's cameras are on its x axis, to both sides [m]."""
HEAD_DOWN_DEG = 15.0
"""How far below the horizon the head looks while the legs stand upright [deg]."""
LENS_HEIGHT = 1.36
"""Height of the lenses above the feet: 0.60 m over a table of 0.76 m [m]."""


def target(body: str) -> tuple[Visual, ...]:
    """ArUco code 5 (6 x 6), 0.08 m over its black frame, on a white plate of 0.10 m with a handle below.

    The origin is the centre of the code, z points out of its face, y up and x right on the upright face.
    """
    back = rounded_rectangle(0.112, 0.112, 0.012)
    return (
        *slab_visuals(body, _square(0.10), -0.002, 0.0, PAPER, top=textures.marker(5, px=40, quiet=1.0)),
        *slab_visuals(body, back, -0.008, -0.002, ORANGE),
        _solid(body, capsule((0.0, -0.05, -0.005), (0.0, -0.085, -0.005), 0.007, 0.007), STEEL),
        _solid(body, capsule((0.0, -0.09, -0.005), (0.0, -0.18, -0.005), 0.012, 0.014), DARK),
    )


def tripod(body: str) -> tuple[Visual, ...]:
    """Two small cameras on a bar on three legs.

    The frame is that of a camera midway between the two lenses: z ahead, x right, y down. Cameras of a
    scenario belong at (-+HALF_BASELINE, 0, 0) in it. Nothing of it is ahead of the lenses but the feet,
    straight below. The legs stand upright where z points HEAD_DOWN_DEG below the horizon.
    """
    drawn = [
        box_visual(body, (0.30, 0.016, 0.024), STEEL, _at(0.0, 0.036, -0.038)),
        *(part for side in (-1, 1) for part in _camera(body, side * HALF_BASELINE)),
        sphere_visual(body, 0.004, ORANGE, (-HALF_BASELINE + 0.022, -0.024, -0.022), segments=12),
    ]
    stand = _stand()
    top, hub = -0.045, -0.42
    drawn += [
        _solid(body, drum(0.026, top - 0.05, top, edge=0.006).shifted(x=-0.045).moved(stand), DARK),
        _solid(body, drum(0.013, hub, top, edge=0.002).shifted(x=-0.045).moved(stand), STEEL),
        _solid(body, drum(0.04, hub - 0.03, hub + 0.03, edge=0.008).shifted(x=-0.045).moved(stand), DARK),
    ]
    for angle in np.radians([60.0, 180.0, 300.0]):
        way = np.array([np.cos(angle), np.sin(angle), 0.0])
        start, end = 0.03 * way + (-0.045, 0, hub), 0.34 * way + (-0.045, 0, 0.014 - LENS_HEIGHT)
        knee = start + 0.55 * (end - start)
        drawn += [
            _solid(body, capsule(start, knee, 0.014, 0.014).moved(stand), DARK),
            _solid(body, capsule(knee, end, 0.009, 0.009).moved(stand), STEEL),
            _solid(body, capsule(end - 0.02 * way, end + 0.02 * way, 0.013, 0.013).moved(stand), DARK),
        ]
    return tuple(drawn)


def _camera(body: str, x: float) -> tuple[Visual, ...]:
    """A small camera whose lens is just behind the plane z = 0 at `x`."""
    lens = _at(x, 0.0, 0.0)
    return (
        box_visual(body, (0.062, 0.048, 0.046), DARK, _at(x, 0.0, -0.043)),
        cylinder_visual(body, 0.018, -0.022, -0.006, STEEL, lens, segments=28),
        cylinder_visual(body, 0.014, -0.008, -0.004, GLASS, lens, segments=28),
    )


def _stand() -> Array:
    """(4, 4) from the upright frame of the legs (x ahead, z up) to that of the head; both origins agree."""
    s, c = np.sin(np.radians(HEAD_DOWN_DEG)), np.cos(np.radians(HEAD_DOWN_DEG))
    T = np.eye(4)
    T[:3, :3] = np.array([[0.0, -1.0, 0.0], [-s, 0.0, -c], [c, 0.0, -s]])
    return T


def _solid(body: str, solid: Solid, color: tuple[float, float, float]) -> Visual:
    return shape_visual(body, solid.vertices, solid.faces, color)


def _square(side: float) -> Array:
    """(4, 2) corners about the origin, counter-clockwise."""
    return np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * side


def _at(x: float, y: float, z: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose
