"""The scene nodes of one camera's view: its picture, its strokes and its labels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import viser

from vita.ui.labels import LabelPool
from vita.ui.layout import Cell
from vita.ui.overlay import Drawing
from vita.ui.tags import Placer

CHARACTER_PX, LABEL_HEIGHT_PX = 6.0, 17.0
"""How large viser draws a label [screen pixels]; only used to keep labels apart."""


class ViewNodes:
    """All are children of one frame at the picture's top left corner, and go with it."""

    def __init__(
        self, scene: viser.SceneApi, name: str, cell: Cell,
        clicked: Callable[[Any], Any], dragged: Callable[[Any], Any],
    ) -> None:
        root = f"/view/{name}"
        w, h = cell.size
        self._frame = scene.add_frame(root, show_axes=False, position=(cell.rect.x, cell.rect.y, 0.0))
        self._image = scene.add_image(
            f"{root}/image", np.full((h, w, 3), 235, np.uint8), cell.rect.w, cell.rect.h, format="jpeg",
            jpeg_quality=80, cast_shadow=False, receive_shadow=False,
            position=(cell.rect.w / 2, cell.rect.h / 2, 0.0),
        )
        self._image.on_click(clicked)
        self._image.on_drag("left")(dragged)
        nothing = np.zeros((1, 2, 3), np.float32)

        def lines(part: str, thickness: float) -> viser.LineSegmentsHandle:
            return scene.add_line_segments(
                f"{root}/{part}", nothing, np.zeros((1, 2, 3), np.uint8), thickness=thickness,
                thickness_units="screen",
            )

        self._halo, self._bold, self._thin = lines("halo", 4.6), lines("bold", 2.4), lines("thin", 1.3)
        self._make_ghost = lambda: (lines("ghost halo", 4.2), lines("ghost", 2.0))
        self._ghost: tuple[viser.LineSegmentsHandle, viser.LineSegmentsHandle] | None = None
        self._labels = LabelPool(scene, f"{root}/label", 1.0)
        self._placer = Placer()

    def fits(self, cell: Cell) -> bool:
        """Whether the picture has the size that `cell` wants."""
        return self._image.render_width == cell.rect.w

    def move(self, cell: Cell) -> None:
        self._frame.position = (cell.rect.x, cell.rect.y, 0.0)

    def show_picture(self, jpeg: bytes) -> None:
        self._image._data = jpeg

    def stroke(self, cell: Cell, drawing: Drawing, unit: float) -> None:
        """Replace the overlay. `unit` is image pixels per screen pixel."""
        for handle, strokes, z in ((self._bold, drawing.bold, -3.0), (self._thin, drawing.thin, -2.0)):
            points, colors = strokes.arrays(cell, z)
            handle.points, handle.colors = points, colors
            if handle is self._bold:
                halo = points.copy()
                halo[..., 2] = -1.0
                self._halo.points, self._halo.colors = halo, np.full_like(colors, 255)
        self._foresee(cell, drawing)
        placed = self._placer.place(drawing.tags, cell.size, unit, CHARACTER_PX, LABEL_HEIGHT_PX)
        self._labels.show([
            (tag.text, ((uv[0] + 0.5) * cell.scale, (uv[1] + 0.5) * cell.scale, -4.0), anchor)
            for tag, uv, anchor in placed
        ])

    def _foresee(self, cell: Cell, drawing: Drawing) -> None:
        """The next step. Its nodes are made when they are first needed and cost nothing while hidden."""
        shown = not drawing.ghost.empty
        if shown and self._ghost is None:
            self._ghost = self._make_ghost()
        if self._ghost is None:
            return
        halo, step = self._ghost
        if shown:
            step.points, step.colors = drawing.ghost.arrays(cell, -3.6)
            halo.points, colors = drawing.ghost.arrays(cell, -3.3)
            halo.colors = np.full_like(colors, 255)
        for handle in (halo, step):
            if handle.visible != shown:
                handle.visible = shown

    def remove(self) -> None:
        self._labels.clear()
        self._frame.remove()
