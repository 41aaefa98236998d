"""What people do at the page besides the panels: clicks in the views, keys, and which view is shown."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from vita import commands as c
from vita.snapshot import Snapshot
from vita.types import MOVING_STATES
from vita.ui.audience import Audience
from vita.ui.board import Mode
from vita.ui.compose import SELECT, Composer
from vita.ui.ownership import Lease

if TYPE_CHECKING:
    from vita.ui.panels import RunPanel

Uv = tuple[float, float]
REPEAT_S = 0.25
"""Nudges that follow one another within this time add up, whatever the engine has made of them [s]."""


class Actions:
    audience: Audience
    """Set once there is one: its boards call back into this."""

    def __init__(
        self, composer: Composer, submit: Callable[[object], None], snapshot: Callable[[], Snapshot],
        run: Callable[[], RunPanel], lease: Lease,
    ) -> None:
        """`run` gives the panel with Start and Stop."""
        self.composer, self.submit, self._snapshot = composer, submit, snapshot
        self._run, self._lease = run, lease
        self._nudged: tuple[str, Uv, float] | None = None

    # In the views.

    def picked(self, camera: str, uv: Uv, hit: str | None) -> None:
        hint = self.composer.hint
        if hint is not None and (hint.camera, hint.uv) == (camera, uv):
            self.composer.accept(self._snapshot())
        else:
            self.composer.click(self._snapshot(), camera, uv, hit)

    def moved(self, name: str, uv: Uv, to: Uv | None = None) -> None:
        """A marker was put at `uv`; `to` is the other end of a line whose ends were moved."""
        self.submit(c.MoveTracker(name, uv, to))

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

    def toggle(self, event: Any) -> None:
        """Space stops a moving arm, whoever presses it; else it starts."""
        if self._moving:
            self._run().stop()
        else:
            self._lease.claim(event.client_id)
            self._run().start()

    def escape(self, event: Any) -> None:
        """Esc stops a moving arm, whoever presses it. At rest it puts the driver's tool away, and
        with nothing in hand it stops all the same."""
        if self.composer.composing and not self._moving and self._lease.drives(event.client_id):
            self.composer.put_away()
        else:
            self._run().stop()

    @property
    def _moving(self) -> bool:
        return self._snapshot().status.state in MOVING_STATES

    def delete(self, event: Any) -> None:
        if self.composer.selected is not None:
            self.submit(c.DeleteTracker(self.composer.selected))
            self.composer.selected = None

    def nudge(self, event: Any, du: float, dv: float) -> None:
        """Move the selected marker by whole or part pixels."""
        name, board = self.composer.selected, self.audience.board_of(event)
        feature = self._snapshot().features.get(name) if name else None
        if name is None or feature is None or board is None or board.mode != "cameras":
            return
        now, place = time.monotonic(), (float(feature.uv[0]), float(feature.uv[1]))
        if self._nudged is not None and self._nudged[0] == name and now - self._nudged[2] < REPEAT_S:
            place = self._nudged[1]  # Keys repeat faster than the engine answers: go on from what was asked.
        place = round(place[0] + du, 3), round(place[1] + dv, 3)
        self._nudged = name, place, now
        self.moved(name, place)

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
