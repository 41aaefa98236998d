"""What can be mounted on the flange. The tool's frame has z out of the flange, its origin on it."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from vita.errors import UnknownName
from vita.sim import textures
from vita.sim.environment import build_environment
from vita.sim.meshes import (
    box_visual,
    cylinder_visual,
    lathe_visual,
    sheet_visual,
    slab_visuals,
    sphere_visual,
)
from vita.sim.paints import DARK, ORANGE, PAPER, STEEL
from vita.types import Array, Image, Visual

__all__ = ["TOOLS", "build_environment", "build_tool"]

BODY = "tool"


def no_tool() -> tuple[Visual, ...]:
    """The bare flange."""
    return ()


def card_tool() -> tuple[Visual, ...]:
    """A stem with a printed plate, 0.07 (y) x 0.07 m (z 0.05 to 0.12), its faces along +-x.

    A cross marks the centre (0, 0, 0.085) on both faces and an arrow the tip (0, 0, 0.12).
    """
    half, low, high, thick = 0.035, 0.05, 0.12, 0.0015
    front, back = (
        _with_marks(textures.poster((320, 320), palette, seed, bold=1.4))
        for palette, seed in (("ice", 71), ("berry", 73))
    )
    right, down = 2 * half, np.array([0.0, 0.0, high - low])
    edges = [
        sheet_visual(BODY, (-thick, -half, high), (2 * thick, 0, 0), (0, right, 0), PAPER),
        sheet_visual(BODY, (-thick, half, low), (2 * thick, 0, 0), (0, -right, 0), PAPER),
        sheet_visual(BODY, (thick, half, low), (-2 * thick, 0, 0), down, PAPER),
        sheet_visual(BODY, (-thick, -half, low), (2 * thick, 0, 0), down, PAPER),
    ]
    return (
        cylinder_visual(BODY, 0.03, 0.0, 0.008, DARK),
        cylinder_visual(BODY, 0.008, 0.008, low, DARK, segments=24),
        box_visual(BODY, (0.012, 0.03, 0.012), DARK, _at(0, 0, low)),
        sheet_visual(BODY, (thick, half, low), (0, -right, 0), down, texture=front),
        sheet_visual(BODY, (-thick, -half, low), (0, right, 0), down, texture=back),
        *edges,
    )


def wrench() -> tuple[Visual, ...]:
    """A printed open-ended wrench in the tool's yz plane; the middle of its jaw is (0, 0, 0.12).

    The jaw opens along +z and is 0.034 m wide between flats parallel to z.
    """
    slot, grip, head, middle = 0.017, 0.011, 0.034, 0.12
    depth = 0.016  # From the jaw's middle up to its floor.
    opening = np.arcsin(slot / head)
    neck = np.arcsin(grip / head)
    # The outline in (y, -z): the arms of the jaw, the round head and the handle up to the flange.
    arc = np.linspace(-np.pi / 2 + opening, np.pi / 2 - neck, 16)
    half = [(head * np.cos(t), -middle + head * np.sin(t)) for t in arc] + [(grip, 0.0)]
    outline = [(slot, -middle + depth * 0.55), *half]
    outline += [(-y, w) for y, w in reversed(outline)]
    outline += [(-0.4 * slot, -middle + depth), (0.4 * slot, -middle + depth)]
    pose = np.eye(4)
    # Outline x is tool y, outline y is tool -z, so that its normal is tool -x.
    pose[:3, :3] = np.array([[0, 0, -1], [1, 0, 0], [0, -1, 0]], dtype=float)
    front = textures.poster((176, 400), "harbour", 81, bold=1.4)
    back = textures.poster((176, 400), "garden", 82, bold=1.4)
    blade = slab_visuals(BODY, np.array(outline), -0.004, 0.004, STEEL, pose, front, back)
    return (cylinder_visual(BODY, 0.03, 0.0, 0.008, DARK), *blade)


def marker_tool() -> tuple[Visual, ...]:
    """A stem with ArUco code 7 (6 x 6), 0.05 m over its black frame, on a white plate of 0.07 m.

    The plate's face lies in the plane x = 0 and looks along -x, which is ahead while the tool points down:
    there the cameras are. The code's centre is (0, 0, 0.085); its right is y, its up is -z. A pin below
    the plate ends in a small ball about the tool point (0, 0, 0.14).
    """
    pose = np.eye(4)
    # The plate's own frame is the marker's: x right, y up, z out of the face.
    pose[:3, :3] = np.array([[0, 0, -1], [1, 0, 0], [0, -1, 0]], dtype=float)
    pose[2, 3] = 0.085
    plate = slab_visuals(
        BODY, 0.035 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]), -0.003, 0.0, PAPER, pose,
        top=textures.marker(7, px=40, quiet=1.6),
    )  # fmt: skip
    return (
        cylinder_visual(BODY, 0.03, 0.0, 0.008, DARK),
        cylinder_visual(BODY, 0.008, 0.008, 0.052, DARK, _at(0.011, 0, 0), segments=24),
        box_visual(BODY, (0.012, 0.03, 0.06), DARK, _at(0.009, 0, 0.075)),
        *plate,
        lathe_visual(BODY, [(0.005, 0.12), (0.002, 0.137)], STEEL, segments=20),
        sphere_visual(BODY, 0.005, ORANGE, (0.0, 0.0, 0.14), segments=20),
    )


def hand() -> tuple[Visual, ...]:
    """The three-finger hand."""
    from vita.sim.hand import hand_visuals

    return tuple(hand_visuals())


def _at(x: float, y: float, z: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def _with_marks(picture: Image) -> Image:
    """The picture with a rim, a cross at its centre and an arrow to the middle of its lower edge."""
    side = picture.shape[0]
    white, black, c = (255, 255, 255), (15, 15, 20), (side - 1) * 8
    unit = side * 16 // 100
    cv2.rectangle(picture, (0, 0), (side - 1, side - 1), white, round(0.05 * side))
    cv2.circle(picture, (c, c), 15 * unit, white, -1, cv2.LINE_AA, 4)
    for dx, dy in ((11 * unit, 2 * unit), (2 * unit, 11 * unit)):
        corners = np.array([(c - dx, c - dy), (c + dx, c - dy), (c + dx, c + dy), (c - dx, c + dy)], np.int32)
        cv2.fillPoly(picture, [corners], black, cv2.LINE_AA, 4)
    bottom = (side * 2 - 1) * 8
    for wide, tall, ink in ((15, 24, white), (9, 16, black)):
        top = bottom - tall * unit
        arrow = np.array([(c, bottom), (c - wide * unit, top), (c + wide * unit, top)])
        cv2.fillPoly(picture, [arrow.astype(np.int32)], ink, cv2.LINE_AA, 4)
    return picture


_BUILDERS: dict[str, Callable[[], tuple[Visual, ...]]] = {
    "none": no_tool,
    "card_tool": card_tool,
    "marker_tool": marker_tool,
    "wrench": wrench,
    "hand": hand,
}
TOOLS: tuple[str, ...] = tuple(_BUILDERS)


def build_tool(kind: str) -> tuple[Visual, ...]:
    """The meshes of a tool, all in the body `tool`."""
    if kind not in _BUILDERS:
        raise UnknownName("tool", kind, TOOLS)
    return _BUILDERS[kind]()
