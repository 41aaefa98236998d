"""From the mouse to the task: which pixel and which marker a click or a drag means.

With a tool in hand the button may be held down and the place chosen under the loupe: what counts is
where it is let go.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from vita.snapshot import Snapshot
from vita.types import Array, frozen
from vita.ui.compose import SELECT, Composer
from vita.ui.layout import Layout
from vita.ui.lens import Lens
from vita.ui.mode import following

REACH_PX = 10.0
"""How near a click must be to a marker to mean it [screen pixels]."""
HINT_REACH = 1.8
"""The ring around an offered place is larger than a marker, by this factor."""
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
    on_move: Callable[[str, Uv, Uv | None], None]


@dataclass
class _Grab:
    name: str | None
    camera: str
    start: Uv
    """Where the mouse went down (0 to 1 each)."""
    offset: Uv
    """From the mouse to the place that it holds [image pixels]."""
    points: Array
    """(k, 2) the marker's points when it was taken; two for a line."""
    end: int | None = None
    """Which end of a line is held; None for its middle, and for points."""

    def at(self, uv: Uv) -> Array:
        """(k, 2) the marker's points with the held place at `uv`."""
        if self.end is None:
            return frozen(self.points - self.points.mean(axis=0) + uv)
        moved = self.points.copy()
        moved[self.end] = uv
        return frozen(moved)


class Picking:
    def __init__(self, shown: Shown, composer: Composer) -> None:
        self._shown, self._composer = shown, composer
        self._grab: _Grab | None = None
        self.dragged: dict[str, Array] = {}
        """Markers in somebody's hand: name to their points (k, 2) [px]."""
        self.aim: tuple[str, Uv] | None = None
        """Camera and pixel under a hand that holds the button down."""

    def pixel_at(self, screen: Uv, camera: str) -> Uv:
        """The image pixel of `camera` under a place of the window (0 to 1 each)."""
        assert self._shown.layout is not None
        return self._shown.layout.cells[camera].to_pixel(*self._shown.lens.board_at(screen))

    def screen_of(self, camera: str, uv: Uv) -> Uv:
        """The place of the window (0 to 1 each) where a pixel is seen; the inverse of `pixel_at`."""
        assert self._shown.layout is not None
        return self._shown.lens.screen_at(*self._shown.layout.cells[camera].to_board(*uv))

    def hovered(self, screen: Uv) -> tuple[str, Uv] | None:
        """The camera and the pixel under a place of the window, if a picture is there."""
        if self._shown.layout is None:
            return None
        camera = self._shown.layout.cell_at(*self._shown.lens.board_at(screen))
        return None if camera is None else (camera, self._inside(camera, self.pixel_at(screen, camera)))

    def marker_at(self, camera: str, uv: Uv) -> str | None:
        """The tracker of `camera` whose marker is nearest to `uv`, if within reach."""
        held = self._handle_at(camera, uv)
        return held[0] if held else None

    def _handle_at(self, camera: str, uv: Uv) -> tuple[str, int | None, Array] | None:
        """(name, end of a line or None, points (k, 2)) of the marker nearest to `uv`."""
        snapshot = self._shown.snapshot
        if snapshot is None or self._shown.layout is None or following(snapshot):
            return None
        reach = self._reach(camera)
        best: tuple[float, str, int | None, Array] | None = None
        for spec in snapshot.scenario.tracker:
            feature = snapshot.features.get(spec.name)
            if spec.camera != camera or (feature is None and spec.at is None):
                continue
            points = np.asarray(feature.points, float) if feature is not None else np.array([spec.at], float)
            distance, end = _nearest(points, uv, reach)
            if distance <= reach and (best is None or distance < best[0]):
                best = distance, spec.name, end, points
        return best[1:] if best else None

    def clicked(self, event: Any, camera: str) -> None:
        self._pick(camera, self.pixel_at(event.screen_pos, camera))

    def dragging(self, event: Any, camera: str) -> None:
        """Drag a marker, or choose a place with the button held down."""
        if event.phase == "start":
            self._take(event, camera)
            return
        grab = self._grab
        if grab is None or grab.camera != camera:
            return
        here = self.pixel_at(event.end_screen_pos, camera)
        uv = self._inside(camera, (here[0] + grab.offset[0], here[1] + grab.offset[1]))
        if grab.name is not None:
            self.dragged[grab.name] = grab.at(uv)
        if event.phase != "end":
            self.aim = camera, uv
            return
        self._grab = self.aim = None
        if grab.name is not None:
            self._drop(grab, uv)
            return
        slip = self._shown.lens.moved_px(grab.start, event.end_screen_pos) < SLIP_PX
        if slip or self._composer.composing:
            self._pick(camera, here)

    def _drop(self, grab: _Grab, uv: Uv) -> None:
        assert grab.name is not None
        if grab.end is None:
            self._shown.on_move(grab.name, uv, None)
        else:
            first, second = ((float(u), float(v)) for u, v in grab.at(uv))
            self._shown.on_move(grab.name, first, second)
        self._release_later(grab.name)

    def _pick(self, camera: str, uv: Uv) -> None:
        uv = self._inside(camera, uv)
        hint = self._composer.hint
        if hint is not None and hint.camera == camera:
            apart = float(np.hypot(uv[0] - hint.uv[0], uv[1] - hint.uv[1]))
            if apart <= HINT_REACH * self._reach(camera):
                self._shown.on_pick(camera, hint.uv, None)
                return
        self._shown.on_pick(camera, uv, self.marker_at(camera, uv))

    def _reach(self, camera: str) -> float:
        """How near a click must be to mean a thing [image pixels]."""
        assert self._shown.layout is not None
        return REACH_PX * self._shown.lens.unit() / self._shown.layout.cells[camera].scale

    def _take(self, event: Any, camera: str) -> None:
        start = self.pixel_at(event.start_screen_pos, camera)
        held = self._handle_at(camera, start) if self._composer.tool == SELECT else None
        if held is None:
            self._grab = _Grab(None, camera, event.start_screen_pos, (0.0, 0.0), np.array([start]))
        else:
            name, end, points = held
            self._composer.selected = name
            place = points.mean(axis=0) if end is None else points[end]
            offset = float(place[0]) - start[0], float(place[1]) - start[1]
            self._grab = _Grab(name, camera, event.start_screen_pos, offset, points, end)

    def _inside(self, camera: str, uv: Uv) -> Uv:
        assert self._shown.layout is not None
        w, h = self._shown.layout.cells[camera].size
        return float(min(max(uv[0], 0.0), w - 1.0)), float(min(max(uv[1], 0.0), h - 1.0))

    def _release_later(self, name: str) -> None:
        timer = threading.Timer(SETTLE_S, lambda: self.dragged.pop(name, None))
        timer.daemon = True
        timer.start()


def _nearest(points: Array, uv: Uv, reach: float) -> tuple[float, int | None]:
    """Distance [px] of `uv` to a point, or to a line (2, 2), and which of the line's ends is meant."""
    apart = np.hypot(*(points - uv).T)
    if len(points) == 1:
        return float(apart[0]), None
    end = int(np.argmin(apart))
    if apart[end] <= reach:
        return float(apart[end]), end
    along = points[1] - points[0]
    share = np.clip((uv - points[0]) @ along / max(float(along @ along), 1e-9), 0.0, 1.0)
    return float(np.hypot(*(points[0] + share * along - uv))), None
