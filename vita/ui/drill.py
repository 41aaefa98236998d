"""What faults that are injected for practice need of the page (`vita.faults.web`)."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

from vita.ui.entrance import Door
from vita.ui.safe import guarded


class Drill:
    """The page from within, for faults that cannot all be made from outside."""

    def __init__(self, door: Door) -> None:
        self.door = door
        self.own_address, self.badge = door.own_address, door.badge

    def driver(self) -> int | None:
        """viser's number of the page that drives."""
        return self.door.driver()

    def stop_button(self) -> str | None:
        """uuid of a button that stops the arm."""
        widgets = self.door.server.gui._gui_input_handle_from_uuid
        return next((uuid for uuid in self.door.urgent if uuid in widgets), None)

    def knows(self, peer: tuple[Any, ...]) -> bool:
        """Whether the connection of a socket, by that socket's own name, is still open."""
        return any(caller.remote_address[:2] == peer[:2] for caller in list(self.door.callers))

    def hang(self, client_id: int) -> None:
        """From now on nothing of a page is heard, as if it or its line hung."""
        connection: Any = self.door.server._websock_server._live_connections.get(client_id)
        if connection is not None:
            connection.loop.call_soon_threadsafe(connection.hang)

    def drop(self, client_id: int) -> None:
        """Cut the line of a page, which comes back by itself."""
        connection: Any = self.door.server._websock_server._live_connections.get(client_id)
        if connection is not None:
            connection.loop.call_soon_threadsafe(connection.transport.abort)

    def block(self, wait: Any, seconds: float, times: int) -> None:
        """Fill viser's pool of threads with work that blocks."""
        for _ in range(times):
            self.door.server._thread_executor.submit(wait, seconds)

    def tell_all(self, text: str) -> None:
        for client in list(self.door.server.get_clients().values()):
            if self.door.tell is not None:
                self.door.tell(client, "info", text)

    def fail(self) -> int:
        """Have a callback raise on every page; how many."""

        def broken(event: Any) -> None:
            raise RuntimeError("an injected error of our own")

        assert self.door.tell is not None
        clients, callback = list(self.door.server.get_clients().values()), guarded(self.door.tell)(broken)
        for client in clients:
            event = SimpleNamespace(client=client, client_id=client.client_id)
            asyncio.run_coroutine_threadsafe(callback(event), self.door.server._event_loop).result(2.0)
        return len(clients)
