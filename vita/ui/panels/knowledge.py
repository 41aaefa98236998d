"""What the servo knows of its own Jacobian: gauges, and the worst that there is to say about it."""

from __future__ import annotations

import time

import viser

from vita.snapshot import Snapshot
from vita.ui import style
from vita.ui.findings import sentences, without_praise
from vita.ui.gauges import bars, gauges
from vita.ui.panels.base import Html

PERIOD_S = 0.4
SENTENCES = 2
EMPTY = (
    '<div class="vita empty">After <b>Start</b> the arm makes a few small moves and learns how they change '
    "the images. What it then knows, and how well, is shown here.</div>"
)


class KnowledgePanel:
    def __init__(self, gui: viser.GuiApi, tab: viser.GuiTabHandle) -> None:
        with tab:
            Html(gui, style.PLOTS_MARK)
            self._body = Html(gui, EMPTY)
        self._shown_at = 0.0

    def update(self, snapshot: Snapshot) -> None:
        """Figures that change ten times a second cannot be read, so that fewer are sent."""
        now = time.monotonic()
        if now - self._shown_at < PERIOD_S:
            return
        self._shown_at = now
        self._body.show(knowledge(snapshot))


def knowledge(snapshot: Snapshot) -> str:
    """The block as HTML."""
    said = sentences(without_praise(snapshot.findings), SENTENCES)  # the gauges praise already
    if snapshot.insight is None:
        return EMPTY + (f'<div class="vita">{said}</div>' if said else "")
    return f'<div class="vita" id="vita-knowledge">{bars(gauges(snapshot.insight))}{said}</div>'
