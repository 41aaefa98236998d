"""What a hostile page says: frames from noise to almost right. The seed fixes every one of them."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from vita.fuzz.client import CAMERA, CLICKED, Widget
from vita.fuzz.malformed import MALFORMED, injections, pack

TYPES = (
    "ViewerCameraMessage", "ScenePointerMessage", "SceneNodeClickMessage", "SceneNodeDragMessage",
    "TransformControlsUpdateMessage", "GuiUpdateMessage", "GuiButtonHoldMessage", "CommandTriggerMessage",
    "FileTransferStartUpload", "FileTransferPart", "LocalStorageGetItemResponseMessage", "ShareUrlRequest",
    "ShareUrlDisconnect", "GuiFormSubmitMessage", "GuiFormDirtyMessage", "GetRenderResponseMessage",
    "RunJavascriptMessage", "GuiCloseModalMessage", "RemoveSceneNodeMessage", "ResetGuiMessage", "__init__",
    "",
)  # fmt: skip
FIELDS = (
    "uuid", "updates", "name", "owner", "value", "wxyz", "position", "phase", "screen_pos", "ray_origin",
    "transfer_uuid", "part_index", "part_count", "size_bytes", "content", "request_uuid", "modifier", "type",
)  # fmt: skip
ATOMS: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, -(2**63), 2**64 - 1, 0.0, -0.0, 1e308, math.nan, math.inf, -math.inf,
    "", "x", "/view/left", "../../x", "\x00", "\ud7ff", "x" * 5000, b"", b"\xff" * 100, "server",
)  # fmt: skip
DEPTH = 4


class Rude:
    def __init__(self, rng: random.Random, widgets: Sequence[Widget], stops: Sequence[str]) -> None:
        """`widgets` are those of the page; `stops` the uuids of what anybody may press to stop the arm, which
        would rightly change something."""
        self._rng, self._stops = rng, set(stops)
        self._widgets = [w for w in widgets if w.kind.startswith("Gui")]
        kinds = ("Slider", "Number", "Text", "Check", "Dropdown")
        self._inputs = [w for w in self._widgets if any(kind in w.kind for kind in kinds)]
        self._makers: tuple[Callable[[], bytes | str], ...] = (
            self._noise, self._known, self._damaged, self._random, self._random, self._injected, self._value,
            self._value, self._click, self._upload, self._nested,
        )  # fmt: skip

    def frame(self) -> tuple[str, bytes | str]:
        """What kind of frame, and the frame: bytes for a binary one, str for text."""
        maker = self._rng.choice(self._makers)
        return maker.__name__.strip("_"), maker()

    def _noise(self) -> bytes | str:
        noise = self._rng.randbytes(self._rng.choice((0, 1, 7, 60, 3000)))
        return noise.decode("latin-1") if self._rng.random() < 0.2 else noise

    def _known(self) -> bytes | str:
        return MALFORMED[self._rng.choice(sorted(MALFORMED))]

    def _damaged(self) -> bytes:
        """A right message with a few bytes changed, left out or put in."""
        data = bytearray(pack(self._right()))
        for _ in range(self._rng.randint(1, 4)):
            at = self._rng.randrange(len(data)) if data else 0
            action = self._rng.random()
            if action < 0.5 and data:
                data[at] ^= 1 << self._rng.randrange(8)
            elif action < 0.75:
                del data[at:]
            else:
                data[at:at] = self._rng.randbytes(2)
        return bytes(data)

    def _random(self) -> bytes:
        """A message of a known type with any fields."""
        fields = {self._rng.choice(FIELDS): self._anything() for _ in range(self._rng.randint(0, 5))}
        return pack({"type": self._rng.choice(TYPES), **fields})

    def _injected(self) -> bytes:
        choices = injections(self._uuid(self._widgets))
        return choices[self._rng.choice(sorted(choices))]

    def _value(self) -> bytes:
        uuid, value = self._uuid(self._inputs), self._anything(depth=2)
        return pack({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def _click(self) -> bytes:
        """A click on any button but those that are everybody's."""
        uuid = self._uuid([w for w in self._widgets if w.kind in CLICKED and w.uuid not in self._stops])
        value = True if self._rng.random() < 0.8 else self._anything(depth=1)
        return pack({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def _upload(self) -> bytes:
        ident = f"t{self._rng.randrange(3)}"
        source = self._uuid([w for w in self._widgets if w.kind == "GuiUploadButtonMessage"])
        if self._rng.random() < 0.5:
            parts = self._rng.choice((-1, 0, 1, 2, 64, 10**9))
            size = self._rng.choice((-1, 0, 10, 10**6, 10**15))
            return pack({
                "type": "FileTransferStartUpload", "source_component_uuid": source, "transfer_uuid": ident,
                "filename": "../../x", "mime_type": "", "part_count": parts, "size_bytes": size,
            })  # fmt: skip
        return pack({
            "type": "FileTransferPart", "source_component_uuid": source, "transfer_uuid": ident,
            "part_index": self._rng.choice((-1, 0, 1, 63, 2**40)),
            "content": bytes(self._rng.choice((0, 5, 10, 100_000))),
        })  # fmt: skip

    def _nested(self) -> bytes:
        key = self._rng.choice((b"\x81\xa4type", b"\x81\xa4name", b""))
        return key + self._rng.choice((b"\x91", b"\x81\xa1a")) * self._rng.choice((10, 1000, 50_000))

    def _right(self) -> Mapping[str, Any]:
        return self._rng.choice((
            CAMERA,
            {"type": "GuiUpdateMessage", "uuid": self._uuid(self._inputs), "updates": {"value": 0.5}},
            {"type": "CommandTriggerMessage", "uuid": self._uuid(self._inputs)},
            {"type": "LocalStorageGetItemResponseMessage", "request_uuid": "x", "value": "y", "error": None},
        ))  # fmt: skip

    def _uuid(self, widgets: Sequence[Widget]) -> str:
        return self._rng.choice(widgets).uuid if widgets and self._rng.random() < 0.9 else "no-such-widget"

    def _anything(self, depth: int = DEPTH) -> Any:
        kind = self._rng.random()
        if depth == 0 or kind < 0.6:
            return self._rng.choice(ATOMS)
        if kind < 0.8:
            return [self._anything(depth - 1) for _ in range(self._rng.randint(0, 4))]
        return {self._rng.choice(FIELDS): self._anything(depth - 1) for _ in range(self._rng.randint(0, 3))}
