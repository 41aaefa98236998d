"""What stands between viser's callbacks and vita: no browser is trusted, nothing is swallowed."""

from __future__ import annotations

import logging
import math
import secrets
from collections.abc import Callable
from typing import Any

from vita.errors import BadInput, VitaError

log = logging.getLogger("vita.ui")
Tell = Callable[[Any, str, str], None]


def guarded(tell: Tell) -> Callable[[Callable[[Any], None]], Callable[[Any], Any]]:
    """Decorator for page callbacks.

    They become `async def` without `await`, because viser runs those at once on its event loop, while
    plain ones queue behind others in a thread pool. Echoes of our own changes (`event.client` is
    None) are ignored. An exception becomes a message with an id and one log entry.
    """

    def decorate(function: Callable[[Any], None]) -> Callable[[Any], Any]:
        async def callback(event: Any) -> None:
            client = getattr(event, "client", None)
            if client is None:
                return
            try:
                function(event)
            except VitaError as refusal:
                tell(client, "warning", str(refusal))
            except Exception:
                ident = secrets.token_hex(2)
                log.exception("page callback failed, id %s", ident)
                text = f"Internal error {ident}: nothing was changed. The log has the details."
                tell(client, "error", text)

        return callback

    return decorate


def number(value: object, low: float, high: float, name: str) -> float:
    """`value` as a finite float within [low, high], or `BadInput`: viser checks nothing itself."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise BadInput(f"expected a number, got {str(value)[:40]!r}", name)
    if not math.isfinite(value) or not low <= value <= high:
        raise BadInput(f"{value} is outside {low:g} to {high:g}", name)
    return float(value)


def short_text(value: object, name: str, limit: int = 64) -> str:
    """`value` as a short single-line string, or `BadInput`."""
    if not isinstance(value, str):
        raise BadInput("expected text", name)
    text = value.strip()
    if not text or len(text) > limit or any(ord(ch) < 32 for ch in text):
        raise BadInput(f"use 1 to {limit} characters", name)
    return text
