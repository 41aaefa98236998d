"""From the mouse to the task: which pixel and which marker a click or a drag means."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from vita.snapshot import Snapshot
from vita.types import Array
from vita.ui.compose import SELECT, Composer
from vita.ui.layout import Layout
from vita.ui.lens import Lens

REACH_PX = 10.0
"""How near a click must be to a marker to mean it [screen pixels]."""
SLIP_PX = 5.0
"""A drag shorter than this is a click of an unsteady hand [screen pixels]."""
SETTLE_S = 0.25
"""A dropped marker stays where it was dropped until the engine has moved its tracker [s]."""

Uv = tuple[float, float]


class Shown(Protocol):
    """What the board shows at the moment."""

    lens: Lens
    layout: Layout | None
    snapshot: Snapshot | None

    on_pick: Callable[[str, Uv, str | None], None]
    on_move: Callable[[str, Uv], None]


@dataclass
class _Grab:
    name: str | None
    camera: str
    start: Uv
    """Where the mouse went down (0 to 1 each)."""
    offset: Uv
    """From the mouse to the marker's middle [image pixels]."""


class Picking:
    def __init__(self, shown: Shown, composer: Composer) -> None:
        self._shown, self._composer = shown, composer
        self._grab: _Grab | None = None
        self.dragged: dict[str, Uv] = {}
        """Markers in somebody's hand: name to pixel."""

    def pixel_at(self, screen: Uv, camera: str) -> Uv:
        """The image pixel of `camera` under a place of the window (0 to 1 each)."""
        assert self._shown.layout is not None
        return self._shown.layout.cells[camera].to_pixel(*self._shown.lens.board_at(screen))

    def screen_of(self, camera: str, uv: Uv) -> Uv:
        """The place of the window (0 to 1 each) where a pixel is seen; the inverse of `pixel_at`."""
        assert self._shown.layout is not None
        return self._shown.lens.screen_at(*self._shown.layout.cells[camera].to_board(*uv))

    def marker_at(self, camera: str, uv: Uv) -> str | None:
        """The tracker of `camera` whose marker is nearest to `uv`, if within reach."""
        snapshot, layout = self._shown.snapshot, self._shown.layout
        if snapshot is None or layout is None:
            return None
        reach = REACH_PX * self._shown.lens.unit() / layout.cells[camera].scale
        best: tuple[float, str] | None = None
        for spec in snapshot.scenario.tracker:
            feature = snapshot.features.get(spec.name)
            place: Array | Uv | None = feature.uv if feature is not None else spec.at
            if spec.camera != camera or place is None:
                continue
            distance = float(np.hypot(place[0] - uv[0], place[1] - uv[1]))
            if distance <= reach and (best is None or distance < best[0]):
                best = distance, spec.name
        return best[1] if best else None

    def clicked(self, event: Any, camera: str) -> None:
        self._pick(camera, self.pixel_at(event.screen_pos, camera))

    def dragging(self, event: Any, camera: str) -> None:
        """Drag a marker; a drag that starts elsewhere and hardly moves is a click."""
        if event.phase == "start":
            self._take(event, camera)
            return
        grab = self._grab
        if grab is None or grab.camera != camera:
            return
        here = self.pixel_at(event.end_screen_pos, camera)
        uv = self._inside(camera, (here[0] + grab.offset[0], here[1] + grab.offset[1]))
        if grab.name is not None:
            self.dragged[grab.name] = uv
        if event.phase != "end":
            return
        self._grab = None
        if grab.name is not None:
            self._shown.on_move(grab.name, uv)
            self._release_later(grab.name)
        elif self._shown.lens.moved_px(grab.start, event.end_screen_pos) < SLIP_PX:
            self._pick(camera, here)

    def _pick(self, camera: str, uv: Uv) -> None:
        uv = self._inside(camera, uv)
        self._shown.on_pick(camera, uv, self.marker_at(camera, uv))

    def _take(self, event: Any, camera: str) -> None:
        start = self.pixel_at(event.start_screen_pos, camera)
        name = self.marker_at(camera, start) if self._composer.tool == SELECT else None
        place, snapshot = start, self._shown.snapshot
        if name is not None and snapshot is not None:
            feature = snapshot.features.get(name)
            place = tuple(feature.uv) if feature is not None else start
            self._composer.selected = name
        offset = place[0] - start[0], place[1] - start[1]
        self._grab = _Grab(name, camera, event.start_screen_pos, offset)

    def _inside(self, camera: str, uv: Uv) -> Uv:
        assert self._shown.layout is not None
        w, h = self._shown.layout.cells[camera].size
        return float(min(max(uv[0], 0.0), w - 1.0)), float(min(max(uv[1], 0.0), h - 1.0))

    def _release_later(self, name: str) -> None:
        timer = threading.Timer(SETTLE_S, lambda: self.dragged.pop(name, None))
        timer.daemon = True
        timer.start()
