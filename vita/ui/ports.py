"""Whether the page can have its port. viser takes another one silently, or hangs, when it cannot."""

from __future__ import annotations

import errno
import socket

from vita.errors import BadInput


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
