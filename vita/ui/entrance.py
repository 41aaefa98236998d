"""The door of the page: who may come in, and what a page is told that may not.

viser trusts everybody who can reach its port. Here Host and Origin have to be the page's own, so that no
other site's script reaches the arm through somebody's browser; where other machines can reach the page
they need a token as well; and there are never more than `PAGES_MAX` pages.
"""

from __future__ import annotations

import hmac
import http
import logging
import time
from collections.abc import Callable, Iterable
from http.cookies import CookieError, SimpleCookie
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlencode, urlsplit

import viser
from viser import _messages
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from vita.ui.ports import EVERYWHERE, local_address, names_of
from vita.ui.throttle import Seldom

if TYPE_CHECKING:
    from vita.ui.connection import Connection

log = logging.getLogger("vita.web")

PAGES_MAX = 8
CALLERS_MAX = 64
"""Connections of any kind, such as those that never say what they want."""
POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "worker-src 'self' blob: data:; connect-src 'self' data: blob:{line}; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""viser's page is one file with its script inside, which unpacks more of itself. Nothing from elsewhere."""
ALWAYS = {
    "X-Content-Type-Options": "nosniff", "X-Frame-Options": "DENY", "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}  # fmt: skip


class Door:
    """Who may come in to one page. Made by `open_page`."""

    server: viser.ViserServer
    """Set once it stands; until then nobody comes in."""

    def __init__(self, host: str, port: int, token: str | None) -> None:
        self.host, self.port, self.token = host, port, token
        self.urgent: set[str] = set()
        """uuids of the widgets and commands that stop the arm."""
        self.tell: Callable[[Any, str, str], None] | None = None
        """(client, level, text): how a page is told something; set by the app."""
        self.driver: Callable[[], int | None] = lambda: None
        """viser's number of the page that drives; set by the app."""
        self.forbids: Callable[[int | None], str] = lambda client_id: ""
        """Why a page may not turn a widget's value, which all pages share; empty where it may. Set by the
        app."""
        self.pages: set[Connection] = set()
        self.rehearsal = False
        """Whether vita is attacking itself; then the log keeps still."""
        self.callers: set[Connection] = set()
        """Every connection, also those that are not pages yet."""
        self._seldom = Seldom()
        self._hosts = frozenset(name.lower() for name in names_of(host, port))
        self._cookie = f"vita_{port}"

    @property
    def place(self) -> str:
        """host:port as a person can open it."""
        host = local_address() if self.host in EVERYWHERE else self.host
        return f"[{host}]:{self.port}" if ":" in host else f"{host}:{self.port}"

    @property
    def address(self) -> str:
        """What to open in a browser, with the token where one is needed."""
        return f"http://{self.place}" + (f"/?token={self.token}" if self.token else "")

    @property
    def own_address(self) -> tuple[str, int]:
        """Host and port at which this machine itself reaches the page."""
        return ("127.0.0.1" if self.host in (*EVERYWHERE, "localhost") else self.host), self.port

    @property
    def badge(self) -> dict[str, str]:
        """The headers by which programs of this process are let in like a page that has the token."""
        return {} if self.token is None else {"Cookie": f"{self._cookie}={self.token}"}

    def always(self, *handles: Any) -> None:
        """What stops the arm: it passes any flood."""
        self.urgent.update(handle._impl.uuid for handle in handles)

    def silent_s(self, client_id: int) -> float | None:
        """Since when a page has said nothing of its own; None for one that is not there. A page that hangs
        may still answer pings, which a browser does by itself."""
        connection: Any = self.server._websock_server._live_connections.get(client_id)
        return None if connection is None else time.monotonic() - connection.heard

    # What connections need.

    def arrived(self, caller: Connection) -> None:
        if len(self.callers) >= CALLERS_MAX:
            caller.transport.abort()
        self.callers.add(caller)

    def left(self, caller: Connection) -> None:
        self.callers.discard(caller)
        self.pages.discard(caller)

    def say(self, kind: str, text: str) -> None:
        """A line in the log; seldom, whatever comes in."""
        if self.rehearsal:
            return
        more = self._seldom(kind, time.monotonic())
        if more is not None:
            log.warning("%s%s", text, more)

    def client(self, client_id: int | None) -> viser.ClientHandle | None:
        return None if client_id is None else self.server._connected_clients.get(client_id)

    def tell_one(self, client_id: int | None, text: str) -> None:
        client = self.client(client_id)
        if client is not None and self.tell is not None:
            self.tell(client, "warning", text)

    def put_back(self, client_id: int | None, handle: Any) -> None:
        """Have one page show what a widget really holds."""
        client = self.client(client_id)
        if client is not None:
            client._websock_connection.queue_message(
                _messages.GuiUpdateMessage(handle._impl.uuid, {"value": handle._impl.value})
            )

    # Who may come in.

    def answer(self, caller: Connection, request: Request, inner: Callable[..., Any]) -> Response | None:
        """Our answer to a request, or viser's, `inner`; None lets a page's websocket in."""
        response = self.refusal(request)
        if response is None:
            response = inner(caller, request)
            if response is None:
                response = self.refusal_of_page(request)
        if response is None:
            self.pages.add(caller)
            return None
        for name, value in ALWAYS.items():
            response.headers[name] = value
        response.headers["Content-Security-Policy"] = POLICY.format(line=self._line(request))
        return response

    def refusal(self, request: Request) -> Response | None:
        """Why a request is not answered, or where it is sent; None to let it go on."""
        if not hasattr(self, "server"):
            return self._no(http.HTTPStatus.SERVICE_UNAVAILABLE, "the page is not ready yet")
        hosts = request.headers.get_all("Host")
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return self._no(http.HTTPStatus.MISDIRECTED_REQUEST, "this page has another address")
        if self.token is not None:
            query = parse_qsl(urlsplit(request.path).query, keep_blank_values=True)
            given = [value for name, value in query if name == "token"]
            if given:
                if len(given) != 1 or not same(given[0], self.token):
                    return self._no(http.HTTPStatus.FORBIDDEN, "the token is wrong")
                return self._welcome([pair for pair in query if pair[0] != "token"])
            if not any(same(cookie, self.token) for cookie in self._cookies(request)):
                return self._no(http.HTTPStatus.FORBIDDEN, "open the printed address, with its token")
        origins = request.headers.get_all("Origin")
        if origins and origins != [f"http://{hosts[0]}"]:
            return self._no(http.HTTPStatus.FORBIDDEN, "another site's page may not use this one")
        return None

    def refusal_of_page(self, request: Request) -> Response | None:
        """The same for what wants to be a websocket."""
        if not request.headers.get_all("Origin"):
            return self._no(http.HTTPStatus.FORBIDDEN, "only this page may use this")
        spoken = ",".join(request.headers.get_all("Sec-WebSocket-Protocol")).replace(" ", "").split(",")
        if f"viser-v{viser.__version__}" not in spoken:
            return self._no(http.HTTPStatus.BAD_REQUEST, "the page is of another version: reload it")
        if len(self.pages) >= PAGES_MAX:
            full = f"the server is full: {PAGES_MAX} pages are open"
            return self._no(http.HTTPStatus.SERVICE_UNAVAILABLE, full)
        return None

    def _line(self, request: Request) -> str:
        """The websocket for the policy, spelt out: to some browsers 'self' is only what is fetched by HTTP.
        The others manage alone with an address in brackets, which a policy cannot name."""
        host = (request.headers.get_all("Host") or [""])[0].lower()
        return f" ws://{host}" if host in self._hosts and not host.startswith("[") else ""

    def _cookies(self, request: Request) -> Iterable[str]:
        for line in request.headers.get_all("Cookie"):
            try:
                found = SimpleCookie(line).get(self._cookie)
            except CookieError:
                continue
            if found is not None:
                yield found.value

    def _welcome(self, rest: list[tuple[str, str]]) -> Response:
        """The token goes into a cookie and out of the address, so that it is not seen or sent on."""
        where = "/" + (f"?{urlencode(rest)}" if rest else "")
        headers = Headers({
            "Location": where, "Content-Length": "0",
            "Set-Cookie": f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Lax",
        })  # fmt: skip
        return Response(http.HTTPStatus.SEE_OTHER, "See Other", headers, b"")

    def _no(self, status: http.HTTPStatus, why: str) -> Response:
        self.say(f"refused {status}", f"refused a request: {why}")
        body = f"vita: {why}\n".encode()
        headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
        return Response(status, status.phrase, headers, body)


def same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())
