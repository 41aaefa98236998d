"""The plots of the stereo-impedance mode: the error, and the tool's true and recovered position as in
figure 7 of the TUM report."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from vita.snapshot import Snapshot
from vita.ui.impedance_words import BY_CAMERAS
from vita.ui.panels.base import Html
from vita.ui.plots import PERIOD_S, Container, Plot
from vita.ui.words import BLUE, GREEN, INK, RED, Rgb

AXES: tuple[tuple[str, Rgb], ...] = (("x", RED), ("y", GREEN), ("z", BLUE))
SEEN = "seen"
UNKNOWN = np.full(3, np.nan)


def error_sample(snapshot: Snapshot) -> np.ndarray:
    """(2,) distance [mm] and angle [deg] of the tool from its goal."""
    return np.array([snapshot.impedance.error_mm, snapshot.impedance.error_deg])


def position_sample(snapshot: Snapshot) -> np.ndarray:
    """(6,) x, y, z of the tool's marker by the joints and as recovered by the cameras [mm] (fig. 7 a, c)."""
    view = snapshot.impedance
    places = [UNKNOWN if place is None else place for place in (view.tool_fk, view.tool_seen)]
    return 1e3 * np.concatenate(places)


def difference_sample(snapshot: Snapshot) -> np.ndarray:
    """(4,) recovered minus by the joints along x, y, z, and its length [mm] (fig. 7 b)."""
    places = position_sample(snapshot)
    apart = places[3:] - places[:3]
    return np.array([float(np.linalg.norm(apart)), *apart])


class Known:
    """A plot that shows a series from the first time on that there is something to show: what was never
    measured is not drawn as zero."""

    def __init__(self, gui: viser.GuiApi, container: Container, unit: str, empty: str, **how: Any) -> None:
        """`empty`: a sentence for as long as nothing is known; `how`: see `Plot`."""
        self._plot = Plot(gui, container, unit, **how)
        with container:
            self._note = Html(gui, f'<div class="vita empty">{empty}</div>')
        self._seen: set[str] = set()

    def forget(self) -> None:
        self._seen.clear()

    def feed(self, stamp: float, series: tuple[tuple[str, Rgb], ...], values: np.ndarray) -> None:
        self._seen.update(name for (name, _), value in zip(series, values, strict=True) if np.isfinite(value))
        shown = [index for index, (name, _) in enumerate(series) if name in self._seen]
        self._plot.feed(stamp, tuple(series[index] for index in shown), values[shown])

    def draw(self) -> None:
        self._note.visible(not self._seen)
        self._plot.draw()


class RecoveredPlots:
    """The error's place is given; two tabs more are made."""

    def __init__(self, gui: viser.GuiApi, error: Container, panel: viser.PanelHandle) -> None:
        self.tabs = (
            panel.add_tab("Position", viser.Icon.AXIS_X),
            panel.add_tab("Difference", viser.Icon.ARROWS_DIFF),
        )
        later = "is shown here once the cameras have learned where they stand"
        self._error = Known(
            gui, error, "mm", f"How far the tool is from its place at the target {later}.",
            right=("deg", ("angle [deg]",)),
        )
        self._position = Known(
            gui, self.tabs[0], "mm", "Where the tool is, by its joints and by the cameras.",
            dashed=tuple(f"{axis} {SEEN}" for axis, _ in AXES),
        )
        self._difference = Known(
            gui, self.tabs[1], "mm", f"How far the cameras are wrong about the tool {later}."
        )
        self._plots = self._error, self._position, self._difference
        self._drawn_at = 0.0

    def forget(self) -> None:
        """Another mode is in force."""
        for plot in self._plots:
            plot.forget()

    def update(self, snapshot: Snapshot, now: float) -> None:
        stamp = snapshot.stamp
        self._error.feed(
            stamp, (("distance [mm]", INK), ("angle [deg]", BY_CAMERAS)), error_sample(snapshot)
        )
        seen = tuple((f"{axis} {SEEN}", _dark(color)) for axis, color in AXES)
        self._position.feed(stamp, (*AXES, *seen), position_sample(snapshot))
        self._difference.feed(stamp, (("distance", INK), *AXES), difference_sample(snapshot))
        if now - self._drawn_at >= PERIOD_S:
            self._drawn_at = now
            for plot in self._plots:
                plot.draw()


def _dark(color: Rgb) -> Rgb:
    """The same hue, to be told from the other line where both lie together."""
    return tuple(round(0.45 * part + 11) for part in color)  # type: ignore[return-value]
