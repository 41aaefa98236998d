"""One page's connection: what it says is read here, checked, slowed down and only then handed to viser.

viser takes its messages from `recv()` of the connection and nowhere else, so a connection of our own
kind is all that is needed to stand between.
"""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Any

import viser
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from vita.errors import BadInput
from vita.ui import wire
from vita.ui.throttle import READ_BURST, READ_RATE, Bucket, Kind, Seldom, Valve
from vita.ui.uploads import Uploads
from vita.ui.values import accept

if TYPE_CHECKING:
    from vita.ui.entrance import Door

PING_S, PONG_S = 1.0, 1.2
"""How often a page is asked whether it lives, and how long it may take to answer."""
DEAF_TURNS = 3
"""So many times `PONG_S` may pass when it still talks, or still takes what is sent, but does not answer."""
CHUNK_BYTES = 8192
"""Read at once. Every frame in a chunk is parsed before anybody else has a turn, so chunks are small."""


class Connection(ServerConnection):
    def __init__(self, door: Door, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        self.door = door
        self.heard = time.monotonic()
        """When the page last said something of its own."""
        self._pace = Bucket(READ_RATE, READ_BURST)
        self._valve: Valve[wire.Said] = Valve()
        self._uploads: Uploads | None = None
        self._scolded = Seldom()

    # Coming and going.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.transport.max_size = CHUNK_BYTES  # type: ignore[attr-defined]
        self.door.arrived(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self.door.left(self)
        if self._uploads is not None:
            self._uploads.close()
        super().connection_lost(exc)

    @property
    def client_id(self) -> int | None:
        """viser's number of this connection."""
        live = self.door.server._websock_server._live_connections
        return next((ident for ident, connection in list(live.items()) if connection is self), None)

    # Reading.

    async def recv(self, decode: bool | None = None) -> Any:
        """The next message that viser may see."""
        while True:
            now = time.monotonic()
            due = self._valve.due(now)
            if due is not None:
                return wire.pack(due)
            wait = self._valve.wait_s(now)
            if self._valve.full:
                await asyncio.sleep(wait or 0.0)
                continue
            if not self._pace.take(now):
                # Whoever talks this fast is left waiting, so that the others are not.
                await asyncio.sleep(max(0.005, self._pace.wait_s(now)))
                continue
            try:
                async with asyncio.timeout(wait):
                    raw = await super().recv()
            except TimeoutError:
                continue
            self.heard = time.monotonic()
            try:
                message = self._admit(raw)
            except wire.Refused as refusal:
                self.door.say("frame", f"closed a connection: {refusal.reason}")
                await self.close(refusal.code, refusal.reason)
                continue  # The next read tells viser that it is closed.
            if message is not None:
                return wire.pack(message)

    def _admit(self, raw: bytes | str) -> wire.Said | None:
        """What may pass of a frame now. Raises `Refused`."""
        message = wire.read(raw)
        if isinstance(message, (wire.ShareUrlRequest, wire.ShareUrlDisconnect)):
            self.door.say("share", "a page asked for a public address of this one: ignored")
            return None
        if isinstance(message, wire.IGNORED):
            return None
        try:
            checked = self._checked(message)
        except BadInput as problem:
            self._refuse(message, str(problem))
            return None
        if checked is None:
            return None
        key, kind = self._kind(checked)
        return self._valve.offer(key, checked, kind, time.monotonic())

    def _checked(self, message: wire.Said) -> wire.Said | None:
        """The message as it may go on; None for one about nothing that is there. Raises `BadInput`."""
        if isinstance(message, (wire.GuiUpdateMessage, wire.GuiButtonHoldMessage)):
            handle = self._widget(message.uuid)
            if handle is None:
                return None
            accept(handle, message.updates.value if isinstance(message, wire.GuiUpdateMessage) else True)
            pressed = isinstance(handle, (viser.GuiButtonHandle, viser.GuiButtonGroupHandle))
            why = "" if pressed else self.door.forbids(self.client_id)
            if why:
                raise BadInput(why)
        elif isinstance(message, wire.CommandTriggerMessage):
            if message.uuid not in self.door.server.gui._command_handle_from_uuid:
                return None
        elif isinstance(message, (wire.FileTransferStartUpload, wire.FileTransferPart)):
            if self._uploads is None:
                self._uploads = Uploads(self.door.server.gui)
            if isinstance(message, wire.FileTransferPart):
                return self._uploads.part(message)
            return self._uploads.start(message)
        return message

    def _widget(self, uuid: str) -> Any:
        """The widget of the page, or of this page alone; None where there is none."""
        found = self.door.server.gui._gui_input_handle_from_uuid.get(uuid)
        if found is None:
            client = self.door.client(self.client_id)
            if client is not None:
                found = client.gui._gui_input_handle_from_uuid.get(uuid)
        return None if found is None or found._impl.removed else found

    def _kind(self, message: wire.Said) -> tuple[object, Kind]:
        """What else would replace this message in a flood, and how it is treated there."""
        kind = type(message).__name__
        if isinstance(message, (wire.GuiUpdateMessage, wire.CommandTriggerMessage)):
            if message.uuid in self.door.urgent:
                return message.uuid, "stop"
            if isinstance(message, wire.CommandTriggerMessage):
                return message.uuid, "click"
            pressed = (viser.GuiButtonHandle, viser.GuiButtonGroupHandle)
            return message.uuid, "click" if isinstance(self._widget(message.uuid), pressed) else "value"
        if isinstance(message, (wire.SceneNodeClickMessage, wire.GuiButtonHoldMessage)):
            return kind, "click"
        if isinstance(message, wire.SceneNodeDragMessage):
            return (kind, message.name, message.owner, message.phase), "value"
        if isinstance(message, wire.FileTransferPart):
            return (kind, message.transfer_uuid, message.part_index), "value"
        if isinstance(message, wire.FileTransferStartUpload):
            return (kind, message.transfer_uuid), "value"
        if isinstance(message, wire.LocalStorageGetItemResponseMessage):
            return (kind, message.request_uuid), "value"
        return (kind, getattr(message, "name", ""), getattr(message, "owner", "")), "value"

    def _refuse(self, message: wire.Said, text: str) -> None:
        """Tell the page, and put its widget back to what holds."""
        more = self._scolded("refusal", time.monotonic())
        if more is not None:
            self.door.say("value", f"refused from a page: {text}")
            self.door.tell_one(self.client_id, text + more)
        if isinstance(message, wire.GuiUpdateMessage):
            handle = self._widget(message.uuid)
            if handle is not None and not handle._impl.is_button:
                self.door.put_back(self.client_id, handle)

    # Whether it is still there.

    def hang(self) -> None:
        """Read no more: for the page's people it is as if their machine had hung."""
        self.data_received = lambda data: None  # type: ignore[method-assign]

    async def keepalive(self) -> None:
        """Ask once a second. A page that does not answer is let go at once, without farewells."""
        try:
            while True:
                await asyncio.sleep(PING_S)
                trip = self.loop.create_task(self._round_trip())
                try:
                    if not await self._answered(trip):
                        self.door.say("mute", "a page does not answer any more: let go")
                        self.transport.abort()
                        return
                finally:
                    trip.cancel()
        except ConnectionClosed:
            return

    async def _round_trip(self) -> None:
        await (await self.ping())

    async def _answered(self, trip: asyncio.Task[None]) -> bool:
        """Whether the answer comes in time; a slow line that still moves is given more."""
        for _ in range(DEAF_TURNS):
            heard, left = self.heard, self.transport.get_write_buffer_size()
            await asyncio.wait([trip], timeout=PONG_S)
            if not trip.done():
                await asyncio.sleep(0.05)  # After a stall of ours the answer may be here, but not yet read.
            if trip.done():
                await trip
                return True
            if self.heard == heard and self.transport.get_write_buffer_size() >= left:
                return False
        return False
