"""The page attacks itself before anybody is told its address.

What keeps strangers out rests on how viser works inside. A new version of it, or of websockets, could undo
that without a sound; so each protection is tried on the real port, and if one fails vita does not serve.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

import viser

from vita.errors import VitaError
from vita.fuzz.knock import Answer, frame, knock
from vita.fuzz.malformed import pack
from vita.ui.entrance import PAGES_MAX, Door

REACTION_S = 5.0
"""How long a slow machine may take to end a connection; it is a few milliseconds."""
SETTLED_S = 0.02
"""How long an attack that has been read, and ought to do nothing, is given to do something."""
END = b"\xc1"
"""Ends its connection; what was sent before has then been read."""
EVIL = "evil.example"
PATHS = (
    "/../../../../etc/passwd", "/..%2f..%2f..%2fetc%2fpasswd", "/%2e%2e/%2e%2e/setup.py", "/..\\..\\x",
    "//etc/passwd",
)  # fmt: skip


class Unprotected(VitaError):
    """An attack on our own page succeeded."""

    exit_code = 3

    def __init__(self, attack: str) -> None:
        self.attack = attack
        super().__init__(
            f"the page is not safe on this machine, so it is not served: {attack}. "
            f"Install the versions that vita names (viser {viser.__version__} is here)."
        )


@dataclass
class Target:
    """The page as an attacker finds it."""

    door: Door

    def knock(self, path: str = "/", /, websocket: bool = False, **headers: str | None) -> Answer:
        """With what an honest page would show, so that it is not only the token that keeps the attack out."""
        return knock(self.door.own_address, path, self.door.badge | headers, websocket=websocket)

    def say(self, *frames: bytes | str | dict[str, Any]) -> int | None:
        """Say something as a page; the code with which the connection was ended, None if it was not."""
        with self.knock(websocket=True) as line:
            for said in frames:
                packed = pack(said) if isinstance(said, dict) else said
                text = isinstance(packed, str)
                line.socket.sendall(frame(packed.encode() if text else packed, 1 if text else 2))
            return line.closing(REACTION_S)

    def stop(self) -> Any:
        """The Stop button, or None without one."""
        widgets = self.door.server.gui._gui_input_handle_from_uuid
        return next((widgets[uuid] for uuid in self.door.urgent if uuid in widgets), None)


Attack = Callable[[Target], bool]
"""True when the attack succeeded."""


def _let_in(target: Target, **headers: str | None) -> bool:
    with target.knock(websocket=True, **headers) as answer:
        return answer.status != 403


def foreign_host(target: Target) -> bool:
    host = f"{EVIL}:{target.door.port}"
    origin = f"http://{host}"
    with target.knock(Host=host) as plain, target.knock(websocket=True, Host=host, Origin=origin) as page:
        return (plain.status, page.status) != (421, 421)


def no_token(target: Target) -> bool:
    if target.door.token is None:
        return False
    wrong = "x" * len(target.door.token)
    with ExitStack() as tries:
        answers = [
            tries.enter_context(target.knock(Cookie=None)),
            tries.enter_context(target.knock(websocket=True, Cookie=None)),
            tries.enter_context(target.knock(websocket=True, Cookie=f"vita_{target.door.port}={wrong}")),
            tries.enter_context(target.knock(f"/?token={wrong}", Cookie=None)),
        ]
        return any(answer.status != 403 for answer in answers)


def outside_files(target: Target) -> bool:
    for path in PATHS:
        with target.knock(path) as answer:
            if answer.status not in (400, 404):
                return True
    return False


def share(target: Target) -> bool:
    """The tunnel itself is replaced, so that an attack that succeeds does no harm."""
    asked: list[bool] = []
    server: Any = target.door.server
    server.request_share_url = lambda *args, **more: asked.append(True)
    try:
        target.say({"type": "ShareUrlRequest"}, {"type": "ShareUrlDisconnect"}, END)
        time.sleep(SETTLED_S)
    finally:
        del server.request_share_url
    return bool(asked)


def dead_stop(target: Target) -> bool:
    """Take the Stop button's callbacks away."""
    stop = target.stop()
    if stop is None or not stop._impl.update_cb:
        return True
    before = (list(stop._impl.update_cb), stop._impl.sync_cb)
    for updates in ({"update_cb": []}, {"removed": True}, {"value": True, "sync_cb": None}):
        said = {"type": "GuiUpdateMessage", "uuid": stop._impl.uuid, "updates": updates}
        if target.say(said) != 1008:
            return True
    return stop._impl.removed or (list(stop._impl.update_cb), stop._impl.sync_cb) != before


def garbage(target: Target) -> bool:
    frames = (("text", 1007), (END, 1007), (b"\x81\xa4type\xa4Nope", 1008))
    return any(target.say(said) != code for said, code in frames)


def forged_value(target: Target) -> bool:
    """Set a slider beyond its end."""
    widgets = list(target.door.server.gui._gui_input_handle_from_uuid.values())
    slider = next((w for w in widgets if isinstance(w, viser.GuiSliderHandle) and not w.disabled), None)
    if slider is None:
        return False
    before = slider._impl.value
    beyond = {"value": float(slider.max) + 99.0}
    target.say({"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": beyond}, END)
    time.sleep(SETTLED_S)
    return slider._impl.value != before


def ninth_page(target: Target) -> bool:
    """Pages that are open already count, so it may be fewer than nine here."""
    with ExitStack() as pages:
        for _ in range(PAGES_MAX + 1):
            if pages.enter_context(target.knock(websocket=True)).status == 503:
                return False
    return True


ATTACKS: dict[str, Attack] = {
    "a page of another site came in": lambda t: _let_in(t, Origin=f"http://{EVIL}"),
    "a page without a site came in": lambda t: _let_in(t, Origin="null"),
    "a program without an Origin came in": lambda t: _let_in(t, Origin=None),
    "a foreign Host was answered": foreign_host,
    "somebody came in without the token": no_token,
    "a file outside the page was read": outside_files,
    "a malformed frame was swallowed": garbage,
    "a page could ask for a public address": share,
    "a page could disable the Stop button": dead_stop,
    "a value that no slider has was taken": forged_value,
    "more pages came in than allowed": ninth_page,
}


def check(door: Door) -> float:
    """Try every attack; how long it took [s]. Raises `Unprotected` for the first that succeeds."""
    started = time.monotonic()
    target = Target(door)
    with _rehearsal(door):
        for name, attack in ATTACKS.items():
            try:
                succeeded = attack(target)
            except (OSError, VitaError, TimeoutError) as problem:
                raise Unprotected(f"whether {name} could not be found out: {problem}") from problem
            if succeeded:
                raise Unprotected(name)
        end = time.monotonic() + REACTION_S
        while door.pages and time.monotonic() < end:
            time.sleep(0.005)
    return time.monotonic() - started


@contextmanager
def _rehearsal(door: Door) -> Iterator[None]:
    """The log need not tell of our own attacks."""
    door.rehearsal = True
    try:
        yield
    finally:
        door.rehearsal = False
