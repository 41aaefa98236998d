"""Row actions of HTML lists: hidden buttons that a <label for=...> in the row presses.

viser's HTML has no events of its own, but a browser forwards a click on a label to the button it
names. The buttons are made once per row number and reused for whatever the row shows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser

from vita.ui import style


class RowButtons:
    def __init__(
        self,
        gui: viser.GuiApi,
        guard: Callable[[Callable[[Any], None]], Callable[[Any], Any]],
        pick: Callable[[str], None],
        drop: Callable[[str], None],
    ) -> None:
        self._gui, self._guard, self._pick, self._drop = gui, guard, pick, drop
        self._folder = gui.add_folder(None)
        self._buttons: list[tuple[viser.GuiButtonHandle, viser.GuiButtonHandle]] = []
        self._names: list[str] = []

    def ids(self, index: int, name: str) -> tuple[str, str]:
        """HTML ids of the (select, delete) buttons of row `index`, which now stands for `name`."""
        while len(self._buttons) <= index:
            row = len(self._buttons)
            with self._folder:
                pair = self._gui.add_button("Select"), self._gui.add_button("Delete")
            pair[0].on_click(self._guard(lambda event, row=row: self._pick(self._names[row])))
            pair[1].on_click(self._guard(lambda event, row=row: self._drop(self._names[row])))
            self._buttons.append(pair)
            self._names.append(name)
        self._names[index] = name
        return tuple(button._impl.uuid for button in self._buttons[index])  # type: ignore

    def css(self) -> str:
        return style.hidden(button for pair in self._buttons for button in pair)
