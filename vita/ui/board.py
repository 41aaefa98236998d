"""The camera board of one browser: its images, its overlay, its lens, and the clicks on it.

Nodes are made per client, so that each browser has its own arrangement (side by side or stacked), its
own zoom and its own pace, and so that everything is gone when it leaves.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import viser

from vita.scenario.schema import CameraSpec
from vita.snapshot import Snapshot
from vita.types import Array
from vita.ui.compose import SELECT, Composer
from vita.ui.labels import LabelPool
from vita.ui.layout import FOV, Cell, Layout, arrange, unproject, window_distance
from vita.ui.overlay import Drawing, draw
from vita.ui.world3d import Mesh, World3D

REACH_PX = 10.0
"""How near a click must be to a marker to mean it [screen pixels]."""
SLIP_PX = 5.0
"""A drag shorter than this is a click of an unsteady hand [screen pixels]."""
FAR_BELOW = 2.0e5
"""Where the big 3D world stands: far outside what the board's lens can see [board units]."""
WORLD_SCALE = 1000.0
SCENE_CENTER = np.array([0.35, 0.0, 0.30])
SCENE_HEIGHT = 1.5
"""Height of what the small 3D view should show [m]."""
STRAIGHT = np.array([1.0, 0.0, 0.0, 0.0])

Mode = Literal["cameras", "world"]


@dataclass
class _Grab:
    name: str | None
    camera: str
    start: tuple[float, float]
    offset: tuple[float, float]
    uv: tuple[float, float]


@dataclass
class _View:
    """The nodes of one camera."""

    frame: viser.FrameHandle
    image: viser.ImageHandle
    halo: viser.LineSegmentsHandle
    bold: viser.LineSegmentsHandle
    thin: viser.LineSegmentsHandle
    labels: LabelPool


