"""What every panel has at hand, and what it must do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import viser

from vita.snapshot import Snapshot
from vita.ui.compose import Composer


@dataclass
class Desk:
    """The page's shared things, handed to each panel."""

    gui: viser.GuiApi
    composer: Composer
    submit: Callable[[object], None]
    """Hand a command to the runner."""
    stop: Callable[[], None]
    """The runner's stop flag; never queues. Everybody's."""
    snapshot: Callable[[], Snapshot]
    guard: Callable[[Callable[[Any], None]], Callable[[Any], Any]]
    """Wraps a callback of the page that drives, see `vita.ui.safe.guarded` and `vita.ui.permits`."""
    tell: Callable[[Any, str, str], None]
    """(client, level, text): a message to one browser."""
    estop: Callable[[], None]
    """The runner's emergency stop; never queues. Everybody's."""
    anyone: Callable[[Callable[[Any], None]], Callable[[Any], Any]]
    """Wraps a callback that only looks or stops."""


class Panel(Protocol):
    """A part of the page that shows state and turns clicks into commands."""

    def update(self, snapshot: Snapshot) -> None:
        """Show `snapshot`. Called a few times a second and only while somebody looks."""
        ...


class Html:
    """An HTML element that is sent again only when its content changes."""

    def __init__(self, gui: viser.GuiApi, content: str = "", visible: bool = True) -> None:
        self._handle = gui.add_html(content, visible=visible)

    def show(self, content: str) -> None:
        if self._handle.content != content:
            self._handle.content = content

    def visible(self, shown: bool) -> None:
        if self._handle.visible != shown:
            self._handle.visible = shown
