"""One browser's mouse in one 3D view: which meshes can be taken, and what is in the hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser

from vita.snapshot import Snapshot
from vita.ui.dragging import Grip, Mover, movable
from vita.ui.world3d import World3D


class Hand:
    def __init__(
        self, client: viser.ClientHandle, world: World3D, mover: Mover,
        guard: Callable[[Callable[[Any], None]], Callable[[Any], Any]],
    ) -> None:
        self._client, self._world, self._mover, self._guard = client, world, mover, guard
        self._offered: tuple[int, tuple[str, ...]] = (-1, ())
        self._grip: Grip | None = None

    def offer(self, snapshot: Snapshot) -> None:
        """Let exactly the movable things of `snapshot` be taken; no work unless they have changed."""
        wanted = self._world.revision, movable(snapshot)
        if wanted == self._offered:
            return
        revision, names = self._offered
        self._offered, self._grip = wanted, None
        if revision == wanted[0]:  # else their meshes are gone
            for name in names:
                for node in self._world.nodes(name):
                    node.remove_drag_callback("all")
                    node.remove_click_callback("all")
        for name in wanted[1]:
            for node in self._world.nodes(name):
                node.on_click(self._guard(lambda event, name=name: self._choose(name)))
                node.on_drag("left")(self._guard(lambda event, name=name: self._drag(event, name, False)))
                node.on_drag("left", modifier="shift")(
                    self._guard(lambda event, name=name: self._drag(event, name, True))
                )

    def _choose(self, name: str) -> None:
        self._mover.selected = name

    def _drag(self, event: Any, name: str, upright: bool) -> None:
        if event.phase == "start":
            self._grip = self._mover.take(name, self._world.metres(event.start_position), upright)
        grip = self._grip
        if grip is None or grip.name != name:
            return
        eye = self._world.metres(tuple(float(x) for x in self._client.camera.position))
        self._mover.drag(grip, eye, self._world.metres(event.end_position), last=event.phase == "end")
        if event.phase == "end":
            self._grip = None
