"""The page: one viser server, one composer, one board per browser, and the panels."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from typing import Any, Protocol

import viser

from vita.snapshot import Snapshot
from vita.types import Visual
from vita.ui.actions import Actions
from vita.ui.announcer import Announcer
from vita.ui.audience import Audience
from vita.ui.board import Board
from vita.ui.compose import Composer
from vita.ui.dragging import Mover
from vita.ui.hardening import open_page
from vita.ui.hotkeys import add_hotkeys
from vita.ui.mode import IMPEDANCE, UVS, Tabs, TwoFaced, following
from vita.ui.ownership import Lease
from vita.ui.panels import (
    Desk,
    FaultsPanel,
    FilesPanel,
    KnowledgePanel,
    Panel,
    RunPanel,
    ServoPanel,
    StereoPanel,
    TaskPanel,
    TuningPanel,
    ViewPanel,
)
from vita.ui.permits import ACTING, Commands
from vita.ui.plots import Plots
from vita.ui.recovered import RecoveredPlots
from vita.ui.safe import guarded, log
from vita.ui.tally import Tally
from vita.ui.visitors import Visitors
from vita.ui.words import TEAL

PANEL_PERIOD_S = 0.1
PANEL_WIDTH = 390


class RunnerLike(Protocol):
    """What the page needs of `vita.runner.Runner`."""

    rig_revision: int

    def submit(self, command: Any) -> None: ...
    def stop(self, reason: str = ...) -> None: ...
    def estop(self, culprit: str = ...) -> None: ...
    def snapshot(self) -> Snapshot: ...
    def wait_newer(self, tick: int, timeout: float) -> Snapshot | None: ...
    def visuals(self) -> Sequence[Visual]: ...
    def close(self) -> None: ...


class App:
    """Builds the page on `host:port` (0 picks a free port) and keeps it up to date until `close()`."""

    def __init__(
        self, runner: RunnerLike, host: str = "127.0.0.1", port: int = 8080, *,
        allow_remote: bool = False, token: str | None = None,
        allow_unattended: bool = False, clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`allow_unattended` lets the arm go on when the page that drives it is closed; simulation only.
        `allow_remote` and `token` are those of `vita.ui.hardening.open_page`."""
        self.runner, self.host = runner, host
        self.server, self.door = open_page(host, port, allow_remote=allow_remote, token=token)
        self._closing = threading.Event()
        self._announcer, self._tally = Announcer(self.server, runner.snapshot()), Tally(runner.snapshot())
        self.door.tell = self._announcer.tell
        self.door.driver = lambda: self.commands.lease.driver
        self.door.forbids = lambda client: self.commands.lease.refusal(client)
        self.commands = Commands(runner, Lease(clock), self._shown, allow_unattended)
        plain = guarded(self._announcer.tell)
        self.guard, self.anyone = self.commands.driving(plain), self.commands.anyone(plain)
        self.composer = Composer(self._submit)
        self.mover = Mover(self._submit, runner.snapshot)
        self.actions = Actions(
            self.composer, self._submit, runner.snapshot, lambda: self.run, self.commands.lease
        )
        self._set_the_scene()
        self.visitors = Visitors(self.server, self.commands, self._announcer, self.composer)
        self.audience = self.actions.audience = Audience(
            self.server, runner.wait_newer, lambda: runner.rig_revision, runner.visuals, self._board
        )
        self.panels: list[Panel] = []
        self._add_panels()
        add_hotkeys(self)
        self._thread = threading.Thread(target=self._run, name="vita-page", daemon=True)
        self._thread.start()

    @property
    def boards(self) -> dict[int, Board]:
        """Client id to board of every browser that looks."""
        return self.audience.boards

    @property
    def port(self) -> int:
        return self.server.get_port()

    @property
    def url(self) -> str:
        return f"http://{self.door.place}"

    def close(self) -> None:
        """Free the port. The runner is the caller's to close. Idempotent."""
        if self._closing.is_set():
            return
        self._closing.set()
        self.audience.stop()
        self._thread.join(timeout=2.0)
        with redirect_stdout(io.StringIO()):
            self.server.stop()

    # Building.

    def _set_the_scene(self) -> None:
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

    def _board(self, client: viser.ClientHandle) -> Board:
        actions = self.actions
        return Board(
            client, self.composer, self.guard, actions.picked, actions.moved, actions.missed, self.mover
        )

    def _add_panels(self) -> None:
        gui, audience, actions = self.server.gui, self.audience, self.actions
        desk = Desk(
            gui, self.composer, self._submit, self._stop, self.runner.snapshot, self.guard,
            self._announcer.tell, self._estop, self.anyone,
        )
        self.run = RunPanel(desk, actions.switch, audience.rate_hz)
        self.visitors.settle(self.run.who, (self.run.stop_button, self.run.estop_button))
        self.door.always(self.run.stop_button, self.run.estop_button)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH)
        tabs = gui.add_panel()
        files: FilesPanel
        first = TwoFaced(
            gui, tabs, {UVS: ("Task", viser.Icon.TARGET), IMPEDANCE: ("Stereo", viser.Icon.TARGET_ARROW)}
        )
        second = TwoFaced(
            gui, tabs, {UVS: ("Servo", viser.Icon.ADJUSTMENTS), IMPEDANCE: ("Tuning", viser.Icon.ADJUSTMENTS)}
        )
        with first.face(UVS):
            task = TaskPanel(desk, lambda event: files.show_me(event))
        with second.face(UVS):
            servo = ServoPanel(desk)
        with first.face(IMPEDANCE):
            stereo = StereoPanel(desk, self.mover, lambda event: files.open_example("follow_target"))
        with second.face(IMPEDANCE):
            tuning = TuningPanel(desk)
        with tabs.add_tab("Files", viser.Icon.FOLDER) as files_tab:
            files = FilesPanel(desk)
            files.identity = self.commands.lease.identity
        with tabs.add_tab("View", viser.Icon.EYE) as view_tab:
            view = ViewPanel(
                desk, audience.display, audience.encoder, actions, audience.set_pane, audience.set_foresee,
                audience.set_forces,
            )
        with tabs.add_tab("Faults", viser.Icon.BUG) as faults_tab:
            faults = FaultsPanel(desk, self._tallied)
        tabs.dock_below(gui.main_panel)
        plots = gui.add_panel()
        error = TwoFaced(gui, plots, dict.fromkeys((UVS, IMPEDANCE), ("Error", viser.Icon.CHART_LINE)))
        self.plots = Plots(gui, error.face(UVS), plots.add_tab("Joints", viser.Icon.ROBOT))
        knowledge_tab = plots.add_tab("Knowledge", viser.Icon.GAUGE)
        knowledge = KnowledgePanel(gui, knowledge_tab)
        self.recovered = RecoveredPlots(gui, error.face(IMPEDANCE), plots)
        plots.dock_below(tabs)
        self.panels = [self.run, task, servo, stereo, tuning, files, view, faults, knowledge]
        self._tabs = (
            Tabs(tabs, dict.fromkeys((UVS, IMPEDANCE), (first, second, files_tab, view_tab, faults_tab))),
            Tabs(plots, {
                UVS: (error, self.plots.joints_tab, knowledge_tab),
                IMPEDANCE: (error, *self.recovered.tabs, self.plots.joints_tab),
            }),
        )
        self._hidden_in = {UVS: (stereo, tuning), IMPEDANCE: (task, servo, knowledge)}
        self._show_tabs(self.runner.snapshot())

    def _show_tabs(self, snapshot: Snapshot) -> None:
        """The tabs of the mode in force."""
        for tabs in self._tabs:
            tabs.show(snapshot.scenario.mode)

    def _submit(self, command: object) -> None:
        """A command of whoever's callback is running."""
        self.commands.submit(ACTING.get(), command)

    def _stop(self) -> None:
        self.commands.stop(ACTING.get())

    def _estop(self) -> None:
        self.commands.estop(ACTING.get())

    def _shown(self, client: int) -> int | None:
        """Number of the last picture that a page was shown."""
        board = self.boards.get(client)
        return None if board is None or board.snapshot is None else board.snapshot.tick

    def _tallied(self) -> str:
        return self._tally.html(len(self.boards), getattr(self.runner, "dropped_steps", None))

    # Keeping up to date.

    def _run(self) -> None:
        tick = -1
        while not self._closing.is_set():
            started = time.monotonic()
            if self.boards:
                snapshot = self.runner.wait_newer(tick, 0.5)
            else:  # Who waits for pictures has them drawn; nobody looks.
                latest = self.runner.snapshot()
                snapshot = latest if latest.tick != tick else None
            if snapshot is not None:
                tick = snapshot.tick
                try:
                    self._refresh(snapshot)
                except Exception:
                    log.exception("updating the panels failed")
            self._closing.wait(max(0.0, PANEL_PERIOD_S - (time.monotonic() - started)))

    def _refresh(self, snapshot: Snapshot) -> None:
        self.composer.reconcile(snapshot)
        self._announcer.update(snapshot)
        self._tally.note(snapshot)
        if not self.boards:
            return  # nobody looks
        with self.server.atomic():
            self.visitors.update(snapshot)
            self._show_tabs(snapshot)
            hidden = self._hidden_in[snapshot.scenario.mode]
            for panel in self.panels:
                if panel not in hidden:
                    panel.update(snapshot)
            self.plots.update(snapshot, time.monotonic())
            if following(snapshot):
                self.recovered.update(snapshot, time.monotonic())
            else:
                self.recovered.forget()
