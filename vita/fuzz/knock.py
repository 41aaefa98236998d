"""A bare HTTP request, with whatever headers one likes; enough of a websocket to be rude with.

Well-bred clients refuse to lie about Host and Origin, and read what they are sent. This one does neither.
"""

from __future__ import annotations

import base64
import os
import socket
import time
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version

TIMEOUT_S = 5.0
HEAD_BYTES = 65536


def subprotocol() -> str:
    """What the page calls its websocket; it carries viser's version."""
    return f"viser-v{version('viser')}"


@dataclass
class Answer:
    """What came back, and the open socket, which is the caller's to close."""

    status: int
    """HTTP status; 101 for a websocket, 0 if the door was shut without a word."""
    headers: Mapping[str, str]
    """Names in lower case."""
    rest: bytes
    """What came after the headers, as far as it was there at once."""
    socket: socket.socket

    def close(self) -> None:
        self.socket.close()

    def closing(self, timeout_s: float = TIMEOUT_S) -> int | None:
        """Read until the server ends the websocket; the code that it gives (1006 without one), or None when
        it goes on."""
        buffer, end = self.rest, time.monotonic() + timeout_s
        while True:
            while (size := _whole(buffer)) is not None:
                if buffer[0] & 0x0F == 8:
                    return int.from_bytes(buffer[2:4], "big") if size >= 4 else 1005
                buffer = buffer[size:]
            self.socket.settimeout(max(0.001, end - time.monotonic()))
            try:
                more = self.socket.recv(1 << 16)
            except TimeoutError:
                return None
            except ConnectionError:
                return 1006
            if not more:
                return 1006
            buffer += more

    def __enter__(self) -> Answer:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def knock(
    address: tuple[str, int],
    path: str = "/",
    headers: Mapping[str, str | None] | None = None,
    *,
    websocket: bool = False,
    timeout_s: float = TIMEOUT_S,
) -> Answer:
    """Send a GET request and read the head of the answer. A header of None is left out.

    Without own words Host and, for a websocket, Origin are those of an honest page.
    """
    host, port = address
    named = f"[{host}]" if ":" in host else host
    said: dict[str, str | None] = {"Host": f"{named}:{port}"}
    if websocket:
        said |= {
            "Origin": f"http://{named}:{port}", "Upgrade": "websocket", "Connection": "Upgrade",
            "Sec-WebSocket-Version": "13", "Sec-WebSocket-Protocol": subprotocol(),
            "Sec-WebSocket-Key": base64.b64encode(os.urandom(16)).decode(),
        }
    said |= dict(headers or {})
    lines = [f"GET {path} HTTP/1.1", *(f"{k}: {v}" for k, v in said.items() if v is not None), "", ""]
    line = socket.create_connection(address, timeout=timeout_s)
    try:
        line.sendall("\r\n".join(lines).encode("latin-1"))
        head = b""
        while b"\r\n\r\n" not in head and len(head) < HEAD_BYTES:
            more = line.recv(4096)
            if not more:
                break
            head += more
    except ConnectionError:
        return Answer(0, {}, b"", line)
    except BaseException:
        line.close()
        raise
    head, _, rest = head.partition(b"\r\n\r\n")
    first, *others = head.decode("latin-1").split("\r\n")
    words = first.split(" ")
    status = int(words[1]) if len(words) > 1 and words[1].isdigit() else 0
    pairs = (other.partition(":") for other in others)
    return Answer(status, {name.strip().lower(): value.strip() for name, _, value in pairs}, rest, line)


def _whole(buffer: bytes) -> int | None:
    """Bytes of the server's frame at the start of a buffer, or None when it has not all come."""
    if len(buffer) < 2:
        return None
    size, head = buffer[1] & 0x7F, 2
    if size > 125:
        head += 2 if size == 126 else 8
        if len(buffer) < head:
            return None
        size = int.from_bytes(buffer[2:head], "big")
    return head + size if len(buffer) >= head + size else None


def frame(payload: bytes, opcode: int = 2) -> bytes:
    """A whole client frame of the websocket protocol (RFC 6455); 2 is binary, 1 text, 9 ping, 8 close.

    The mask is zero, which leaves the payload as it is and is as good as any other.
    """
    size = len(payload)
    if size < 126:
        length = bytes([0x80 | size])
    elif size < 65536:
        length = bytes([0x80 | 126]) + size.to_bytes(2, "big")
    else:
        length = bytes([0x80 | 127]) + size.to_bytes(8, "big")
    return bytes([0x80 | opcode]) + length + bytes(4) + payload
