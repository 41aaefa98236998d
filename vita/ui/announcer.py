"""Messages to browsers: what the engine says, and what a callback has to say to one person."""

from __future__ import annotations

import time
from typing import Any

import viser

from vita.snapshot import Snapshot

NOTICES_PER_SECOND = 3
TITLES = {"info": "vita", "warning": "Please note", "error": "Error"}
COLORS = {"info": "blue", "warning": "orange", "error": "red"}
AGAIN_S = 3.0
"""The same message is not shown to a browser again within this time [s]: a drag that is refused is
refused thirty times a second."""


class Announcer:
    def __init__(self, server: viser.ViserServer, known: Snapshot) -> None:
        """Notices that `known` holds already are old news."""
        self._server = server
        self._told = max((n.id for n in known.notices), default=0)
        self._recent: list[float] = []
        self._last: dict[int, tuple[str, float]] = {}
        """Client id to the last message, and when it was shown."""

    def tell(self, client: Any, level: str, text: str) -> None:
        """A message to one browser; errors stay until they are closed."""
        now, ident = time.monotonic(), getattr(client, "client_id", -1)
        said, at = self._last.get(ident, ("", 0.0))
        if said == text and now - at < AGAIN_S:
            return
        self._last = {k: v for k, v in self._last.items() if now - v[1] < AGAIN_S} | {ident: (text, now)}
        client.add_notification(
            TITLES.get(level, "vita"), text[:400],
            auto_close_seconds=None if level == "error" else 8.0, color=COLORS.get(level, "gray"),
        )

    def update(self, snapshot: Snapshot) -> None:
        """New notices to everybody; a flood is cut, since all of them can be read in the panel."""
        now = time.monotonic()
        for notice in snapshot.notices:
            if notice.id <= self._told:
                continue
            self._told = notice.id
            if notice.instead is not None:
                continue  # The prompt gives the reason and the picture shows the better place: see there.
            self._recent = [t for t in self._recent if now - t < 1.0]
            if len(self._recent) >= NOTICES_PER_SECOND:
                continue
            self._recent.append(now)
            for client in self._server.get_clients().values():
                self.tell(client, notice.level, notice.text)
