"""What is shown and how: cameras or 3D world, picture quality, rates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import viser

from vita.snapshot import Snapshot
from vita.ui import style
from vita.ui.panels.base import Desk, Html
from vita.ui.safe import number
from vita.ui.words import safe


@dataclass
class Display:
    """Settings of the picture, shared by all browsers."""

    fps: float = 15.0
    pane: bool = True


class ViewPanel:
    def __init__(
        self,
        desk: Desk,
        display: Display,
        set_quality: Callable[[int], None],
        switch: Callable[[Any, str], None],
        fit: Callable[[Any], None],
        set_pane: Callable[[bool], None],
        rate_hz: Callable[[], float],
    ) -> None:
        self._rate_hz = rate_hz
        gui, guard = desk.gui, desk.guard
        self._display, self._set_quality, self._set_pane = display, set_quality, set_pane
        Html(gui, style.TABS_MARK)
        views = gui.add_button_group("Show", ("Cameras", "3D world"), hint="V switches too.")
        views.on_click(guard(lambda event: switch(event, event.target.value)))
        refit = gui.add_button("Fit the views", icon=viser.Icon.MAXIMIZE, hint="F")
        refit.on_click(guard(fit))
        Html(gui, style.sheet(style.plain((refit,))))
        pane = gui.add_checkbox("3D overview", True, hint="A small live 3D view below the cameras.")
        pane.on_update(guard(self._paned))
        fps = gui.add_slider(
            "Pictures [Hz]", min=1, max=30, step=1, initial_value=int(display.fps),
            hint="How often the page shows new pictures. The servo's own rate is not touched.",
        )
        fps.on_update(guard(self._paced))
        quality = gui.add_slider("JPEG quality", min=30, max=95, step=5, initial_value=80)
        quality.on_update(guard(self._encoded))
        self._rates = Html(gui)

    def update(self, snapshot: Snapshot) -> None:
        timing = snapshot.timing
        phases = " · ".join(f"{safe(name)} {ms:.1f} ms" for name, ms in timing.ms.items())
        self._rates.show(
            f'<div class="vita num"><h4><span>Rates</span></h4>'
            f"Control loop <b>{timing.loop_hz:.0f} Hz</b> · pictures <b>{self._rate_hz():.0f} Hz</b> · "
            f"simulation <b>{timing.real_time_factor:.2f}×</b><div class='dim'>{phases}</div></div>"
        )

    def _paned(self, event: Any) -> None:
        self._display.pane = bool(event.target.value)
        self._set_pane(self._display.pane)

    def _paced(self, event: Any) -> None:
        self._display.fps = number(event.target.value, 1, 30, "pictures per second")

    def _encoded(self, event: Any) -> None:
        self._set_quality(int(number(event.target.value, 30, 95, "quality")))
