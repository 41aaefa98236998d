"""Everything that one browser sees to the left of the panels: the camera views and the 3D world.

Nodes are made per client, so that each browser has its own arrangement (side by side or stacked), its
own zoom and its own pace, and so that everything is gone when it leaves.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import viser

from vita.scenario.schema import CameraSpec
from vita.snapshot import Snapshot
from vita.types import Array
from vita.ui.compose import Composer
from vita.ui.dragging import Mover
from vita.ui.ghost import Ghosts
from vita.ui.hand import Hand
from vita.ui.labels import LabelPool
from vita.ui.layout import Layout, arrange
from vita.ui.lens import Lens
from vita.ui.loupe import PointerLoupe
from vita.ui.mesh import Mesh
from vita.ui.mode import following
from vita.ui.overlay import NO_GHOSTS, draw
from vita.ui.picking import Picking
from vita.ui.pointer import hold_still
from vita.ui.trails import Trails
from vita.ui.view_nodes import ViewNodes
from vita.ui.world3d import SCENE_CENTER, World3D, looking

FAR_BELOW = 2.0e5
"""Where the big 3D world stands: far outside what the board's lens can see [board units]."""
WORLD_SCALE = 1000.0
SCENE_SIZE = (2.6, 1.5)
"""Width and height of what the small 3D view should show [m]."""
NEAR_EYE, WIDE_EYE = (1.9, -1.7, 1.35), (2.5, -2.4, 1.75)
"""From where the big 3D world is seen first: the arm, or also people and the tripod around it [m]."""
WIDE_SIZE = (3.4, 2.3)
WIDE_CENTER = np.array([0.6, 0.1, 0.35])
UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Turns a world with z up into the board, whose y is down."""
BESIDE = np.array([[-4e5, -4e5, 0.0], [8e5, -4e5, 0.0], [-4e5, 8e5, 0.0]])
"""A triangle far larger than any window."""

Mode = Literal["cameras", "world"]


class Board:
    def __init__(
        self,
        client: viser.ClientHandle,
        composer: Composer,
        guard: Callable[[Callable[[Any], None]], Callable[[Any], Any]],
        on_pick: Callable[[str, tuple[float, float], str | None], None],
        on_move: Callable[[str, tuple[float, float], tuple[float, float] | None], None],
        on_miss: Callable[[Any], None],
        mover: Mover,
    ) -> None:
        self._client, self._composer, self._guard = client, composer, guard
        self.on_pick, self.on_move = on_pick, on_move
        self.lens = Lens(client)
        self.picking = Picking(self, composer)
        self.layout: Layout | None = None
        self.snapshot: Snapshot | None = None
        self.mode: Mode = "cameras"
        self.pane = True
        self.foresee = True
        """Whether the next step is shown, on the images and in 3D."""
        self._wide = False
        """Whether the 3D views show the room around the arm too: people and the tripod."""
        self.forces = True
        """Whether forces, mass and what the cameras say are shown in 3D."""
        self.hover: tuple[float, float] | None = None
        """Where the pointer rests over the pictures (0 to 1 each), as the browser told last."""
        self.loupe = PointerLoupe(client.scene)
        self._trails, self._ghosts = Trails(), Ghosts()
        self._views: dict[str, ViewNodes] = {}
        self._closeup: str | None = None
        self._jobs: deque[Callable[[], None]] = deque()
        scene = client.scene
        # It catches clicks and drags beside the pictures. As a wireframe it costs nothing to draw: only
        # its far edges are; a transparent sheet halves the display rate where there is no GPU. Its face
        # turns away, because viser paints what is hovered yellow, from behind.
        self._backdrop = scene.add_mesh_simple(
            "/backdrop", BESIDE, np.array([[0, 2, 1]]), color=(255, 255, 255), wireframe=True, side="double",
            cast_shadow=False, receive_shadow=False, position=(0.0, 0.0, 4000.0),
        )
        self._backdrop.on_click(guard(on_miss))
        self._backdrop.on_drag("left")(guard(lambda event: None))
        self._small = World3D(scene, "/overview", 200.0)
        self._big = World3D(scene, "/world3d", WORLD_SCALE, labels=True)
        self._hands = [Hand(client, world, mover, guard) for world in (self._small, self._big)]
        self._big.place((0.0, FAR_BELOW, 0.0), UPRIGHT, True)
        scene.add_grid(
            "/world3d/grid", width=4000.0, height=4000.0, plane="xy", cell_size=200.0, section_size=1000.0,
            cell_color=(222, 226, 232), section_color=(196, 203, 212), shadow_opacity=0.0,
        )
        self._titles = LabelPool(scene, "/titles", 1.15)
        client.camera.on_update(self._camera_moved)

    # Showing.

    def show(self, snapshot: Snapshot, encoded: Mapping[str, bytes]) -> None:
        """Bring images and overlay up to `snapshot`. `encoded` holds the frames as JPEG."""
        sizes = {name: (frame.shape[1], frame.shape[0]) for name, frame in snapshot.frames.items()}
        if sizes != self._sizes():
            self._rearrange(sizes)
        self.snapshot = snapshot
        if self.layout is None:
            return
        if following(snapshot) != self._wide:
            self._wide = following(snapshot)
            self._place_small()
        for hand in self._hands:
            hand.offer(snapshot)
        if self.mode == "world":
            self._show_world(self._big, snapshot)
            return
        if self.lens.tilted():  # A browser that has fallen silent tells nothing that could start this.
            self.lens.straighten()
        unit, aim = self.lens.unit(), self._aim()
        self._magnify(snapshot, aim, unit)
        self._trails.add(snapshot)
        ghosts = self._ghosts.update(snapshot) if self.foresee else NO_GHOSTS
        for name, view in self._views.items():
            if name in encoded:
                view.show_picture(encoded[name])
            cell = self.layout.cells[name]
            drawing = draw(
                name, cell, snapshot, self._composer, unit / cell.scale, self.picking.dragged, self._trails,
                aim[1] if aim is not None and aim[0] == name else None, ghosts,
            )
            covered = self.loupe.box
            if covered is not None:  # labels would shine through the loupe
                drawing.tags = [t for t in drawing.tags if not covered.holds(*cell.to_board(*t.uv))]
            view.stroke(cell, drawing, unit / cell.scale)
        if self.layout.pane is not None and self.pane:
            self._show_world(self._small, snapshot)

    def _show_world(self, world: World3D, snapshot: Snapshot) -> None:
        world.update(snapshot.poses)
        world.foresee(self._ghost_poses(snapshot), snapshot.poses)
        world.feel(snapshot, self.forces)

    def _ghost_poses(self, snapshot: Snapshot) -> Mapping[str, Array]:
        return snapshot.ghost_poses if self.foresee else {}

    def _aim(self) -> tuple[str, tuple[float, float]] | None:
        """The camera and the pixel that are being chosen: by a hand that holds the button down, or by
        a pointer that has a tool in hand."""
        if self.picking.aim is not None:
            return self.picking.aim
        if self._composer.composing and self.hover is not None:
            return self.picking.hovered(self.hover)
        return None

    def _magnify(self, snapshot: Snapshot, aim: tuple[str, tuple[float, float]] | None, unit: float) -> None:
        if aim is None or aim[0] not in snapshot.frames or self.layout is None:
            self.loupe.hide()
            return
        board = self.layout.cells[aim[0]].to_board(*aim[1])
        self.loupe.show(aim[0], snapshot.frames[aim[0]], aim[1], board, self.lens.screen_at(*board), unit)

    def build_world(self, meshes: Sequence[Mesh], cameras: Sequence[CameraSpec], revision: int) -> None:
        """Load the meshes of a (new) rig into both 3D views."""
        if self._small.revision != revision:
            self._small.build(meshes, cameras, revision)
            self._big.build(meshes, cameras, revision)

    # Jobs that change nodes run on the stream's thread only, one after the other.

    def later(self, job: Callable[[], None]) -> None:
        """Have `job` done by the thread that draws."""
        self._jobs.append(job)

    def work_off(self) -> None:
        while self._jobs:
            self._jobs.popleft()()

    # Arranging and fitting.

    def _sizes(self) -> dict[str, tuple[int, int]]:
        return {name: cell.size for name, cell in self.layout.cells.items()} if self.layout else {}

    def _rearrange(self, sizes: Mapping[str, tuple[int, int]]) -> None:
        self.lens.take_aspect()
        self.layout = arrange(sizes, self.lens.aspect, self.pane)
        for name in [n for n in self._views if n not in sizes]:
            self._views.pop(name).remove()
        for name, cell in self.layout.cells.items():
            if name in self._views and self._views[name].fits(cell):
                self._views[name].move(cell)
                continue
            if name in self._views:
                self._views.pop(name).remove()
            self._views[name] = ViewNodes(
                self._client.scene, name, cell,
                self._guard(lambda event, name=name: self.picking.clicked(event, name)),
                self._guard(lambda event, name=name: self.picking.dragging(event, name)),
            )
        pane = self.layout.pane if self.pane else None
        self._titles.show(
            [(name, (cell.rect.x, cell.rect.y - 5.0, -4.0), "bottom-left")
             for name, cell in self.layout.cells.items()]
            + ([("3D overview", (pane.x, pane.y, -4.0), "top-left")] if pane else [])
        )
        self._place_small()
        self.fit()

    def _place_small(self) -> None:
        pane = self.layout.pane if self.layout and self.pane else None
        if pane is None:
            self._small.place((0.0, 0.0, 0.0), np.eye(3), False)
            return
        size = WIDE_SIZE if self._wide else SCENE_SIZE
        self._small.rescale(min(pane.w / size[0], pane.h / size[1]))
        rotation = looking(np.array([1.6, -1.5, 1.15]))
        center = rotation @ (WIDE_CENTER if self._wide else SCENE_CENTER) * self._small.scale
        x, y = pane.center
        self._small.place((x - center[0], y - center[1], 1500.0 - center[2]), rotation, True)
        if self.snapshot is not None:
            self._small.update(self.snapshot.poses)

    def fit(self, camera: str | None = None) -> None:
        """Show the whole board, or one camera's view as large as it goes."""
        if self.layout is None or self.mode != "cameras":
            return
        self._closeup = camera if camera in self.layout.cells else None
        if self._closeup:
            rect = self.layout.cells[self._closeup].rect
            self.lens.show(rect, max(rect.h, rect.w / max(self.lens.aspect, 0.1)) * 1.03)
        else:
            self.lens.show(self.layout.window, self.layout.window.h)

    def switch(self, mode: Mode) -> None:
        """Between the cameras and the 3D world, which may be orbited."""
        if mode == self.mode:
            return
        self.mode = mode
        hold_still(self._client, mode == "cameras")
        if mode == "cameras":
            self.fit()
            return
        base = np.array([0.0, FAR_BELOW, 0.0])
        eye = base + UPRIGHT @ (np.array(WIDE_EYE if self._wide else NEAR_EYE) * WORLD_SCALE)
        target = base + UPRIGHT @ ((WIDE_CENTER if self._wide else SCENE_CENTER) * WORLD_SCALE)
        self.lens.aim(tuple(eye), tuple(target), float(np.radians(42.0)))
        if self.snapshot is not None:
            self._big.update(self.snapshot.poses)

    def set_pane(self, shown: bool) -> None:
        self.pane = shown
        if self.layout is not None:
            self._rearrange(self._sizes())

    async def _camera_moved(self, camera: viser.CameraHandle) -> None:
        """Refit when the window changes; put a view straight again that has been turned all the same."""
        if self.mode != "cameras" or self.layout is None:
            return
        if self.lens.reshaped:
            self.lens.take_aspect()
            self.later(self._refit)
        elif self.lens.tilted():
            self.later(self.lens.straighten)

    def _refit(self) -> None:
        if self.layout is not None:
            closeup = self._closeup
            self._rearrange(self._sizes())
            if closeup:
                self.fit(closeup)
