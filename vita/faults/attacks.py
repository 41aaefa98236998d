"""How faults of the page are tried on the page that runs: from outside, for seconds."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from vita.errors import BadInput
from vita.faults.site import Site
from vita.fuzz.client import Client
from vita.fuzz.knock import Answer, knock

log = logging.getLogger("vita.faults")

HARMLESS = "Fit the views"
"""A button that everybody may press and that moves nothing but the pressing page's own view."""


class Outside:
    """The page as programs outside find it. They know its token, so that not that alone keeps them out."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.over = threading.Event()
        """The fault is mended."""

    def client(self, **more: Any) -> Client:
        return Client(self.page.own_address, headers=self.page.badge, **more)

    def knock(self, websocket: bool = True, **headers: str | None) -> Answer:
        return knock(self.page.own_address, headers=self.page.badge | headers, websocket=websocket)


Attack = Callable[[Outside], str]
"""Tries something, and says what came of it."""


def attack(site: Site, row: str, act: Attack) -> None:
    """Try `act` and tell every page what came of it. Mend ends it."""
    if site.page is None:
        raise BadInput("this fault is tried on the page; start `vita serve`", row)
    outside = Outside(site.page)
    site.tap.undo[row] = outside.over.set

    def run() -> None:
        try:
            told = act(outside)
        except Exception as problem:  # Whatever came of it is what people want to know.
            log.warning("trying %s ended early: %s", row, problem)
            told = f"it ended early: {problem}"
        finally:
            site.tap.undo.pop(row, None)
        outside.page.tell_all(f"Tried {row}: {told}")

    if site.later is None:
        run()
    else:
        site.later(run)
