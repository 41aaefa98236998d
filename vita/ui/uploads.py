"""What one connection is sending us as files: little at a time, and nothing that outlives it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import viser
from msgspec.structs import replace
from viser import _messages

from vita.errors import BadInput
from vita.ui.wire import FileTransferPart, FileTransferStartUpload

MAX_BYTES = 1_000_000
"""Of all that one connection has under way."""
MAX_TRANSFERS = 2
MAX_PARTS = 64
TOO_BIG = "the file is too big: at most 1 MB"


@dataclass
class Transfer:
    parts: int
    size: int
    got: set[int] = field(default_factory=set)
    bytes: int = 0


class Uploads:
    """The uploads of one connection. viser keeps the parts; we keep the books, and may have it forget."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self._under_way: dict[str, Transfer] = {}
        self._done: list[str] = []

    def start(self, message: FileTransferStartUpload) -> FileTransferStartUpload:
        """The message for viser, without the name and type that the page claims. Raises `BadInput`."""
        handle = self._gui._gui_input_handle_from_uuid.get(message.source_component_uuid)
        ident = message.transfer_uuid
        if not isinstance(handle, viser.GuiUploadButtonHandle) or handle.disabled:
            raise BadInput("nothing is expected here", "upload")
        if ident in self._gui._current_file_upload_states:
            raise BadInput("this transfer has begun already", "upload")
        if len(self._under_way) >= MAX_TRANSFERS:
            raise BadInput(f"at most {MAX_TRANSFERS} files at once", "upload")
        if sum(t.size for t in self._under_way.values()) + message.size_bytes > MAX_BYTES:
            raise BadInput(TOO_BIG, "upload")
        parts, size = message.part_count, message.size_bytes
        if size < 0 or not 0 <= parts <= MAX_PARTS or (parts == 0) != (size == 0):
            raise BadInput(f"{parts} parts of {size} bytes make no file", "upload")
        self._forget_receipts()
        if parts:
            self._under_way[ident] = Transfer(parts, size)
        else:
            self._done.append(ident)
        return replace(message, filename="upload", mime_type="")

    def part(self, message: FileTransferPart) -> FileTransferPart | None:
        """The message for viser; None for a part of nothing that is under way. Raises `BadInput`."""
        ident = message.transfer_uuid
        transfer = self._under_way.get(ident)
        if transfer is None:
            return None
        if not 0 <= message.part_index < transfer.parts or message.part_index in transfer.got:
            self._drop(ident)
            raise BadInput(f"part {message.part_index} does not belong to this file", "upload")
        transfer.got.add(message.part_index)
        transfer.bytes += len(message.content)
        whole = len(transfer.got) == transfer.parts
        if transfer.bytes > transfer.size or (whole and transfer.bytes < transfer.size):
            self._drop(ident)
            raise BadInput(
                TOO_BIG if transfer.bytes > transfer.size else "the file came incomplete", "upload"
            )
        if whole:
            del self._under_way[ident]
            self._done.append(ident)
        return message

    def close(self) -> None:
        """The connection is gone. viser drops uploads only of those that it counts as viewers."""
        for ident in list(self._under_way):
            self._drop(ident)
        self._forget_receipts()

    def _drop(self, ident: str) -> None:
        self._under_way.pop(ident, None)
        self._gui._current_file_upload_states.pop(ident, None)
        self._done.append(ident)

    def _forget_receipts(self) -> None:
        """viser keeps each receipt of a part for ever, to show it to whoever comes later."""
        done = set(self._done)
        if done:
            buffer: Any = self._gui._websock_interface.get_message_buffer()
            buffer.remove_from_buffer(
                lambda m: isinstance(m, _messages.FileTransferPartAck) and m.transfer_uuid in done
            )
            self._done.clear()
