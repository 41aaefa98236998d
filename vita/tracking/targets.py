"""What `--at` says: `[NAME=]u,v[,w,h]`, and `[NAME=]u,v,u2,v2` for a line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vita.errors import BadInput, Untrackable
from vita.types import Image
from vita.vision import Tracker, make_tracker

LINE_KINDS = ("line",)
"""Kinds whose four numbers are two ends."""


@dataclass(frozen=True)
class Target:
    """One place to follow."""

    name: str
    uv: tuple[float, float]
    """Pixel (column, row) in the first frame."""
    size_px: float | None = None
    """Side of the square region; None lets the tracker choose [px]."""
    to: tuple[float, float] | None = None
    """A line's other end [px]."""

    @property
    def where(self) -> str:
        """For messages."""
        to = f" to ({self.to[0]:g}, {self.to[1]:g})" if self.to else ""
        return f"{self.name} at ({self.uv[0]:g}, {self.uv[1]:g}){to}"

    def start(self, kind: str, frame: Image) -> Tracker:
        """A tracker on this place of the first frame; its errors name the target."""
        try:
            return make_tracker(kind, frame, self.uv, to=self.to, size_px=self.size_px)
        except Untrackable as error:
            raise Untrackable(str(error), self.where, error.suggestion) from None
        except BadInput as error:
            raise BadInput(str(error), self.where) from None


def read_targets(texts: Sequence[str], kind: str) -> list[Target]:
    """The targets of all `--at`; those without a name are called T1, T2, ... by their place."""
    targets = [_read(text, f"T{number}", kind) for number, text in enumerate(texts, 1)]
    names = [target.name for target in targets]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"two trackers are called {name!r}; their rows could not be told apart", "--at")
    return targets


def _read(text: str, default: str, kind: str) -> Target:
    before, equals, after = text.rpartition("=")
    name = before.strip() if equals else default
    if not name or not name.isprintable():
        raise BadInput("a tracker needs a name before the '='", f"--at {text!r}")
    try:
        numbers = [float(part) for part in after.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 4) or not all(math.isfinite(n) for n in numbers):
        raise BadInput(f"expected {_form(kind)}", f"--at {text!r}")
    u, v, *rest = numbers
    if kind in LINE_KINDS:
        if not rest:
            raise BadInput("a line needs both its ends: u,v,u2,v2", f"--at {text!r}")
        return Target(name, (u, v), to=(rest[0], rest[1]))
    if not rest:
        return Target(name, (u, v))
    if min(rest) <= 0:
        raise BadInput(f"the width and height of the region must be above 0; {_form(kind)}", f"--at {text!r}")
    # The trackers hold on to squares. The mean side is the fairest to what was drawn: the longer one
    # would take in background, the shorter one would throw texture away.
    return Target(name, (u, v), size_px=(rest[0] + rest[1]) / 2)


def _form(kind: str) -> str:
    if kind in LINE_KINDS:
        return "u,v,u2,v2 (a line's two ends in pixels), such as 120,80,300,95"
    return "u,v or u,v,w,h (a pixel, and the region's size around it), such as 312,208.5 or 312,208,60,60"
