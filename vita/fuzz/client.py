"""The page without a browser: a small client of its websocket, for tests, injectors, fuzzers and the soak.

    with Client(("127.0.0.1", 8080)) as page:
        page.click("Start")
        page.set("Gain", 0.3)

It knows the page's widgets as the server describes them, answers what a browser answers by itself (its
storage), and says nothing else of its own.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec.msgpack
import zstandard
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect as open_socket
from websockets.typing import Subprotocol

from vita.errors import UnknownName, VitaError
from vita.fuzz.knock import subprotocol

CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (650.0, 480.0, -11500.0),
    "fov": 0.0873, "near": 100.0, "far": 1e5, "image_height": 720, "image_width": 1280,
    "look_at": (650.0, 480.0, 0.0), "up_direction": (0.0, -1.0, 0.0),
}  # fmt: skip
"""Until a page has said where it looks from, the server does not count it."""
CLICKED = ("GuiButtonMessage", "GuiUploadButtonMessage")
HOLLOW = ("GuiFolderMessage", "GuiFormMessage", "GuiPanelMessage", "GuiTabGroupMessage")
"""Have a label, but hold no value."""
KEPT_NOTIFICATIONS = 200
PART_BYTES = 256 * 1024


def connect(host: str, port: int) -> Client:
    """An honest page."""
    return Client((host, port))


class TurnedAway(VitaError):
    """The page did not let this client in."""

    def __init__(self, status: int) -> None:
        self.status = status
        super().__init__(f"the page answered {status}")


@dataclass
class Widget:
    """One widget of the page, as the server last described it."""

    uuid: str
    kind: str
    """Name of the message that made it, e.g. `GuiButtonMessage`."""
    value: Any = None
    props: dict[str, Any] = field(default_factory=dict)
    """label, options, min, max, disabled, visible, content, ..."""

    @property
    def label(self) -> str:
        return str(self.props.get("label") or "")


class Client:
    """Connects at once. Safe to use from several threads."""

    def __init__(
        self,
        address: tuple[str, int],
        *,
        origin: str | None = "",
        headers: Mapping[str, str] | None = None,
        camera: bool = True,
        storage: dict[str, str] | None = None,
        answers: bool = True,
        timeout_s: float = 5.0,
    ) -> None:
        """`origin` "" is that of an honest page, None sends none. Without `camera` the server has a socket,
        but no viewer. `storage` is what the browser keeps (pass the same again for a reload). Without
        `answers` it never tells what it keeps, as a page that hangs. Raises `TurnedAway` when it is not
        let in.
        """
        host, port = address
        place = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        self.widgets: dict[str, Widget] = {}
        self.commands: dict[str, str] = {}
        """uuid to label of the commands behind hotkeys and the palette."""
        self.notifications: deque[tuple[str, str]] = deque(maxlen=KEPT_NOTIFICATIONS)
        """(title, text), the newest last."""
        self.storage = {} if storage is None else storage
        self.seen: dict[str, int] = {}
        """How many messages of each type have come."""
        self.bytes_in = 0
        self.close_code: int | None = None
        """Why the server ended the connection; None while it lasts."""
        self._answers = answers
        self._news = threading.Condition()
        self._numbers = itertools.count()
        try:
            self._socket: ClientConnection = open_socket(
                f"ws://{place}/", subprotocols=[Subprotocol(subprotocol())], compression=None, max_size=None,
                origin=f"http://{place}" if origin == "" else origin,  # type: ignore[arg-type]
                additional_headers=dict(headers or {}), proxy=None, open_timeout=timeout_s, close_timeout=1.0,
                ping_interval=None,
            )  # fmt: skip
        except InvalidStatus as refusal:
            raise TurnedAway(refusal.response.status_code) from None
        self._reader = threading.Thread(target=self._read, name="vita-client", daemon=True)
        self._reader.start()
        if camera:
            self.send(CAMERA)
            self.wait(lambda: self._welcomed() or not self.open, "the page's widgets", timeout_s)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    @property
    def open(self) -> bool:
        return self.close_code is None

    def _welcomed(self) -> bool:
        """All widgets are here, and the server counts us: it asks each page for what its browser keeps."""
        return {"ReplayDoneMessage", "LocalStorageGetItemRequestMessage"} <= self.seen.keys()

    def close(self) -> None:
        """Leave as a closed page does. Idempotent."""
        self._socket.close()
        self._reader.join(timeout=2.0)

    # What a person does.

    def click(self, label: str) -> None:
        """Press a button."""
        self.send_value(self.widget(label, *CLICKED).uuid, True)

    def set(self, label: str, value: object) -> None:
        """Move a slider, choose an option, type a text."""
        self.send_value(self.widget(label).uuid, value)

    def command(self, label: str) -> None:
        """Press a hotkey, or choose from the palette."""
        found = [uuid for uuid, name in list(self.commands.items()) if name == label]
        if not found:
            raise UnknownName("command", label, sorted(self.commands.values()))
        self.send({"type": "CommandTriggerMessage", "uuid": found[0]})

    def upload(self, label: str, content: bytes, name: str = "task.toml") -> str:
        """Send a file through an upload button; the uuid of the transfer."""
        widget = self.widget(label, "GuiUploadButtonMessage")
        transfer = f"transfer-{next(self._numbers)}-{time.monotonic_ns()}"
        parts = [content[i : i + PART_BYTES] for i in range(0, len(content), PART_BYTES)]
        self.send({
            "type": "FileTransferStartUpload", "source_component_uuid": widget.uuid, "filename": name,
            "transfer_uuid": transfer, "mime_type": "text/plain", "part_count": len(parts),
            "size_bytes": len(content),
        })  # fmt: skip
        for index, part in enumerate(parts):
            self.send({
                "type": "FileTransferPart", "source_component_uuid": widget.uuid, "transfer_uuid": transfer,
                "part_index": index, "content": part,
            })  # fmt: skip
        return transfer

    # What is on the page.

    def widget(self, label: str, *kinds: str) -> Widget:
        """The visible widget of a label, or the first hidden one. Raises `UnknownName` with the choices."""
        inputs = [
            w for w in list(self.widgets.values())
            if w.label and (w.kind in kinds if kinds else w.kind not in HOLLOW)
        ]  # fmt: skip
        found = [w for w in inputs if w.label == label]
        if not found:
            raise UnknownName("widget", label, sorted({w.label for w in inputs}))
        return next((w for w in found if w.props.get("visible", True)), found[0])

    def has(self, label: str) -> bool:
        return any(w.label == label for w in list(self.widgets.values()))

    def text(self) -> str:
        """All that the page's HTML and markdown elements say now."""
        shown = [w for w in list(self.widgets.values()) if w.props.get("visible", True)]
        parts = (str(w.props.get(k, "")) for w in shown for k in ("content", "_markdown", "markdown"))
        return "\n".join(filter(None, parts))

    def told(self) -> str:
        """Every notification so far, a line each."""
        return "\n".join(f"{title}: {text}" for title, text in list(self.notifications))

    def wait(self, condition: Callable[[], Any], what: str, timeout_s: float = 5.0) -> Any:
        """Until `condition()` is true, looked at whenever something comes. Raises `TimeoutError`."""
        end = time.monotonic() + timeout_s
        with self._news:
            while True:
                value = condition()
                if value:
                    return value
                left = end - time.monotonic()
                if left <= 0:
                    raise TimeoutError(f"waited {timeout_s:g} s for {what}; told: {self.told()[-400:]}")
                self._news.wait(min(left, 0.05))

    # What goes over the line.

    def send_value(self, uuid: str, value: object) -> None:
        self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def send(self, message: Mapping[str, Any]) -> None:
        """One message, packed as the page packs it."""
        self.send_raw(msgspec.msgpack.encode(dict(message)))

    def send_raw(self, payload: bytes | str) -> None:
        """One frame of any content: bytes make a binary frame, str a text frame. Nothing once closed."""
        try:
            self._socket.send(payload)
        except ConnectionClosed:
            return

    # Reading.

    def _read(self) -> None:
        unzip = zstandard.ZstdDecompressor()
        try:
            while True:
                raw = self._socket.recv()
                if not isinstance(raw, bytes):
                    continue
                packed = int.from_bytes(raw[8:16], "little")
                size = int.from_bytes(raw[:8], "little")
                said = msgspec.msgpack.decode(
                    unzip.decompress(raw[16 : 16 + packed], max_output_size=max(size, 1)), strict=False
                )
                with self._news:
                    self.bytes_in += len(raw)
                    for message in said["messages"]:
                        self._take(message)
                    self._news.notify_all()
        except (ConnectionClosed, OSError) as end:
            received = getattr(end, "rcvd", None)
            with self._news:
                self.close_code = received.code if received is not None else 1006
                self._news.notify_all()

    def _take(self, message: dict[str, Any]) -> None:
        kind = message.get("type", "")
        self.seen[kind] = self.seen.get(kind, 0) + 1
        if kind == "GuiUpdateMessage":
            widget = self.widgets.get(message["uuid"])
            if widget is not None:
                updates = dict(message["updates"])
                if "value" in updates:
                    widget.value = updates.pop("value")
                widget.props.update(updates)
        elif kind == "GuiRemoveMessage":
            self.widgets.pop(message["uuid"], None)
        elif kind.startswith("Gui") and "props" in message and "uuid" in message:
            self.widgets[message["uuid"]] = Widget(
                message["uuid"], kind, message.get("value"), dict(message["props"])
            )
        elif kind == "RegisterCommandMessage":
            self.commands[message["uuid"]] = message["props"]["label"]
        elif kind == "RemoveCommandMessage":
            self.commands.pop(message["uuid"], None)
        elif kind == "NotificationShowMessage":
            props = message.get("props", message)
            self.notifications.append((str(props.get("title")), str(props.get("body"))))
        elif kind == "LocalStorageSetItemMessage":
            self.storage[message["key"]] = message["value"]
        elif kind == "LocalStorageRemoveItemMessage":
            self.storage.pop(message["key"], None)
        elif kind == "LocalStorageGetItemRequestMessage" and self._answers:
            self.send({
                "type": "LocalStorageGetItemResponseMessage", "request_uuid": message["request_uuid"],
                "value": self.storage.get(message["key"]), "error": None,
            })  # fmt: skip
