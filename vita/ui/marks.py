"""Line segments to draw over a view: the shapes of markers, and the strokes that collect them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from vita.ui.layout import Cell
from vita.ui.tags import Tag
from vita.ui.words import Rgb

_LINEAR = np.array([round(255 * (i / 255) ** 2.2) for i in range(256)], np.uint8)
"""viser takes the colours of line segments as linear light; the page's colours are sRGB."""


def loop(points: np.ndarray) -> np.ndarray:
    """(k, 2, 2) segments of the closed polygon through `points` (k, 2)."""
    segments = np.empty((len(points), 2, 2))
    segments[:, 0], segments[:-1, 1], segments[-1, 1] = points, points[1:], points[0]
    return segments


_ANGLES = np.linspace(0, 2 * np.pi, 20, endpoint=False)
RING = loop(np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1))
# Marks in screen pixels around the feature, each (k, 2, 2) segments.
_ARMS = np.array([[[3, 0], [12, 0]], [[-3, 0], [-12, 0]], [[0, 3], [0, 12]], [[0, -3], [0, -12]]], float)
TRACKER_MARK = np.concatenate([7 * RING, _ARMS])
GOAL_MARK = np.concatenate([loop(np.array([[0, -11], [11, 0], [0, 11], [-11, 0]], float)), 2.5 * RING[::4]])
LOST_MARK = np.array([[[-6, -6], [6, 6]], [[-6, 6], [6, -6]]], float)
PENDING_MARK = 15 * RING
PLUS_MARK = np.array([[[-5, 0], [5, 0]], [[0, -5], [0, 5]]], float)
END_MARK = 5 * RING


class Strokes:
    """Collects 2D line segments with colours, in pixels of one view."""

    def __init__(self) -> None:
        self._segments: list[np.ndarray] = []
        self._colors: list[Rgb] = []

    def add(self, segments: np.ndarray, color: Rgb) -> None:
        """`segments` (k, 2, 2)."""
        self._segments.append(segments)
        self._colors.append(color)

    @property
    def empty(self) -> bool:
        return not self._segments

    def line(self, a: np.ndarray, b: np.ndarray, color: Rgb) -> None:
        self.add(np.array([[a, b]]), color)

    def dashes(self, a: np.ndarray, b: np.ndarray, dash: float, color: Rgb) -> None:
        length = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        count = int(min(max(length / (2 * dash), 1), 60))
        t = (np.arange(count)[:, None] + np.array([[0.0, 0.5]])) / count
        self.add(a + t[..., None] * (b - a), color)

    def arrays(self, cell: Cell, z: float) -> tuple[np.ndarray, np.ndarray]:
        """(k, 2, 3) points in the view's frame and (k, 2, 3) colours."""
        if not self._segments:
            return np.zeros((1, 2, 3), np.float32), np.zeros((1, 2, 3), np.uint8)
        flat = np.concatenate(self._segments)
        points = np.empty((len(flat), 2, 3), np.float32)
        points[..., :2] = (flat + 0.5) * cell.scale
        points[..., 2] = z
        colors = np.repeat(_LINEAR[np.array(self._colors)], [len(s) for s in self._segments], axis=0)
        return points, np.repeat(colors[:, None], 2, axis=1)


def clip_line(a: np.ndarray, b: np.ndarray, size: tuple[int, int]) -> np.ndarray | None:
    """(2, 2) ends of the infinite line through `a` and `b` inside the image, or None."""
    low, high = np.array([-0.5, -0.5]), np.array(size) - 0.5
    direction = b - a
    if float(np.abs(direction).max()) < 1e-6:
        return None
    start, stop = -np.inf, np.inf
    for axis in (0, 1):
        if abs(direction[axis]) < 1e-9:
            if not low[axis] <= a[axis] <= high[axis]:
                return None
            continue
        t = (np.array([low[axis], high[axis]]) - a[axis]) / direction[axis]
        start, stop = max(start, t.min()), min(stop, t.max())
    return np.stack([a + start * direction, a + stop * direction]) if start < stop else None


@dataclass
class Drawing:
    """The strokes and labels of one view at one instant."""

    thin: Strokes
    bold: Strokes
    tags: list[Tag]
    ghost: Strokes = field(default_factory=Strokes)
    """What is expected of the next step; over everything else."""
