"""Faults of what happens at the page (rows U).

They come from outside, as they would: from sockets of their own, over the port that is open to everybody.
"""

from __future__ import annotations

import math
import socket
import time
from contextlib import ExitStack
from typing import Any

from vita import commands as cmd
from vita.errors import BadInput
from vita.faults.attacks import HARMLESS, Outside, attack
from vita.faults.refusal import read, refused, text
from vita.faults.registry import injector
from vita.faults.site import Site
from vita.fuzz.client import CAMERA, CLICKED
from vita.fuzz.knock import frame
from vita.fuzz.malformed import MALFORMED, injections, pack

FLOOD_S, HOLD_S, BLOCK_S = 3.0, 3.0, 2.0
BLOCKED = 64
CROWD = 12
NO_DRIVER = "nobody drives; press something first"


@injector("U17")
def from_everywhere(site: Site) -> None:
    """Start twice more, then Stop three times, all at once."""
    engine = site.engine
    if not engine.moving:
        raise BadInput("press Start first; this is about an arm that moves")
    for command in (cmd.Start(), cmd.Start(), cmd.Halt(), cmd.Halt(), cmd.Halt()):
        engine.apply(command)


@injector("U18")
def old_click(site: Site) -> None:
    """A Start that was clicked before a Stop and is delivered after it."""
    engine = site.engine
    before = engine.revision
    engine.stop()
    refused("a Start from before a Stop", lambda: engine.apply(cmd.Start(), before))


@injector("U2")
def hanging_page(site: Site) -> None:
    """The page that drives is heard no more, though its line is not closed."""
    page = site.page
    driver = None if page is None else page.driver()
    if page is None or driver is None:
        raise BadInput(NO_DRIVER, "U2")
    page.hang(driver)


@injector("U6")
def flood(site: Site) -> None:
    """Clicks as fast as a socket takes them."""

    def act(outside: Outside) -> str:
        with outside.client() as page:
            uuid = page.widget(HARMLESS, *CLICKED).uuid
        pressed = _pressing(uuid)
        sent, end = 0, time.monotonic() + FLOOD_S
        with outside.knock() as answer:
            answer.socket.settimeout(0.1)
            answer.socket.sendall(frame(pack(CAMERA)))  # so that it counts as a page
            while time.monotonic() < end and not outside.over.is_set():
                try:
                    sent += answer.socket.send(pressed * 500) // len(pressed)
                except TimeoutError:
                    continue  # It is left waiting.
                except OSError:
                    break  # It is shown out.
        return f"{sent} clicks in {FLOOD_S:g} s were sent; what came too fast was dropped."

    attack(site, "U6", act)


@injector("U7")
def blocking(site: Site) -> None:
    """Work that blocks fills viser's pool of threads."""

    def act(outside: Outside) -> str:
        outside.page.block(outside.over.wait, BLOCK_S, BLOCKED)
        outside.over.wait(BLOCK_S)
        return f"{BLOCKED} callbacks blocked for {BLOCK_S:g} s. Stop never waits behind them."

    attack(site, "U7", act)


@injector("U8")
def malformed(site: Site) -> None:
    """Frames that no page sends, each on a connection of its own."""

    def act(outside: Outside) -> str:
        stop = outside.page.stop_button()
        closed = []
        for payload in (*MALFORMED.values(), *(injections(stop) if stop else {}).values()):
            with outside.client(camera=False) as page:
                page.send_raw(payload)
                page.wait(lambda page=page: not page.open, "the end", 3.0)
                closed.append(page.close_code)
        return f"{len(closed)} frames; each connection was closed ({sorted(set(closed))})."

    attack(site, "U8", act)


@injector("U9")
def forged(site: Site) -> None:
    """Values that no widget of the page has."""

    def act(outside: Outside) -> str:
        with outside.client() as page:
            tried = 0
            for widget in list(page.widgets.values()):
                for value in _wrong(widget.kind):
                    page.send_value(widget.uuid, value)
                    tried += 1
                    outside.over.wait(0.02)
            page.wait(lambda: page.notifications, "the refusal", 3.0)
            return f"{tried} values that no widget has. Refused, nothing was changed."

    attack(site, "U9", act)


