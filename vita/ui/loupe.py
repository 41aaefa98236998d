"""The loupe: a few pixels of a view, enlarged without smoothing, with a cross-hair at the exact place.

Two of them: a card in the panel for the selected tracker (an HTML picture of single pixels that the
browser enlarges, under a drawing in pixel coordinates), and one beside the pointer while a place is
chosen or a marker dragged (a scene node, enlarged here).
"""

from __future__ import annotations

import base64
from collections.abc import Sequence

import numpy as np
import viser
from viser._image_encoding import cv2_imencode_with_fallback

from vita.types import Array, Feature, Image
from vita.ui.labels import LabelPool
from vita.ui.layout import Rect
from vita.ui.words import RED, WHITE, Rgb, hexed

Uv = tuple[float, float]
ZOOM = 7
"""How many times larger than in the camera's picture."""
COLUMNS, ROWS = 17, 13
"""What the loupe beside the pointer shows [px]."""
CARD_COLUMNS, CARD_ROWS = 19, 13
NOTHING: Rgb = (90, 96, 106)
"""Colour of what lies outside the picture."""


def cut(frame: Image, uv: Sequence[float] | Array, columns: int, rows: int) -> tuple[Image, tuple[int, int]]:
    """(rows, columns, 3) pixels of `frame` around `uv`, and the pixel (u, v) at their top left."""
    u0, v0 = round(float(uv[0])) - columns // 2, round(float(uv[1])) - rows // 2
    part = np.empty((rows, columns, 3), np.uint8)
    part[:] = NOTHING
    height, width = frame.shape[:2]
    left, right = max(u0, 0), min(u0 + columns, width)
    top, bottom = max(v0, 0), min(v0 + rows, height)
    if left < right and top < bottom:
        seen = frame[top:bottom, left:right]
        part[top - v0 : bottom - v0, left - u0 : right - u0] = seen if seen.ndim == 3 else seen[..., None]
    return part, (u0, v0)


def enlarged(frame: Image, uv: Sequence[float]) -> Image:
    """(ROWS * ZOOM, COLUMNS * ZOOM, 3) picture around `uv` with a cross-hair exactly there."""
    part, (u0, v0) = cut(frame, uv, COLUMNS, ROWS)
    big = part.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)
    x, y = int((float(uv[0]) - u0 + 0.5) * ZOOM), int((float(uv[1]) - v0 + 0.5) * ZOOM)
    for reach, color in ((2, WHITE), (1, RED)):
        # Open in the middle, so that the pixel that is meant can be seen.
        for gap in (slice(None, max(x - 6, 0)), slice(x + 7, None)):
            big[y - reach : y + 1 + reach, gap] = color
        for gap in (slice(None, max(y - 6, 0)), slice(y + 7, None)):
            big[gap, x - reach : x + 1 + reach] = color
        big[y - reach : y + 1 + reach, x - reach : x + 1 + reach] = color
    for edge, color in ((0, NOTHING), (1, WHITE), (2, WHITE)):
        big[[edge, -1 - edge], edge : big.shape[1] - edge] = color
        big[edge : big.shape[0] - edge, [edge, -1 - edge]] = color
    return big


def card(frame: Image, feature: Feature, color: Rgb) -> str:
    """HTML: the loupe on a tracker, with its region and its exact place."""
    return _card(frame, feature.uv, _shapes(feature), color)


def _shapes(feature: Feature) -> list[tuple[Array, bool]]:
    """((k, 2) points, closed) of what the tracker holds on to."""
    found = [(feature.corners, True), (feature.outline, True), (feature.segment, False)]
    return [(np.asarray(p, float), closed) for p, closed in found if p is not None and np.isfinite(p).all()]


def _card(frame: Image, uv: Array, shapes: list[tuple[Array, bool]], color: Rgb) -> str:
    part, (u0, v0) = cut(frame, uv, CARD_COLUMNS, CARD_ROWS)
    picture = base64.b64encode(cv2_imencode_with_fallback("png", part, None, channel_ordering="rgb"))
    drawn = ""
    for points, closed in shapes:
        places = " ".join(f"{u:.2f},{v:.2f}" for u, v in points)
        drawn += f'<poly{"gon" if closed else "line"} points="{places}"/>'
    u, v = float(uv[0]), float(uv[1])
    hair = (
        f"M{u - 20:.2f} {v:.2f}H{u - 0.7:.2f}M{u + 0.7:.2f} {v:.2f}H{u + 20:.2f}"
        f"M{u:.2f} {v - 20:.2f}V{v - 0.7:.2f}M{u:.2f} {v + 0.7:.2f}V{v + 20:.2f}"
    )
    return (
        f'<div class="loupe"><img decoding="sync" alt="" src="data:image/png;base64,{picture.decode()}">'
        f'<svg viewBox="{u0 - 0.5} {v0 - 0.5} {CARD_COLUMNS} {CARD_ROWS}" fill="none">'
        f'<g stroke="{hexed(color)}" stroke-width="0.22">{drawn}</g>'
        f'<path d="{hair}" stroke="#fff" stroke-width="0.36"/>'
        f'<path d="{hair}" stroke="{hexed(RED)}" stroke-width="0.14"/>'
        f'<circle cx="{u:.2f}" cy="{v:.2f}" r="0.18" fill="{hexed(RED)}" stroke="#fff" stroke-width="0.1"/>'
        f"</svg></div>"
    )


class PointerLoupe:
    """The loupe beside the pointer, one per browser."""

    OFFSET = 26.0
    """From the place to the nearest edge of the loupe [screen pixels]."""

    def __init__(self, scene: viser.SceneApi) -> None:
        self._scene = scene
        self._label = LabelPool(scene, "/loupe/label", 1.15)
        self._node: viser.ImageHandle | None = None
        self.shown: tuple[str, Uv] | None = None
        """The camera and the pixel that it shows."""
        self.box: Rect | None = None
        """The part of the board that it covers."""

    def show(
        self, camera: str, frame: Image, uv: Uv, board: tuple[float, float], screen: tuple[float, float],
        unit: float,
    ) -> None:
        """Show `uv`, which stands at `board` and at the place `screen` of the window (0 to 1 each)."""
        picture = enlarged(frame, uv)
        height, width = picture.shape[:2]
        if self._node is None:
            self._node = self._scene.add_image(
                "/loupe/picture", picture, width, height, format="png", cast_shadow=False,
                receive_shadow=False,
            )
        else:
            self._node._data = cv2_imencode_with_fallback("png", picture, None, channel_ordering="rgb")
        # Above and to the right of the place, except where there is no room.
        right = 1.0 if screen[0] < 0.75 else -1.0
        below = -1.0 if screen[1] > 0.4 else 1.0
        x = board[0] + right * (self.OFFSET + width / 2) * unit
        y = board[1] + below * (self.OFFSET + height / 2) * unit
        # In front of the pictures, strokes and labels, and not clickable: it takes no events.
        self._node.position, self._node.scale = (x, y, -8.0), unit
        self.box = Rect(x - width / 2 * unit, y - height / 2 * unit, width * unit, height * unit)
        self._node.visible = True
        text = f"{uv[0]:.1f}, {uv[1]:.1f}"
        self._label.show([(text, (x, y + (height / 2 + 2) * unit, -9.0), "top-center")])
        self.shown = camera, uv

    def hide(self) -> None:
        if self.shown is not None and self._node is not None:
            self._node.visible = False
            self._label.show([])
            self.shown = self.box = None

