"""Words on a frame: names on coloured chips that keep off one another."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

Canvas = NDArray[np.uint8]
Bgr = tuple[int, int, int]
Box = tuple[float, float, float, float]
_WEIGHT = 600
_DARK, _LIGHT, _RIM = (30, 22, 18), (255, 255, 255), (25, 20, 18)


class Label:
    """The chips of one frame."""

    def __init__(self, canvas: Canvas, px: int) -> None:
        """`px` is the height of the letters."""
        self._canvas, self._px = canvas, px
        self.taken: list[Box] = []
        """Where the chips are."""

    def put(self, text: str, around: Box, color: Bgr) -> None:
        """A chip beside the box `around` (u0, v0, u1, v1) [px]: above it, or else where there is room."""
        wide, high = text_width(text, self._px) + 1.2 * self._px, 1.5 * self._px
        u, v = self._place(around, wide, high)
        self.taken.append((u, v, u + wide, v + high))
        left = (round(u + high / 2), round(v + high / 2))
        right = (round(u + wide - high / 2), left[1])
        # A thick line has round ends: a chip.
        cv2.line(self._canvas, left, right, _RIM, round(high) + 2, cv2.LINE_AA)
        cv2.line(self._canvas, left, right, color, round(high), cv2.LINE_AA)
        bright = 0.114 * color[0] + 0.587 * color[1] + 0.299 * color[2]
        base = (round(u + 0.6 * self._px), round(v + high / 2 + 0.36 * self._px))
        write(self._canvas, text, base, _DARK if bright > 125 else _LIGHT, self._px)

    def _place(self, around: Box, wide: float, high: float) -> tuple[float, float]:
        """Top-left corner of the first free place: above, below, right, left, then further up."""
        u0, v0, u1, v1 = around
        height, width = self._canvas.shape[:2]
        gap, middle = 4.0, (v0 + v1 - high) / 2
        places = [(u0, v0 - gap - high), (u0, v1 + gap), (u1 + gap, middle), (u0 - gap - wide, middle)]
        places += [(u0, v0 - gap - high - k * (high + 3)) for k in range(1, 4)]
        for u, v in places:
            inside = u >= 1 and v >= 1 and u + wide <= width - 1 and v + high <= height - 1
            if inside and not any(_meet((u, v, u + wide, v + high), other) for other in self.taken):
                return u, v
        u, v = places[0]
        return min(max(u, 1.0), max(width - wide - 1, 1.0)), min(max(v, 1.0), max(height - high - 1, 1.0))


def _meet(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def text_width(text: str, px: int) -> float:
    """Width of a text in letters of height `px` [px]."""
    return cv2.getTextSize((0, 0), text, (0, 0), _font(), px, _WEIGHT)[2]


def write(
    canvas: Canvas, text: str, base: tuple[int, int], color: Bgr, px: int, *, rim: Bgr | None = None
) -> None:
    """Text from the left end of its base line; with a `rim` where there is no chip behind it."""
    if rim is not None:
        for du, dv in ((-1, 0), (1, 0), (0, -1), (0, 1), (1, 1)):
            cv2.putText(canvas, text, (base[0] + du, base[1] + dv), rim, _font(), px, _WEIGHT)
    cv2.putText(canvas, text, base, color, _font(), px, _WEIGHT)


@lru_cache(maxsize=1)
def _font() -> cv2.FontFace:
    return cv2.FontFace("sans")