@injector("U10")
def uploads(site: Site) -> None:
    """A file of 200 MB, a file in minus one parts, and more files at once than anybody has."""

    def act(outside: Outside) -> str:
        with outside.client() as page:
            button = next(w for w in page.widgets.values() if w.kind == "GuiUploadButtonMessage")
            for number, (parts, size) in enumerate([(400, 200_000_000), (-1, 10), *[(2, 10)] * 50]):
                page.send({
                    "type": "FileTransferStartUpload", "source_component_uuid": button.uuid,
                    "transfer_uuid": f"fault-{number}-{time.monotonic_ns()}", "mime_type": "text/plain",
                    "filename": "../../../.bashrc", "part_count": parts, "size_bytes": size,
                })  # fmt: skip
                outside.over.wait(0.02)
            page.wait(lambda: page.notifications, "the refusal", 3.0)
            return f"52 uploads. {page.notifications[0][1]}"

    attack(site, "U10", act)


@injector("U11")
def hostile_file(site: Site) -> None:
    """A hundred thousand brackets, which would exhaust a careless parser."""
    refused("open a file of 100,000 brackets", read(f"{text(site)}\nx = {'[' * 100_000}"))


@injector("U12")
def other_site(site: Site) -> None:
    """A page of another site, and a name that somebody made point here."""

    def act(outside: Outside) -> str:
        evil = "http://evil.example"
        with outside.knock(Origin=evil) as page, outside.knock(Origin="null") as nobody:
            with outside.knock(Host="evil.example", Origin=evil) as rebound:
                answers = (page.status, nobody.status, rebound.status)
        return f"another site's page, a page of no site, a name that points here: answered {answers}."

    attack(site, "U12", act)


@injector("U13")
def public_address(site: Site) -> None:
    """A page asks for an address that the whole world can open."""

    def act(outside: Outside) -> str:
        with outside.client() as page:
            page.send({"type": "ShareUrlRequest"})
            outside.over.wait(0.5)
            got = page.seen.get("ShareUrlUpdated", 0)
        return "there is a public address now!" if got else "no address was made."

    attack(site, "U13", act)


@injector("U14")
def same_port(site: Site) -> None:
    """A second vita on the same port."""
    if site.address is None:
        raise BadInput("this fault is tried on the page; start `vita serve`", "U14")
    from vita.ui.ports import check_free

    host, port = site.address
    refused(f"start a second vita on port {port}", lambda: check_free(host, port))


@injector("U15")
def deaf(site: Site) -> None:
    """A page that takes nothing of what it is sent."""

    def act(outside: Outside) -> str:
        started = time.monotonic()
        with outside.knock() as page:
            page.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            while outside.page.knows(page.socket.getsockname()) and time.monotonic() - started < 2 * HOLD_S:
                outside.over.wait(0.1)
        return f"a page that never reads was let go after {time.monotonic() - started:.1f} s."

    attack(site, "U15", act)


@injector("U16")
def our_own_error(site: Site) -> None:
    """A callback of the page raises."""

    def act(outside: Outside) -> str:
        told = outside.page.fail()
        return f"a callback of vita's failed on {told} pages. Each was told the number of its log entry."

    attack(site, "U16", act)


@injector("U20")
def crowd(site: Site) -> None:
    """A dozen more pages."""

    def act(outside: Outside) -> str:
        with ExitStack() as pages:
            answers = [pages.enter_context(outside.knock()).status for _ in range(CROWD)]
            outside.over.wait(HOLD_S / 3)
        return f"{CROWD} more pages: {answers.count(101)} came in, {answers.count(503)} found it full."

    attack(site, "U20", act)


def _pressing(uuid: str) -> bytes:
    return frame(pack({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": True}}))


def _wrong(kind: str) -> tuple[Any, ...]:
    """What a widget of a kind never holds."""
    return {
        "GuiSliderMessage": (1e9 - 1, math.nan, "x"), "GuiNumberMessage": (-1e9, math.inf),
        "GuiDropdownMessage": ("no such choice",), "GuiCheckboxMessage": ("yes",),
    }.get(kind, ())  # fmt: skip
