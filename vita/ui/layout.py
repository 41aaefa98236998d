"""Where the camera views stand on the board, and which pixel lies under a place of the window.

The board is a plane of the viser scene, seen straight on through a narrow lens: x right, y down, one
unit is one pixel of a view that is 480 pixels high. Views of other sizes are scaled to that height.
All of this is plain geometry, so that it is tested without a browser.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

VIEW_HEIGHT = 480.0
GAP = 14.0
TITLE = 32.0
"""Room above each view for its name."""
FOV = math.radians(5.0)
SIDE_BY_SIDE_BONUS = 1.15
"""How much smaller the views may get for standing next to each other."""
SMALLEST_PANE = 0.22
"""Share of the window that must be left over before the small 3D view is shown."""


@dataclass(frozen=True)
class Rect:
    x: float
    y: float
    w: float
    h: float

    @property
    def center(self) -> tuple[float, float]:
        return self.x + self.w / 2, self.y + self.h / 2

    def holds(self, x: float, y: float) -> bool:
        return self.x <= x <= self.x + self.w and self.y <= y <= self.y + self.h


@dataclass(frozen=True)
class Cell:
    """One camera's place on the board."""

    rect: Rect
    scale: float
    """Board units per image pixel."""
    size: tuple[int, int]

    def to_board(self, u: float, v: float) -> tuple[float, float]:
        """Board position of pixel (u, v); pixel centres are at integers."""
        return self.rect.x + (u + 0.5) * self.scale, self.rect.y + (v + 0.5) * self.scale

    def to_pixel(self, x: float, y: float) -> tuple[float, float]:
        return (x - self.rect.x) / self.scale - 0.5, (y - self.rect.y) / self.scale - 0.5


@dataclass(frozen=True)
class Layout:
    cells: Mapping[str, Cell]
    window: Rect
    """What the window shows when everything is fitted."""
    pane: Rect | None
    """Free room for the small 3D view."""

    def cell_at(self, x: float, y: float) -> str | None:
        return next((name for name, cell in self.cells.items() if cell.rect.holds(x, y)), None)


def arrange(sizes: Mapping[str, tuple[int, int]], aspect: float, pane: bool = True) -> Layout:
    """Side by side, stacked or in a grid: whichever makes the views largest in a window of `aspect`."""
    names = list(sizes)
    scale = {name: VIEW_HEIGHT / sizes[name][1] for name in names}
    widths = {name: sizes[name][0] * scale[name] for name in names}
    aspect = min(max(aspect, 0.2), 8.0)
    best: tuple[float, int] | None = None
    for columns in range(1, len(names) + 1):
        width, height = _extent(names, widths, columns)
        zoom = min(aspect / width, 1.0 / height)  # window heights per board unit
        # Views side by side are easier to compare, so stacking must be worth it.
        if best is None or zoom * SIDE_BY_SIDE_BONUS > best[0]:
            best = zoom, columns
    zoom, columns = best or (1.0 / VIEW_HEIGHT, 1)
    width, height = _extent(names, widths, columns)
    whole_w, whole_h = aspect / zoom, 1.0 / zoom
    spare_w, spare_h = whole_w - width, whole_h - height
    below = pane and spare_h / whole_h > SMALLEST_PANE and spare_h >= spare_w * 0.6
    beside = pane and not below and spare_w / whole_w > SMALLEST_PANE
    left = GAP if beside else GAP + spare_w / 2
    top = TITLE if below else TITLE + spare_h / 2
    cells = {}
    for index, name in enumerate(names):
        row, column = divmod(index, columns)
        x = left + sum(widths[n] + GAP for n in names[row * columns : row * columns + column])
        y = top + row * (VIEW_HEIGHT + TITLE)
        cells[name] = Cell(Rect(x, y, widths[name], VIEW_HEIGHT), scale[name], sizes[name])
    room = None
    if below:
        room = Rect(GAP, height + TITLE - GAP / 2, whole_w - 2 * GAP, spare_h - TITLE)
    elif beside:
        room = Rect(width + GAP / 2, TITLE, spare_w - 1.5 * GAP, whole_h - TITLE - GAP)
    return Layout(cells, Rect(0.0, 0.0, whole_w, whole_h), room)


def _extent(names: list[str], widths: Mapping[str, float], columns: int) -> tuple[float, float]:
    rows = [names[i : i + columns] for i in range(0, len(names), columns)] or [[]]
    width = max((sum(widths[n] + GAP for n in row) for row in rows), default=VIEW_HEIGHT) + GAP
    return width, len(rows) * (VIEW_HEIGHT + TITLE) + GAP


def window_distance(height: float) -> float:
    """Distance from which the lens sees `height` board units."""
    return height / (2.0 * math.tan(FOV / 2.0))


def unproject(
    screen: tuple[float, float], position: tuple[float, float, float], fov: float, aspect: float
) -> tuple[float, float]:
    """Board position under a place of the window (0 to 1 each) for a lens at `position`, seen straight on.

    The place comes from the event's `screen_pos`, which is exact; the event's ray starts at the
    pixel's corner and is half a screen pixel off.
    """
    height = 2.0 * abs(position[2]) * math.tan(fov / 2.0)
    return (
        position[0] + (screen[0] - 0.5) * height * aspect,
        position[1] + (screen[1] - 0.5) * height,
    )
