"""The pages that are open: they are counted, told apart, and shown who of them drives.

Everything in the panels is shared by all pages, except for what is made here: a slim line for each page,
and a few rules that make the controls look out of reach where another page drives. They are looks only;
the check is in `Commands.submit`.
"""

from __future__ import annotations

import secrets
import string
import threading
from dataclasses import dataclass
from typing import Any

import viser

from vita.snapshot import Snapshot
from vita.types import MOVING_STATES
from vita.ui import style
from vita.ui.announcer import Announcer
from vita.ui.compose import Composer
from vita.ui.panels.base import Html
from vita.ui.permits import Commands, as_the_page
from vita.ui.safe import guarded, log

TOKEN_KEY = "vita-driver"
TOKEN_TIMEOUT_S = 10.0
WELCOME = "Welcome back: you still drive. The arm was held when the page went away; press Start to go on."
FREE = "Nobody drives: whoever does something first does."


@dataclass
class _Line:
    """What one page shows of who drives."""

    html: Html
    take: viser.GuiButtonHandle


class Visitors:
    def __init__(
        self, server: viser.ViserServer, commands: Commands, announcer: Announcer, composer: Composer
    ) -> None:
        self._server, self._commands, self._lease = server, commands, commands.lease
        self._announcer, self._composer = announcer, composer
        self._guard = commands.anyone(guarded(announcer.tell))
        self._place: viser.GuiFolderHandle | None = None
        self._always: tuple[viser.GuiButtonHandle, ...] = ()
        self._lines: dict[int, _Line] = {}
        self._lock = threading.Lock()
        self._held = False
        """Whether the arm was stopped because its driver left."""
        server.on_client_connect(self._opened)
        server.on_client_connect(self._know)
        server.on_client_disconnect(self._left)

    def settle(self, place: viser.GuiFolderHandle, always: tuple[viser.GuiButtonHandle, ...]) -> None:
        """Where the line stands, and the buttons that are everybody's."""
        self._place, self._always = place, always

    def update(self, snapshot: Snapshot) -> None:
        """Show who drives. Called a few times a second, by one thread only."""
        clients = self._server.get_clients()
        for gone in [client for client in self._lines if client not in clients]:
            self._lines.pop(gone)
        for client, handle in clients.items():
            if client not in self._lines:
                self._lines[client] = self._make(handle)
            try:
                self._lines[client].html.show(self._words(client, snapshot))
            except RuntimeError:
                log.debug("page %s left while its line was written", client)

    # Coming and going.

    async def _opened(self, client: viser.ClientHandle) -> None:
        self._lease.opened(client.client_id)

    def _know(self, client: viser.ClientHandle) -> None:
        """Ask the browser for its token, or give it one. In a thread of viser's pool, since it waits."""
        try:
            token = client.local_storage.get_item(TOKEN_KEY, timeout=TOKEN_TIMEOUT_S)
            if token is None or len(token) != 32 or set(token) - set(string.hexdigits):
                token = secrets.token_hex(16)
                client.local_storage.set_item(TOKEN_KEY, token)
        except (RuntimeError, TimeoutError):
            return  # It left, or keeps nothing: then a reload makes it a new page.
        if self._lease.showed(client.client_id, token):
            with self._lock:
                held, self._held = self._held, False
            if held:
                self._announcer.tell(client, "info", WELCOME)

    async def _left(self, client: viser.ClientHandle) -> None:
        """On viser's event loop, so that it waits behind nothing."""
        number, drove = self._lease.number(client.client_id), self._lease.drives(client.client_id)
        stopped = self._commands.left(client.client_id)
        if not drove:
            return
        with self._lock:
            self._held = stopped
        if stopped:
            text = f"Page {number} drove and is gone, so the arm was stopped. You may drive now."
            for other in self._server.get_clients().values():
                self._announcer.tell(other, "warning", text)

    def _take_over(self, event: Any) -> None:
        self._commands.take_over(event.client_id)
        with as_the_page():
            self._composer.put_away()
        self._composer.selected = None

    # Showing.

    def _make(self, client: viser.ClientHandle) -> _Line:
        assert self._place is not None
        with self._place:
            line = _Line(Html(client.gui), client.gui.add_button("Take over"))
        line.take.on_click(self._guard(self._take_over))
        return line

    def _words(self, client: int, snapshot: Snapshot) -> str:
        """The line of one page as HTML; all but empty for a person alone."""
        take = self._lines[client].take
        rules = style.hidden((take,))
        lease, driver, away = self._lease, self._lease.driver, self._lease.away
        others = len(lease.pages) - 1
        words, link = "", False
        if driver == client:
            words = f"You drive · {others} watching" if others > 0 else ""
        elif driver is not None:
            words, link = f"Page {lease.number(driver)} drives", True
        elif away is not None:
            words, link = f"Page {away[0]} drove and is away", True
        elif others > 0:
            words = FREE
        if link:
            rules += style.out_of_reach(self._always)
            moving = snapshot.status.state in MOVING_STATES
            hint = "Stop the arm first" if moving else "Drive from this page"
            words += (
                f'<span class="grow"></span><label class="take{" off" if moving else ""}" '
                f'for="{take._impl.uuid}" title="{hint}">Take over</label>'
            )
        shown = f'<div class="vita who" id="vita-who">{words}</div>' if words else ""
        return style.sheet(rules) + shown
