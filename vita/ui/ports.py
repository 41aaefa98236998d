"""Where the page is served: its host and its port, what they are called, and whether it can have them.

viser takes another port silently, or hangs, when it cannot have the one that it was told.
"""

from __future__ import annotations

import errno
import ipaddress
import socket
from collections.abc import Iterable
from typing import Any

from vita.errors import BadInput

HERE = ("127.0.0.1", "localhost", "[::1]")
EVERYWHERE = ("0.0.0.0", "::", "")


def check_free(host: str, port: int) -> int:
    """The port to use (a free one for 0). Raises `BadInput` when it is taken or the host is not ours."""
    if not 0 <= port <= 65535:
        raise BadInput(f"port {port} is not between 0 and 65535", "--port")
    try:
        family, kind, proto, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
    except OSError:
        raise BadInput(f"host {host!r} is not known; use 127.0.0.1", "--host") from None
    with socket.socket(family, kind, proto) as probe:
        # As the server will: a port whose last connections are only lingering is free.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(address)
            return int(probe.getsockname()[1])
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise BadInput(f"port {port} is taken; choose another with --port") from None
            if error.errno == errno.EACCES:
                raise BadInput(f"port {port} needs more rights; choose one above 1023 with --port") from None
            raise BadInput(f"host {host!r} cannot be used here; use 127.0.0.1", "--host") from None


def check_reach(host: str, allow_remote: bool) -> None:
    """Raises `BadInput` for a host that others can reach, unless they are allowed to."""
    if not allow_remote and not is_here(host):
        raise BadInput(
            f"{host or 'every address'} can be reached from other machines; add --allow-remote to allow that",
            "--host",
        )


def is_here(host: str) -> bool:
    """Whether only this machine can reach a host."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def names_of(host: str, port: int) -> set[str]:
    """What browsers may call the page: the Host headers, with the port where they give one."""
    names: set[str] = set(HERE)
    if host in EVERYWHERE:
        names |= {socket.gethostname(), f"{socket.gethostname()}.local", local_address()}
        names |= {str(found[4][0]) for found in _addresses(socket.gethostname())}
    else:
        names.add(host)
    written = {f"[{name}]" if ":" in name and not name.startswith("[") else name for name in names}
    return {f"{name}:{port}" for name in written} | (written if port == 80 else set())


def sockets_for(host: str) -> list[str]:
    """The addresses to listen on: `localhost` is 127.0.0.1 to some browsers and ::1 to others."""
    if host not in ("127.0.0.1", "localhost"):
        return [host]
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_STREAM) as probe:
            probe.bind(("::1", 0))
        return ["127.0.0.1", "::1"]
    except OSError:
        return ["127.0.0.1"]


def local_address() -> str:
    """This machine's address towards others; nothing is sent to find it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return "127.0.0.1"


def _addresses(name: str) -> Iterable[Any]:
    try:
        return socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)
    except OSError:
        return ()
