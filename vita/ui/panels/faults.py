"""The fault page: every row of the catalogue, to be tried on the simulation while the arm moves.

The buttons call the injectors that the tests use. Rows without one say how they are proven instead.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import viser

from vita import commands as c
from vita.errors import BadInput, UnknownName
from vita.faults import CATALOGUE, Row, injectors
from vita.snapshot import Snapshot
from vita.ui import style
from vita.ui.fault_words import GROUPS, VERDICTS, expected, group_of, proven
from vita.ui.panels.base import Desk, Html
from vita.ui.panels.rows import RowButtons
from vita.ui.words import hexed, safe

ABOUT = "Try them while the arm moves. The tests use the same faults."


class FaultsPanel:
    def __init__(self, desk: Desk, status: Callable[[], str] = str) -> None:
        """`status` gives further HTML for the end of the page."""
        self._desk, self._status = desk, status
        self._trying = frozenset(injectors())
        self._open: str | None = None
        gui = desk.gui
        Html(gui, style.TABS_MARK)
        self._sheet = Html(gui)
        Html(gui, f'<div class="vita"><span class="dim">{ABOUT}</span></div>')
        self._group: Any = gui.add_dropdown("Group", tuple(GROUPS.values()), hint="Kinds of faults")
        self._group.on_update(desk.guard(self._chosen))
        self._shown = next(iter(GROUPS.values()))
        self._mend = gui.add_button(
            "Mend all", icon=viser.Icon.BANDAGE, hint="Take back every fault that is in force.", disabled=True
        )
        self._mend.on_click(desk.guard(lambda event: desk.submit(c.Mend())))
        self._list = Html(gui)
        self._rows = RowButtons(gui, desk.guard, self._unfold, self._try)
        self._foot = Html(gui)

    def update(self, snapshot: Snapshot) -> None:
        shown = [row for row in CATALOGUE.values() if group_of(row.id) == self._shown]
        if self._group.value != self._shown:
            self._group.value = self._shown
        in_force = frozenset(snapshot.injected)
        if self._mend.disabled == bool(in_force):
            self._mend.disabled = not in_force
        html = "".join(self._row(index, row, row.id in in_force) for index, row in enumerate(shown))
        elsewhere = [CATALOGUE[i].title for i in snapshot.injected if group_of(i) != self._shown]
        also = f'<div class="warn">Also in force: {safe(", ".join(elsewhere))}.</div>' if elsewhere else ""
        self._list.show(f'<div class="vita" id="vita-faults">{also}<div class="list">{html}</div></div>')
        self._foot.show(self._status())
        self._sheet.show(
            style.sheet(
                self._rows.css(), style.plain((self._mend,)), style.beside(self._group, self._mend, 0.66)
            )
        )

    def _row(self, index: int, row: Row, in_force: bool) -> str:
        pick, trial = self._rows.ids(index, row.id)
        word, color = VERDICTS[row.verdict]
        if in_force:
            act = '<span class="chip small" style="background:#dc2626">in force</span>'
        elif row.id in self._trying:
            act = f'<label class="link" for="{trial}" title="Make it happen now">Try</label>'
        else:
            act = f'<span class="dim small" title="{safe(proven(row))}">tested</span>'
        opened = row.id == self._open
        more = ""
        if opened:
            how = "" if row.id in self._trying else f"<br>{safe(proven(row))}"
            more = f'<div class="more">{safe(expected(row))}{how}</div>'
        return (
            f'<div class="item{" on" if opened else ""}"><span class="num dim id">{row.id}</span>'
            f'<label class="grow" for="{pick}" title="{safe(expected(row))}">{safe(row.title)}</label>'
            f'<span class="small" style="color:{hexed(color)}">{word}</span>{act}</div>{more}'
        )

    def _chosen(self, event: Any) -> None:
        if event.target.value not in GROUPS.values():
            raise UnknownName("group of faults", str(event.target.value)[:40], GROUPS.values())
        self._shown, self._open = event.target.value, None

    def _unfold(self, name: str) -> None:
        self._open = None if name == self._open else name

    def _try(self, name: str) -> None:
        if name not in self._trying:
            raise BadInput(f"cannot be tried with a button. {proven(CATALOGUE[name])}", name)
        self._desk.submit(c.Inject(name))
