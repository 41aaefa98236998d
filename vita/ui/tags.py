"""Where labels stand so that none covers another: plain geometry, tested without a browser.

Each label may stand at one of several places around its point. Labels are placed in order of
importance, each where it costs least. Leaving the place of the last picture costs something, so that
labels do not jump about while the arm moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

Box = tuple[float, float, float, float]
"""Left, top, right, bottom [image pixels]."""

PLACES: dict[str, tuple[tuple[float, float, str], ...]] = {
    # Offsets in screen pixels and the label's own corner that comes to stand there.
    "name": (
        (11, -8, "bottom-left"), (11, 8, "top-left"), (-11, 8, "top-right"), (-11, -8, "bottom-right"),
        (15, 0, "center-left"), (-15, 0, "center-right"), (0, -34, "bottom-center"), (0, 34, "top-center"),
        (24, 36, "top-left"), (-24, 36, "top-right"), (24, -36, "bottom-left"), (-24, -36, "bottom-right"),
    ),
    "goal": (
        (-14, 0, "center-right"), (-11, -9, "bottom-right"), (-11, 9, "top-right"), (14, 0, "center-left"),
        (11, 9, "top-left"), (11, -9, "bottom-left"), (0, 34, "top-center"), (0, -34, "bottom-center"),
        (24, 56, "top-left"), (-24, 56, "top-right"), (24, -56, "bottom-left"), (-24, -56, "bottom-right"),
    ),
    "value": (
        (0, 15, "top-center"), (0, -15, "bottom-center"), (15, 0, "center-left"), (-15, 0, "center-right"),
        (0, 33, "top-center"), (0, -33, "bottom-center"), (24, 18, "top-left"), (-24, 18, "top-right"),
        (24, -18, "bottom-left"), (-24, -18, "bottom-right"),
    ),
}
ORDER = ("value", "name", "goal")


@dataclass(frozen=True)
class Tag:
    """A label that belongs to a pixel of a view."""

    key: str
    """What it stands for, the same from picture to picture."""
    text: str
    uv: tuple[float, float]
    kind: str = "name"
    """`name`, `goal` or `value`: which places it may take, and how important it is."""


def box_of(at: tuple[float, float], anchor: str, width: float, height: float) -> Box:
    """The rectangle of a label whose `anchor` stands at `at`."""
    vertical, horizontal = anchor.split("-")
    left = at[0] - {"left": 0.0, "center": width / 2, "right": width}[horizontal]
    top = at[1] - {"top": 0.0, "center": height / 2, "bottom": height}[vertical]
    return left, top, left + width, top + height


def overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


MARK_PX = 9.0
"""Half the size of a marker, which labels should leave free [screen pixels]."""
COVERS_LABEL, LEAVES_IMAGE, COVERS_MARK, LATER, MOVES = 100.0, 10.0, 3.0, 0.2, 1.0
"""What a place costs, in order of importance; `LATER` counts per place in the list."""


class Placer:
    """Remembers where the labels of one view stood."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}

    def place(
        self, tags: Sequence[Tag], size: tuple[int, int], unit: float, character: float, height: float
    ) -> list[tuple[Tag, tuple[float, float], str]]:
        """(tag, place, anchor) per tag, in the order given: for each the cheapest place that is left.

        `unit` is image pixels per screen pixel, `character` and `height` are a label's measures in
        screen pixels.
        """
        taken: list[Box] = []
        reach = MARK_PX * unit
        marks = [
            (t.uv[0] - reach, t.uv[1] - reach, t.uv[0] + reach, t.uv[1] + reach)
            for t in tags if t.kind != "value"
        ]
        last, self._last = self._last, {}
        chosen: dict[str, tuple[tuple[float, float], str]] = {}
        for tag in sorted(tags, key=lambda tag: ORDER.index(tag.kind)):
            width = (character * len(tag.text) + 4.0) * unit
            best = None
            for index, (du, dv, anchor) in enumerate(PLACES[tag.kind]):
                at = tag.uv[0] + du * unit, tag.uv[1] + dv * unit
                box = box_of(at, anchor, width, height * unit)
                inside = box[0] >= 0 and box[1] >= 0 and box[2] <= size[0] and box[3] <= size[1]
                cost = (
                    COVERS_LABEL * sum(overlap(box, other) for other in taken)
                    + COVERS_MARK * sum(overlap(box, mark) for mark in marks)
                    + (0.0 if inside else LEAVES_IMAGE)
                    + LATER * index
                    + (MOVES if last.get(tag.key, index) != index else 0.0)
                )
                if best is None or cost < best[0]:
                    best = cost, index, at, anchor, box
            assert best is not None
            _, self._last[tag.key], at, anchor, box = best
            taken.append(box)
            chosen[tag.key] = at, anchor
        return [(tag, *chosen[tag.key]) for tag in tags]