class Board:
    """Everything that one browser sees to the left of the panels."""

    def __init__(
        self,
        client: viser.ClientHandle,
        composer: Composer,
        guard: Callable[[Callable[[Any], None]], Callable[[Any], Any]],
        on_pick: Callable[[str, tuple[float, float], str | None], None],
        on_move: Callable[[str, tuple[float, float]], None],
        on_miss: Callable[[Any], None],
    ) -> None:
        self.client, self._composer, self._guard = client, composer, guard
        self._on_pick, self._on_move, self._on_miss = on_pick, on_move, on_miss
        self.layout: Layout | None = None
        self.mode: Mode = "cameras"
        self.pane = True
        self.dragged: dict[str, tuple[float, float]] = {}
        self._views: dict[str, _View] = {}
        self._cameras: tuple[CameraSpec, ...] = ()
        self._aspect = 0.0
        self._closeup: str | None = None
        self._grab: _Grab | None = None
        self._snapshot: Snapshot | None = None
        self._fitted_at = 0.0
        self._jobs: deque[Callable[[], None]] = deque()
        scene = client.scene
        self._backdrop = scene.add_mesh_simple(
            "/backdrop", np.array([[-4e4, -4e4, 0], [4e4, -4e4, 0], [4e4, 4e4, 0], [-4e4, 4e4, 0]], float),
            np.array([[0, 1, 2], [0, 2, 3]]), color=(255, 255, 255), opacity=0.0, side="double",
            cast_shadow=False, receive_shadow=False, position=(0.0, 0.0, 4000.0),
        )
        self._backdrop.on_click(guard(self._on_miss))
        self._backdrop.on_drag("left")(guard(lambda event: None))
        self._small = World3D(scene, "/overview", 200.0)
        self._big = World3D(scene, "/world3d", WORLD_SCALE)
        self._big.place((0.0, FAR_BELOW, 0.0), np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), True)
        scene.add_grid(
            "/world3d/grid", width=4000.0, height=4000.0, plane="xy", cell_size=200.0, section_size=1000.0,
            cell_color=(222, 226, 232), section_color=(196, 203, 212), shadow_opacity=0.0,
        )
        self._title = LabelPool(scene, "/titles", 1.15)
        client.camera.max_orbit_distance = 1.0e6
        client.camera.on_update(self._camera_moved)

    # Showing.

    def show(self, snapshot: Snapshot, encoded: Mapping[str, bytes]) -> None:
        """Bring images and overlay up to `snapshot`. `encoded` holds the frames as JPEG."""
        sizes = {name: (frame.shape[1], frame.shape[0]) for name, frame in snapshot.frames.items()}
        known = {name: cell.size for name, cell in self.layout.cells.items()} if self.layout else {}
        if sizes != known:
            self._rearrange(sizes)
        self._snapshot = snapshot
        if self.layout is None:
            return
        if self.mode == "cameras":
            for name, view in self._views.items():
                if name in encoded:
                    view.image._data = encoded[name]
                cell = self.layout.cells[name]
                unit = self.unit() / cell.scale
                self._stroke(view, cell, draw(name, cell, snapshot, self._composer, unit, self.dragged))
            if self.layout.pane is not None and self.pane:
                self._small.update(snapshot.poses)
        else:
            self._big.update(snapshot.poses)

    def build_world(self, meshes: Sequence[Mesh], cameras: Sequence[CameraSpec], revision: int) -> None:
        """Load the meshes of a (new) rig into both 3D views."""
        if self._small.revision != revision:
            self._small.build(meshes, cameras, revision)
            self._big.build(meshes, cameras, revision)

    def unit(self) -> float:
        """Board units per screen pixel at the present zoom."""
        camera = self.client.camera
        height = 2.0 * abs(float(camera.position[2])) * np.tan(float(camera.fov) / 2.0)
        return float(height) / max(self._css_height(), 1.0)

    def _css_height(self) -> float:
        # viser reports device pixels, which adaptive resolution and dense screens change; the window's
        # own height is not told, so markers keep within what windows usually measure.
        return float(np.clip(self.client.camera.image_height, 500.0, 1100.0))

    # Jobs that change nodes run on the stream's thread only, one after the other.

    def later(self, job: Callable[[], None]) -> None:
        """Have `job` done by the thread that draws."""
        self._jobs.append(job)

    def work_off(self) -> None:
        while self._jobs:
            self._jobs.popleft()()

    def _stroke(self, view: _View, cell: Cell, drawing: Drawing) -> None:
        for handle, strokes, z in ((view.bold, drawing.bold, -3.0), (view.thin, drawing.thin, -2.0)):
            points, colors = strokes.arrays(cell, z)
            handle.points, handle.colors = points, colors
            if handle is view.bold:
                halo = points.copy()
                halo[..., 2] = -1.0
                view.halo.points, view.halo.colors = halo, np.full_like(colors, 255)
        view.labels.show(
            [(tag.text, (*_local(cell, tag.uv), -4.0), tag.anchor) for tag in drawing.tags]
        )

    # Arranging and fitting.

    def _rearrange(self, sizes: Mapping[str, tuple[int, int]]) -> None:
        self._aspect = float(self.client.camera.aspect)
        self.layout = arrange(sizes, self._aspect, self.pane)
        for name in [n for n in self._views if n not in sizes]:
            gone = self._views.pop(name)
            gone.labels.clear()
            gone.frame.remove()
        for name in sizes:
            cell = self.layout.cells[name]
            if name in self._views and self._views[name].image.render_width == cell.rect.w:
                self._views[name].frame.position = (cell.rect.x, cell.rect.y, 0.0)
                continue
            if name in self._views:
                self._views.pop(name).frame.remove()
            self._views[name] = self._make_view(name, cell)
        self._title.show(
            [
                (name, (cell.rect.x, cell.rect.y - 5.0, -4.0), "bottom-left")
                for name, cell in self.layout.cells.items()
            ]
            + ([("3D overview", (self.layout.pane.x, self.layout.pane.y, -4.0), "top-left")]
               if self.layout.pane and self.pane else [])
        )
        self._place_small()
        self.fit()

    def _place_small(self) -> None:
        pane = self.layout.pane if self.layout and self.pane else None
        if pane is None:
            self._small.place((0.0, 0.0, 0.0), np.eye(3), False)
            return
        self._small.rescale(min(pane.h / SCENE_HEIGHT, pane.w / 2.6))
        rotation = _looking(np.array([1.6, -1.5, 1.15]))
        center = rotation @ SCENE_CENTER * self._small.scale
        x, y = pane.center
        self._small.place((x - center[0], y - center[1], 1500.0 - center[2]), rotation, True)
        if self._snapshot is not None:
            self._small.update(self._snapshot.poses)

    def _make_view(self, name: str, cell: Cell) -> _View:
        scene, root = self.client.scene, f"/view/{name}"
        w, h = cell.size
        frame = scene.add_frame(root, show_axes=False, position=(cell.rect.x, cell.rect.y, 0.0))
        image = scene.add_image(
            f"{root}/image", np.full((h, w, 3), 235, np.uint8), cell.rect.w, cell.rect.h, format="jpeg",
            jpeg_quality=80, cast_shadow=False, receive_shadow=False,
            position=(cell.rect.w / 2, cell.rect.h / 2, 0.0),
        )
        image.on_click(self._guard(lambda event, name=name: self._clicked(event, name)))
        image.on_drag("left")(self._guard(lambda event, name=name: self._dragging(event, name)))
        nothing = np.zeros((1, 2, 3), np.float32)

        def lines(part: str, thickness: float) -> viser.LineSegmentsHandle:
            return scene.add_line_segments(
                f"{root}/{part}", nothing, np.zeros((1, 2, 3), np.uint8), thickness=thickness,
                thickness_units="screen",
            )

        return _View(
            frame, image, lines("halo", 4.6), lines("bold", 2.4), lines("thin", 1.3),
            LabelPool(scene, f"{root}/label", 1.0),
        )

    def fit(self, camera: str | None = None) -> None:
        """Show the whole board, or one camera's view as large as it goes."""
        if self.layout is None or self.mode != "cameras":
            return
        self._closeup = camera if camera in self.layout.cells else None
        if self._closeup:
            rect = self.layout.cells[self._closeup].rect
            height = max(rect.h, rect.w / max(self._aspect, 0.1)) * 1.03
        else:
            rect, height = self.layout.window, self.layout.window.h
        x, y = rect.center
        self._aim((x, y, -window_distance(height)), (x, y, 0.0), (0.0, -1.0, 0.0), FOV)

    def switch(self, mode: Mode) -> None:
        """Between the cameras and the 3D world, which may be orbited."""
        if mode == self.mode:
            return
        self.mode = mode
        if mode == "cameras":
            self.fit()
            return
        base = np.array([0.0, FAR_BELOW, 0.0])
        turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        eye = base + turn @ (np.array([1.9, -1.7, 1.35]) * WORLD_SCALE)
        target = base + turn @ (SCENE_CENTER * WORLD_SCALE)
        self._aim(tuple(eye), tuple(target), (0.0, -1.0, 0.0), np.radians(42.0))
        if self._snapshot is not None:
            self._big.update(self._snapshot.poses)

    def set_pane(self, shown: bool) -> None:
        self.pane = shown
        if self.layout is not None:
            self._rearrange({name: cell.size for name, cell in self.layout.cells.items()})

    def _aim(self, eye: Sequence[float], target: Sequence[float], up: Sequence[float], fov: float) -> None:
        camera = self.client.camera
        with self.client.atomic():
            camera.up_direction = up  # type: ignore
            camera.fov = float(fov)
            camera.near, camera.far = 100.0, 1.0e5
            camera.position = eye  # type: ignore
            camera.look_at = target  # type: ignore
        self._fitted_at = time.monotonic()

    async def _camera_moved(self, camera: viser.CameraHandle) -> None:
        """Refit when the window changes; undo what arrow keys and orbiting do to a straight view."""
        if self.mode != "cameras" or self.layout is None:
            return
        if abs(camera.aspect - self._aspect) > 1e-3:
            self._aspect = float(camera.aspect)
            self.later(self._refit)
            return
        if time.monotonic() - self._fitted_at > 0.4 and min(
            np.abs(camera.wxyz - STRAIGHT).max(), np.abs(camera.wxyz + STRAIGHT).max()
        ) > 2e-3:
            distance = float(np.linalg.norm(camera.look_at - camera.position))
            x, y = float(camera.look_at[0]), float(camera.look_at[1])
            self._fitted_at = time.monotonic()
            self.later(lambda: self._aim((x, y, -distance), (x, y, 0.0), (0.0, -1.0, 0.0), FOV))

    def _refit(self) -> None:
        if self.layout is not None:
            closeup = self._closeup
            self._rearrange({name: cell.size for name, cell in self.layout.cells.items()})
            if closeup:
                self.fit(closeup)

    # Picking.

    def pixel_at(self, screen: tuple[float, float], camera: str) -> tuple[float, float]:
        """The image pixel of `camera` under a place of the window (0 to 1 each)."""
        assert self.layout is not None
        lens = self.client.camera
        x, y = unproject(
            screen, tuple(float(p) for p in lens.position), float(lens.fov), float(lens.aspect)  # type: ignore
        )
        return self.layout.cells[camera].to_pixel(x, y)

    def screen_of(self, camera: str, uv: tuple[float, float]) -> tuple[float, float]:
        """The place of the window (0 to 1 each) where a pixel is seen; the inverse of `pixel_at`."""
        assert self.layout is not None
        lens = self.client.camera
        x, y = self.layout.cells[camera].to_board(*uv)
        height = 2.0 * abs(float(lens.position[2])) * np.tan(float(lens.fov) / 2.0)
        return (
            float((x - lens.position[0]) / (height * lens.aspect) + 0.5),
            float((y - lens.position[1]) / height + 0.5),
        )

    def marker_at(self, camera: str, uv: tuple[float, float]) -> str | None:
        """The tracker of `camera` whose marker is nearest to `uv`, if within reach."""
        if self._snapshot is None or self.layout is None:
            return None
        reach = REACH_PX * self.unit() / self.layout.cells[camera].scale
        best: tuple[float, str] | None = None
        for spec in self._snapshot.scenario.tracker:
            feature = self._snapshot.features.get(spec.name)
            place: Array | tuple[float, float] | None = feature.uv if feature is not None else spec.at
            if spec.camera != camera or place is None:
                continue
            distance = float(np.hypot(place[0] - uv[0], place[1] - uv[1]))
            if distance <= reach and (best is None or distance < best[0]):
                best = distance, spec.name
        return best[1] if best else None

    def _inside(self, camera: str, uv: tuple[float, float]) -> tuple[float, float]:
        assert self.layout is not None
        w, h = self.layout.cells[camera].size
        return float(min(max(uv[0], 0.0), w - 1.0)), float(min(max(uv[1], 0.0), h - 1.0))

    def _clicked(self, event: Any, camera: str) -> None:
        uv = self._inside(camera, self.pixel_at(event.screen_pos, camera))
        self._on_pick(camera, uv, self.marker_at(camera, uv))

    def _dragging(self, event: Any, camera: str) -> None:
        """Drag a marker; a drag that starts elsewhere and hardly moves is a click."""
        if event.phase == "start":
            start = self.pixel_at(event.start_screen_pos, camera)
            name = self.marker_at(camera, start) if self._composer.tool == SELECT else None
            place = start
            if name is not None and self._snapshot is not None:
                feature = self._snapshot.features.get(name)
                place = tuple(feature.uv) if feature is not None else start
            self._grab = _Grab(name, camera, event.start_screen_pos,
                               (place[0] - start[0], place[1] - start[1]), start)
            if name is not None:
                self._composer.selected = name
            return
        grab = self._grab
        if grab is None or grab.camera != camera:
            return
        here = self.pixel_at(event.end_screen_pos, camera)
        grab.uv = self._inside(camera, (here[0] + grab.offset[0], here[1] + grab.offset[1]))
        if grab.name is not None:
            self.dragged[grab.name] = grab.uv
        if event.phase != "end":
            return
        self._grab = None
        if grab.name is not None:
            self._on_move(grab.name, grab.uv)
            # The marker stays where it was dropped until the engine has moved the tracker.
            self._release_later(grab.name)
        else:
            lens = self.client.camera
            moved = np.hypot(
                (event.end_screen_pos[0] - grab.start[0]) * lens.image_width,
                (event.end_screen_pos[1] - grab.start[1]) * lens.image_height,
            )
            if moved < SLIP_PX:
                uv = self._inside(camera, here)
                self._on_pick(camera, uv, self.marker_at(camera, uv))

    def _release_later(self, name: str) -> None:
        timer = threading.Timer(0.25, lambda: self.dragged.pop(name, None))
        timer.daemon = True
        timer.start()


def _local(cell: Cell, uv: tuple[float, float]) -> tuple[float, float]:
    return (uv[0] + 0.5) * cell.scale, (uv[1] + 0.5) * cell.scale


def _looking(eye: np.ndarray) -> np.ndarray:
    """(3, 3) rotation from world axes to a lens at `eye` that looks at the scene: x right, y down, z away."""
    forward = SCENE_CENTER - eye
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])
