"""What is shown and how: cameras or 3D world, picture quality, and where the time goes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import viser

from vita.snapshot import Snapshot
from vita.ui import style
from vita.ui.mode import following
from vita.ui.panels.base import Desk, Html
from vita.ui.safe import number
from vita.ui.words import safe

if TYPE_CHECKING:
    from vita.ui.actions import Actions
    from vita.ui.stream import Encoder


@dataclass
class Display:
    """Settings of the picture, shared by all browsers."""

    fps: float = 15.0
    pane: bool = True
    foresee: bool = True
    forces: bool = True


class ViewPanel:
    def __init__(
        self, desk: Desk, display: Display, encoder: Encoder, actions: Actions,
        set_pane: Callable[[bool], None], set_foresee: Callable[[bool], None],
        set_forces: Callable[[bool], None],
    ) -> None:
        gui, guard = desk.gui, desk.guard
        self._display, self._encoder = display, encoder
        Html(gui, style.TABS_MARK)
        views = gui.add_button_group("Show", ("Cameras", "3D world"), hint="V switches too.")
        views.on_click(desk.anyone(
            lambda event: actions.switch(event, "world" if event.target.value == "3D world" else "cameras")
        ))
        refit = gui.add_button("Fit the views", icon=viser.Icon.MAXIMIZE, hint="F")
        refit.on_click(desk.anyone(lambda event: actions.fit(event)))
        Html(gui, style.sheet(style.plain((refit,))))
        pane = gui.add_checkbox("3D overview", True, hint="A small live 3D view below the cameras.")
        pane.on_update(guard(lambda event: set_pane(bool(event.target.value))))
        step = gui.add_checkbox(
            "Next step", True,
            hint="While the arm moves: where the features, and the arm, are expected after the next step.",
        )
        step.on_update(guard(lambda event: set_foresee(bool(event.target.value))))
        forces = gui.add_checkbox(
            "Forces and what the cameras say", True, visible=False,
            hint="In 3D: the virtual mass with its forces, and tool, target and cameras as they are seen.",
        )
        forces.on_update(guard(lambda event: set_forces(bool(event.target.value))))
        self._step, self._forces = step, forces
        fps = gui.add_slider(
            "Pictures [Hz]", min=1, max=30, step=1, initial_value=int(display.fps),
            hint="How often the page shows new pictures. The servo's own rate is not touched.",
        )
        fps.on_update(guard(self._paced))
        quality = gui.add_slider("JPEG quality", min=30, max=95, step=5, initial_value=80)
        quality.on_update(guard(self._encoded))
        self._phases = Html(gui)

    def update(self, snapshot: Snapshot) -> None:
        for handle, shown in ((self._step, not following(snapshot)), (self._forces, following(snapshot))):
            if handle.visible != shown:
                handle.visible = shown
        rows = "".join(
            f'<div class="item"><span class="grow">{safe(name)}</span>'
            f'<span class="num">{ms:.1f} ms</span></div>'
            for name, ms in snapshot.timing.ms.items()
        )
        self._phases.show(
            f'<div class="vita"><h4><span>Time of one control period</span></h4>'
            f'<div class="list">{rows}</div></div>' if rows else ""
        )

    def _paced(self, event: Any) -> None:
        self._display.fps = number(event.target.value, 1, 30, "pictures per second")

    def _encoded(self, event: Any) -> None:
        self._encoder.quality = int(number(event.target.value, 30, 95, "quality"))
