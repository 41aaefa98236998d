"""A dropdown for a setting that names one of the registered kinds, with the chosen one's own words below."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import Field
from typing import Any

from vita import commands as c
from vita.errors import UnknownName
from vita.ui.panels.base import Desk, Html
from vita.ui.words import safe


class Choice:
    """People read titles; commands and files speak of kinds."""

    def __init__(self, desk: Desk, field: Field[Any]) -> None:
        self._desk, self._field = desk, field.name
        self._kinds: Mapping[str, Any] = dict(field.metadata["choices"]())
        self._by_title = {kind.title: name for name, kind in self._kinds.items()}
        self.value = str(field.default)
        self.handle = desk.gui.add_dropdown(
            field.metadata["label"], tuple(self._by_title),
            initial_value=self._kinds[self.value].title, hint=field.metadata["doc"],
        )
        self._about = Html(desk.gui, self._words())
        self.handle.on_update(desk.guard(self._chosen))

    def show(self, kind: str) -> None:
        """Follow the setting in force."""
        if kind not in self._kinds:
            return
        title = self._kinds[kind].title
        if self.handle.value != title:
            self.handle.value = title
        if kind != self.value:
            self.value = kind
            self._about.show(self._words())

    def _words(self) -> str:
        return f'<div class="vita about">{safe(self._kinds[self.value].doc)}</div>'

    def _chosen(self, event: Any) -> None:
        title = event.target.value
        if not isinstance(title, str) or title not in self._by_title:
            raise UnknownName(self._field, str(title)[:40], self._by_title)
        self._desk.submit(c.SetServo(self._field, self._by_title[title]))
