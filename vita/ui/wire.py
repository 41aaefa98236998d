"""What a page may say over its websocket: every message, every field, every range.

viser decodes whatever comes and hands it on. Here each message has a schema; one that does not fit is
refused before viser sees it, and one that fits is packed anew, so that viser reads exactly what was
checked (a map with a key twice, say, could mean one thing to us and another to viser).
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

BAD_DATA, BAD_MANNERS = 1007, 1008
"""Close codes of the websocket protocol: what is no message at all, and what no page would say."""
TEXT_MAX = 4096

Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
"""Finite: NaN and infinities fail the bounds."""
Word = Annotated[str, Meta(max_length=256)]
Text = Annotated[str, Meta(max_length=TEXT_MAX)]
Pixel = tuple[Number, Number]
Triple = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]
Value = bool | int | float | str | list[float]
"""What a widget can hold; whether this one may hold it is asked of the widget (`vita.ui.values`)."""


class Refused(Exception):
    """A frame that ends its connection: `code` and `reason` are told to the client and to the log."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code, self.reason = code, reason


class Message(Struct, tag_field="type", tag=True, forbid_unknown_fields=True, frozen=True):
    """Root of what pages say; the class's name is the message's type."""


class ViewerCameraMessage(Message, frozen=True):
    wxyz: Quaternion
    position: Triple
    fov: Number
    near: Number
    far: Number
    image_height: Number
    image_width: Number
    look_at: Triple
    up_direction: Triple


class ScenePointerMessage(Message, frozen=True):
    event_type: Literal["click", "rect-select"]
    ray_origin: Triple | None
    ray_direction: Triple | None
    screen_pos: Annotated[list[Pixel], Meta(max_length=4)]
    modifier: Word | None


class SceneNodeClickMessage(Message, frozen=True):
    name: Word
    instance_index: int | None
    ray_origin: Triple
    ray_direction: Triple
    screen_pos: Pixel
    modifier: Word | None
    owner: Word = ""


class SceneNodeDragMessage(Message, frozen=True):
    phase: Literal["start", "update", "end"]
    name: Word
    instance_index: int | None
    start_position: Triple
    start_screen_pos: Pixel
    end_position: Triple
    end_screen_pos: Pixel
    button: Literal["left", "middle", "right"]
    modifier: Word | None
    owner: Word = ""


class TransformControlsUpdateMessage(Message, frozen=True):
    name: Word
    wxyz: Quaternion
    position: Triple
    owner: Word = ""


class TransformControlsDragStartMessage(Message, frozen=True):
    name: Word
    owner: Word = ""


class TransformControlsDragEndMessage(Message, frozen=True):
    name: Word
    owner: Word = ""


class Updates(Struct, forbid_unknown_fields=True, frozen=True):
    """The one thing of a widget that a page may change. viser would let it take a button's callbacks away."""

    value: Value


class GuiUpdateMessage(Message, frozen=True):
    uuid: Word
    updates: Updates


class GuiButtonHoldMessage(Message, frozen=True):
    uuid: Word
    frequency: Number


class CommandTriggerMessage(Message, frozen=True):
    uuid: Word


class FileTransferStartUpload(Message, frozen=True):
    source_component_uuid: Word
    transfer_uuid: Word
    filename: Text
    mime_type: Word
    part_count: int
    size_bytes: int


class FileTransferPart(Message, frozen=True):
    source_component_uuid: Word | None
    transfer_uuid: Word
    part_index: int
    content: bytes


class LocalStorageGetItemResponseMessage(Message, frozen=True):
    value: Text | None
    error: Text | None
    request_uuid: Word


class ShareUrlRequest(Message, frozen=True):
    """Asks for a public address of this page. Known, and never granted."""


class ShareUrlDisconnect(Message, frozen=True):
    pass


class GuiFormSubmitMessage(Message, frozen=True):
    uuid: Word


class GuiFormDirtyMessage(Message, frozen=True):
    uuid: Word


class FileTransferPartAck(Message, frozen=True):
    source_component_uuid: Word | None
    transfer_uuid: Word
    transferred_bytes: int
    total_bytes: int


class GetRenderResponseMessage(Message, frozen=True):
    payload: bytes
    render_uuid: Word


IGNORED = (
    ShareUrlRequest, ShareUrlDisconnect, GuiFormSubmitMessage, GuiFormDirtyMessage, FileTransferPartAck,
    GetRenderResponseMessage,
)  # fmt: skip
"""What a stock page can say and ours has no use for: not an offence, and not handed on."""

Said = (
    ViewerCameraMessage | ScenePointerMessage | SceneNodeClickMessage | SceneNodeDragMessage
    | TransformControlsUpdateMessage | TransformControlsDragStartMessage | TransformControlsDragEndMessage
    | GuiUpdateMessage | GuiButtonHoldMessage | CommandTriggerMessage | FileTransferStartUpload
    | FileTransferPart | LocalStorageGetItemResponseMessage | ShareUrlRequest | ShareUrlDisconnect
    | GuiFormSubmitMessage | GuiFormDirtyMessage | FileTransferPartAck | GetRenderResponseMessage
)  # fmt: skip

_decoder = msgspec.msgpack.Decoder(Said)
_encoder = msgspec.msgpack.Encoder()


def read(raw: bytes | str) -> Said:
    """The message in a frame. Raises `Refused`, whatever the frame holds."""
    if isinstance(raw, str):
        raise Refused(BAD_DATA, "a text frame")
    try:
        return _decoder.decode(raw)
    except msgspec.ValidationError as problem:
        raise Refused(BAD_MANNERS, str(problem)[:100]) from None
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as problem:
        raise Refused(BAD_DATA, str(problem)[:100]) from None


def pack(message: Said) -> bytes:
    """The frame of a message."""
    return _encoder.encode(message)
