"""The browsers that look at the page: each has a board and a stream of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

import viser

from vita.snapshot import Snapshot
from vita.types import Visual
from vita.ui import pointer
from vita.ui.board import Board
from vita.ui.mesh import Mesh
from vita.ui.panels.view import Display
from vita.ui.safe import log
from vita.ui.stream import Encoder, Stream
from vita.ui.world3d import prepare


class Audience:
    def __init__(
        self,
        server: viser.ViserServer,
        wait_newer: Callable[[int, float], Snapshot | None],
        revision: Callable[[], int],
        visuals: Callable[[], Sequence[Visual]],
        make_board: Callable[[viser.ClientHandle], Board],
    ) -> None:
        """`revision` grows when the rig, and with it `visuals`, has changed."""
        self._wait_newer, self._make_board = wait_newer, make_board
        self._revision, self._visuals = revision, visuals
        self.boards: dict[int, Board] = {}
        self.display = Display()
        self.encoder = Encoder()
        self._streams: dict[int, Stream] = {}
        self._meshes: tuple[int, Sequence[Mesh]] = (-1, ())
        self._meshes_lock = threading.Lock()
        self._meshes_of_now()
        server.on_client_connect(self._arrived)
        server.on_client_disconnect(self._left)

    def board_of(self, event: Any) -> Board | None:
        """The board of the browser from which `event` came."""
        return self.boards.get(event.client_id)

    def rate_hz(self) -> float:
        """Pictures per second of the fastest browser."""
        return max((stream.rate_hz for stream in list(self._streams.values())), default=0.0)

    def set_pane(self, shown: bool) -> None:
        """Show or hide the 3D overview everywhere."""
        self.display.pane = shown
        for board in list(self.boards.values()):
            board.later(lambda board=board: board.set_pane(shown))

    def set_foresee(self, shown: bool) -> None:
        """Show or hide the next step everywhere."""
        self.display.foresee = shown
        for board in list(self.boards.values()):
            board.foresee = shown

    def set_forces(self, shown: bool) -> None:
        """Show or hide forces and the virtual mass everywhere."""
        self.display.forces = shown
        for board in list(self.boards.values()):
            board.forces = shown

    def stop(self) -> None:
        for stream in list(self._streams.values()):
            stream.stop()

    def _arrived(self, client: viser.ClientHandle) -> None:
        board = self._make_board(client)
        board.pane, board.foresee = self.display.pane, self.display.foresee
        board.forces = self.display.forces
        self.boards[client.client_id] = board

        def show(snapshot: Snapshot) -> None:
            board.work_off()
            revision, meshes = self._meshes_of_now()
            board.build_world(meshes, snapshot.scenario.camera, revision)
            board.show(snapshot, self.encoder.encode(snapshot) if board.mode == "cameras" else {})

        def told(text: str | None) -> None:
            board.hover = pointer.place_of(text)

        pointer.install(client)
        stream = Stream(
            client, self._wait_newer, show, lambda: self.display.fps, told, pointer.key_of(client)
        )
        self._streams[client.client_id] = stream

    def _left(self, client: viser.ClientHandle) -> None:
        stream = self._streams.pop(client.client_id, None)
        if stream is not None:
            stream.stop()
        self.boards.pop(client.client_id, None)

    def _meshes_of_now(self) -> tuple[int, Sequence[Mesh]]:
        with self._meshes_lock:
            revision = self._revision()
            if self._meshes[0] != revision:
                try:
                    self._meshes = (revision, prepare(self._visuals()))
                except Exception:
                    log.exception("the 3D view has no meshes")
                    self._meshes = (revision, ())
            return self._meshes
