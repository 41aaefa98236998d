"""What people do at the page besides the panels: clicks in the views, keys, and which view is shown."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vita import commands as c
from vita.snapshot import Snapshot
from vita.ui.audience import Audience
from vita.ui.board import Mode
from vita.ui.compose import SELECT, Composer


class Actions:
    audience: Audience
    """Set once there is one: its boards call back into this."""

    def __init__(
        self, composer: Composer, submit: Callable[[object], None], snapshot: Callable[[], Snapshot],
        stop: Callable[[], None],
    ) -> None:
        self.composer, self.submit, self._snapshot, self._stop = composer, submit, snapshot, stop

    # In the views.

    def picked(self, camera: str, uv: tuple[float, float], hit: str | None) -> None:
        self.composer.click(self._snapshot(), camera, uv, hit)

    def moved(self, name: str, uv: tuple[float, float]) -> None:
        self.submit(c.MoveTracker(name, uv))

    def missed(self, event: Any) -> None:
        """A click beside the pictures."""
        board = self.audience.board_of(event)
        if board is None or board.mode != "cameras":
            return
        if self.composer.tool == SELECT:
            self.composer.selected = None
        else:
            self.composer.note = "Click inside one of the camera pictures."

    # Keys.

    def escape(self, event: Any) -> None:
        """Esc puts the tool away; with nothing in hand it stops the arm."""
        if self.composer.composing:
            self.composer.put_away()
        else:
            self._stop()

    def delete(self, event: Any) -> None:
        if self.composer.selected is not None:
            self.submit(c.DeleteTracker(self.composer.selected))
            self.composer.selected = None

    def nudge(self, du: float, dv: float) -> None:
        """Move the selected marker by whole or part pixels."""
        name = self.composer.selected
        feature = self._snapshot().features.get(name) if name else None
        if name is not None and feature is not None:
            self.moved(name, (float(feature.uv[0]) + du, float(feature.uv[1]) + dv))

    # Which view is shown, per browser.

    def switch(self, event: Any, mode: Mode | None = None) -> None:
        """To the cameras or the 3D world; None means the other one."""
        board = self.audience.board_of(event)
        if board is not None:
            target: Mode = mode or ("world" if board.mode == "cameras" else "cameras")
            board.later(lambda: board.switch(target))

    def fit(self, event: Any, number: int | None = None) -> None:
        """Show everything, or the `number`-th camera (from 0) as large as it goes."""
        board = self.audience.board_of(event)
        if board is None or board.layout is None:
            return
        names = list(board.layout.cells)
        name = names[number] if number is not None and number < len(names) else None
        board.later(lambda: board.switch("cameras"))
        board.later(lambda: board.fit(name))
