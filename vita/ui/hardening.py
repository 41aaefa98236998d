"""A viser server that is safe to leave standing next to an arm: `open_page`.

- It opens on this machine only, unless remote pages are allowed, and then only to those with the token.
- Who may come in is said in `vita.ui.entrance`, what they may say and how fast in `vita.ui.connection`.

viser is taken hold of at one place, where it makes its server with `websockets.asyncio.server.serve`. The
version of viser is pinned, and `vita.ui.selfcheck` attacks the running page to see that all of it holds.
"""

from __future__ import annotations

import asyncio
import io
import logging
import re
import secrets
import threading
import time
from contextlib import redirect_stdout
from typing import Any

import viser
import websockets.asyncio.server as websocket_server
from viser import _messages
from websockets.http11 import Request, Response

from vita.errors import BadInput, MissingDependency
from vita.ui.connection import Connection
from vita.ui.entrance import Door, log
from vita.ui.ports import check_free, check_reach, is_here, sockets_for
from vita.ui.throttle import Seldom

FRAME_BYTES = 8 * 2**20
HANDSHAKE_S, CLOSE_S = 3.0, 1.0
TOKEN_MIN = 16

UNWANTED = (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect)
REAL: Any = websocket_server.serve
_opening = threading.Lock()


class Quiet(logging.Filter):
    """One line for what goes wrong on a connection: who is outside must not fill the log with tracebacks."""

    def __init__(self, door: Door) -> None:
        super().__init__()
        self._door, self._seldom = door, Seldom()

    def filter(self, record: logging.LogRecord) -> bool:
        if record.msg == "opening handshake failed":
            return False  # Browsers open connections that they do not use, and close them without a word.
        more = self._seldom(str(record.msg), time.monotonic())
        if more is None or self._door.rehearsal:
            return False
        problem = record.exc_info[1] if record.exc_info else None
        text = record.getMessage() + (f": {type(problem).__name__}" if problem else "") + more
        record.msg, record.args, record.exc_info, record.exc_text = text, (), None, None
        return True


class Server:
    """What viser gets for its call of `serve`: a server of `Connection`s behind the door.

    viser would try the next port for ever where one is taken, or hang. So this one opens some port then
    and keeps the reason; `open_page` closes it and gives the reason.
    """

    def __init__(self, door: Door) -> None:
        self.door = door
        self.problem: OSError | None = None
        self.asked = False
        """Whether viser has made its server here."""
        self._seldom = Seldom()
        self._inner: Any = None

    def __call__(self, handler: Any, *args: Any, **more: Any) -> Any:
        """In place of `websockets.asyncio.server.serve`."""
        if getattr(handler, "__module__", "") != "viser.infra._infra":
            return REAL(handler, *args, **more)
        self.asked = True
        door, inner = self.door, more["process_request"]
        logger = logging.Logger("vita.web.socket", logging.WARNING)
        logger.parent = log
        logger.addFilter(Quiet(door))

        def answer(caller: Any, request: Request) -> Response | None:
            return door.answer(caller, request, inner)

        self._handler = handler
        self._more = more | {
            "process_request": answer, "create_connection": lambda *a, **k: Connection(door, *a, **k),
            "max_size": FRAME_BYTES, "open_timeout": HANDSHAKE_S, "close_timeout": CLOSE_S,
            "logger": logger, "server_header": None,
        }  # fmt: skip
        return self

    async def __aenter__(self) -> Any:
        asyncio.get_running_loop().set_exception_handler(self._failed)
        try:
            return await self._bind(sockets_for(self.door.host), self.door.port)
        except OSError as problem:
            self.problem = problem
            return await self._bind(["127.0.0.1"], 0)

    async def __aexit__(self, *exc: Any) -> Any:
        return await self._inner.__aexit__(*exc)

    async def _bind(self, hosts: list[str], port: int) -> Any:
        self._inner = REAL(self._handler, hosts, port, **self._more)
        return await self._inner.__aenter__()

    def _failed(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Something of viser's or ours raised on the event loop, where nobody awaits it."""
        if self._seldom("loop", time.monotonic()) is not None:
            text, ident = context.get("message"), secrets.token_hex(2)
            log.error("the page's server failed, id %s: %s", ident, text, exc_info=context.get("exception"))


def open_page(
    host: str = "127.0.0.1", port: int = 8080, *, allow_remote: bool = False, token: str | None = None
) -> tuple[viser.ViserServer, Door]:
    """A viser server behind a door. Port 0 picks a free one.

    Raises `BadInput` for a port that is taken, a host that is not ours, and one that others can reach
    without `allow_remote`. With `allow_remote` there is always a token; without, only if one is given.
    """
    host = host.strip("[]")
    check_reach(host, allow_remote)
    check_token(token)
    if token is None and not is_here(host):
        token = secrets.token_urlsafe(24)
    door = Door(host, check_free(host, port), token)
    serve = Server(door)
    with _opening:
        websocket_server.serve = serve  # type: ignore[assignment]
        try:
            with redirect_stdout(io.StringIO()):  # viser prints a banner, `verbose` or not
                server = viser.ViserServer(host=host, port=door.port, verbose=False, label=" ")
        finally:
            websocket_server.serve = REAL  # type: ignore[assignment]
    if serve.problem is not None or not serve.asked:
        with redirect_stdout(io.StringIO()):
            server.stop()
        if not serve.asked:
            raise MissingDependency(f"viser {viser.__version__} cannot be made safe here; install 1.1.1")
        raise BadInput(f"port {door.port} is taken; choose another with --port")
    for message in UNWANTED:
        # Any connected page could otherwise open a public tunnel to the arm. Connections ignore it too.
        server._websock_server.unregister_handler(message)
    door.server = server
    return server, door


def check_token(token: str | None) -> None:
    """Raises `BadInput` for a token that could be guessed, or that no cookie can hold."""
    if token is not None and not re.fullmatch(rf"[A-Za-z0-9_-]{{{TOKEN_MIN},128}}", token):
        raise BadInput(f"use {TOKEN_MIN} to 128 letters, digits, - and _", "--token")
