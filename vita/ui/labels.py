"""A pool of labels of one parent node: shown, moved and hidden, never removed while it lives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import viser

Shown = tuple[str, tuple[float, float, float], str]
"""Text, position in the parent's frame, anchor."""


class LabelPool:
    def __init__(self, scene: viser.SceneApi, root: str, size: float) -> None:
        self._scene, self._root, self._size = scene, root, size
        self._labels: list[viser.LabelHandle] = []
        self._state: list[Shown | None] = []

    def show(self, wanted: Sequence[Shown]) -> None:
        """Show exactly `wanted`."""
        while len(self._labels) < len(wanted):
            text, position, anchor = wanted[len(self._labels)]
            self._labels.append(
                self._scene.add_label(
                    f"{self._root}/{len(self._labels)}", text, position=position,
                    anchor=anchor, font_screen_scale=self._size,  # type: ignore
                )
            )
            self._state.append((text, position, anchor))
        for index, label in enumerate(self._labels):
            new = wanted[index] if index < len(wanted) else None
            old = self._state[index]
            if new == old:
                continue
            self._state[index] = new
            if new is None:
                label.visible = False
                continue
            self._assign(label, new, old)

    def _assign(self, label: Any, new: Shown, old: Shown | None) -> None:
        if old is None:
            label.visible = True
        if old is None or old[0] != new[0]:
            label.text = new[0]
        if old is None or old[1] != new[1]:
            label.position = new[1]
        if old is None or old[2] != new[2]:
            label.anchor = new[2]

    def clear(self) -> None:
        """Forget the labels; their nodes go with their parent."""
        self._labels, self._state = [], []
