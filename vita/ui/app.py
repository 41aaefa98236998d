"""The page: one viser server, one composer, one board per browser, and the panels."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Sequence
from contextlib import redirect_stdout
from typing import Any, Protocol

import viser
from viser import _messages

from vita import commands as c
from vita.snapshot import Snapshot
from vita.types import Visual
from vita.ui.board import Board, Mode
from vita.ui.compose import SELECT, TRACKER, Composer
from vita.ui.hotkeys import add_hotkeys
from vita.ui.panels import Desk, FilesPanel, Panel, RunPanel, ServoPanel, TaskPanel, ViewPanel
from vita.ui.panels.view import Display
from vita.ui.plots import Plots
from vita.ui.ports import check_free
from vita.ui.safe import guarded, log
from vita.ui.stream import Encoder, Stream
from vita.ui.words import TEAL
from vita.ui.world3d import Mesh, prepare

PANEL_PERIOD_S = 0.1
NOTICES_PER_SECOND = 3
COLORS = {"info": "blue", "warning": "orange", "error": "red"}


class RunnerLike(Protocol):
    """What the page needs of `vita.runner.Runner`."""

    rig_revision: int

    def submit(self, command: Any) -> None: ...
    def stop(self) -> None: ...
    def snapshot(self) -> Snapshot: ...
    def wait_newer(self, tick: int, timeout: float) -> Snapshot | None: ...
    def visuals(self) -> Sequence[Visual]: ...
    def close(self) -> None: ...


class App:
    """Builds the page on `host:port` (0 picks a free port) and keeps it up to date until `close()`."""

    def __init__(self, runner: RunnerLike, host: str = "127.0.0.1", port: int = 8080) -> None:
        self.runner = runner
        self.host = host
        wanted = check_free(host, port)
        with redirect_stdout(io.StringIO()):  # viser prints a banner, `verbose` or not
            self.server = viser.ViserServer(host=host, port=wanted, verbose=False, label=" ")
        for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            # Any connected page could otherwise open a public tunnel to the arm.
            self.server._websock_server.unregister_handler(message)
        self.composer = Composer(self._submit)
        self.boards: dict[int, Board] = {}
        self._streams: dict[int, Stream] = {}
        self._display = Display()
        self._encoder = Encoder()
        self._meshes: tuple[int, Sequence[Mesh]] = (-1, ())
        self._meshes_lock = threading.Lock()
        self._told = max((n.id for n in runner.snapshot().notices), default=0)
        self._recent: list[float] = []
        self._closing = threading.Event()
        self.guard = guarded(self.tell)
        self._scene()
        self.panels: list[Panel] = []
        self._panels()
        self._scene_meshes()
        self.server.on_client_connect(self._arrived)
        self.server.on_client_disconnect(self._left)
        self._thread = threading.Thread(target=self._run, name="vita-page", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        return self.server.get_port()

    @property
    def url(self) -> str:
        return f"http://{self.host}:{self.port}"

    def close(self) -> None:
        """Free the port. The runner is the caller's to close. Idempotent."""
        if self._closing.is_set():
            return
        self._closing.set()
        for stream in list(self._streams.values()):
            stream.stop()
        self._thread.join(timeout=2.0)
        with redirect_stdout(io.StringIO()):
            self.server.stop()

    def rate_hz(self) -> float:
        """Pictures per second of the fastest browser."""
        return max((stream.rate_hz for stream in list(self._streams.values())), default=0.0)

    def tell(self, client: Any, level: str, text: str) -> None:
        """A message to one browser; errors stay until they are closed."""
        client.add_notification(
            {"info": "vita", "warning": "Please note", "error": "Error"}.get(level, "vita"), text[:400],
            auto_close_seconds=None if level == "error" else 8.0, color=COLORS.get(level, "gray"),
        )

    # Building.

    def _scene(self) -> None:
        server = self.server
        server.scene.set_up_direction("-y")
        server.scene.world_axes.visible = False
        server.scene.configure_default_lights(True, cast_shadow=False)
        camera = server.initial_camera
        camera.position, camera.look_at = (650.0, 480.0, -11500.0), (650.0, 480.0, 0.0)  # type: ignore
        camera.up, camera.near, camera.far, camera.fov = (0.0, -1.0, 0.0), 100.0, 1.0e5, 0.0873  # type: ignore
        server.gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=TEAL, control_width="large",
        )

    def _panels(self) -> None:
        gui = self.server.gui
        desk = Desk(
            gui, self.composer, self._submit, self.runner.stop, self.runner.snapshot, self.guard, self.tell
        )
        self.run = RunPanel(desk, self.switch)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(390)
        tabs = gui.add_panel()
        files: FilesPanel
        with tabs.add_tab("Task", viser.Icon.TARGET):
            task = TaskPanel(desk, lambda event: files.show_me(event))
        with tabs.add_tab("Servo", viser.Icon.ADJUSTMENTS):
            servo = ServoPanel(desk)
        with tabs.add_tab("Files", viser.Icon.FOLDER):
            files = FilesPanel(desk)
        with tabs.add_tab("View", viser.Icon.EYE):
            view = ViewPanel(
                desk, self._display, self._set_quality, self._switch, self._fit, self._set_pane, self.rate_hz
            )
        tabs.dock_below(gui.main_panel)
        plots = gui.add_panel()
        self.plots = Plots(gui, plots)
        plots.dock_below(tabs)
        self.panels = [self.run, task, servo, files, view]
        add_hotkeys(self)

    # Browsers come and go.

    def _arrived(self, client: viser.ClientHandle) -> None:
        board = Board(client, self.composer, self.guard, self._picked, self._moved, self._missed)
        board.pane = self._display.pane
        self.boards[client.client_id] = board

        def show(snapshot: Snapshot) -> None:
            board.work_off()
            revision, meshes = self._scene_meshes()
            board.build_world(meshes, snapshot.scenario.camera, revision)
            board.show(snapshot, self._encoder.encode(snapshot) if board.mode == "cameras" else {})

        self._streams[client.client_id] = Stream(
            client, self.runner.wait_newer, show, lambda: self._display.fps
        )

    def _left(self, client: viser.ClientHandle) -> None:
        stream = self._streams.pop(client.client_id, None)
        if stream is not None:
            stream.stop()
        self.boards.pop(client.client_id, None)

    def _scene_meshes(self) -> tuple[int, Sequence[Mesh]]:
        with self._meshes_lock:
            revision = self.runner.rig_revision
            if self._meshes[0] != revision:
                try:
                    self._meshes = (revision, prepare(self.runner.visuals()))
                except Exception:
                    log.exception("the 3D view has no meshes")
                    self._meshes = (revision, ())
            return self._meshes

    # What people do.

    def _submit(self, command: object) -> None:
        self.runner.submit(command)

    def _picked(self, camera: str, uv: tuple[float, float], hit: str | None) -> None:
        self.composer.click(self.runner.snapshot(), camera, uv, hit)

    def _moved(self, name: str, uv: tuple[float, float]) -> None:
        self._submit(c.MoveTracker(name, uv))

    def _missed(self, event: Any) -> None:
        board = self.boards.get(event.client_id)
        if board is None or board.mode != "cameras":
            return
        if self.composer.tool == SELECT:
            self.composer.selected = None
        else:
            self.composer.note = "Click inside one of the camera pictures."

    def escape(self, event: Any) -> None:
        """Esc puts the tool away; with nothing in hand it stops the arm."""
        if self.composer.composing:
            self.composer.put_away()
        else:
            self.run.stop()

    def delete(self, event: Any) -> None:
        if self.composer.selected is not None:
            self._submit(c.DeleteTracker(self.composer.selected))
            self.composer.selected = None

    def nudge(self, du: float, dv: float) -> None:
        """Move the selected marker by whole or part pixels."""
        name = self.composer.selected
        feature = self.runner.snapshot().features.get(name) if name else None
        if name is not None and feature is not None:
            self._submit(c.MoveTracker(name, (float(feature.uv[0]) + du, float(feature.uv[1]) + dv)))

    def _switch(self, event: Any, choice: str) -> None:
        mode: Mode = "world" if choice == "3D world" else "cameras"
        self.switch(event, mode)

    def switch(self, event: Any, mode: Mode | None = None) -> None:
        board = self.boards.get(event.client_id)
        if board is not None:
            target: Mode = mode or ("world" if board.mode == "cameras" else "cameras")
            board.later(lambda: board.switch(target))

    def _fit(self, event: Any) -> None:
        self.fit(event)

    def fit(self, event: Any, number: int | None = None) -> None:
        """Show everything, or the `number`-th camera (from 0) as large as it goes."""
        board = self.boards.get(event.client_id)
        if board is None or board.layout is None:
            return
        names = list(board.layout.cells)
        name = names[number] if number is not None and number < len(names) else None
        board.later(lambda: board.switch("cameras"))
        board.later(lambda: board.fit(name))

    def _set_quality(self, quality: int) -> None:
        self._encoder.quality = quality

    def _set_pane(self, shown: bool) -> None:
        for board in list(self.boards.values()):
            board.later(lambda board=board: board.set_pane(shown))

    # Keeping up to date.

    def _run(self) -> None:
        tick = -1
        while not self._closing.is_set():
            started = time.monotonic()
            snapshot = self.runner.wait_newer(tick, 0.5)
            if snapshot is not None:
                tick = snapshot.tick
                try:
                    self._refresh(snapshot)
                except Exception:
                    log.exception("updating the panels failed")
            self._closing.wait(max(0.0, PANEL_PERIOD_S - (time.monotonic() - started)))

    def _refresh(self, snapshot: Snapshot) -> None:
        self.composer.reconcile(snapshot)
        self._announce(snapshot)
        if not self.boards:
            return  # nobody looks
        with self.server.atomic():
            for panel in self.panels:
                panel.update(snapshot)
            self.plots.update(snapshot, time.monotonic())

    def _announce(self, snapshot: Snapshot) -> None:
        """New notices as notifications; a flood is cut, since all of them can be read in the panel."""
        now = time.monotonic()
        for notice in snapshot.notices:
            if notice.id <= self._told:
                continue
            self._told = notice.id
            self._recent = [t for t in self._recent if now - t < 1.0]
            if len(self._recent) >= NOTICES_PER_SECOND:
                continue
            self._recent.append(now)
            for client in self.server.get_clients().values():
                self.tell(client, notice.level, notice.text)


__all__ = ["App", "RunnerLike", "TRACKER"]
