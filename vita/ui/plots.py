"""Two plots of the last seconds: the error and the joints."""

from __future__ import annotations

from collections import deque

import numpy as np
import viser
from viser import uplot

from vita.snapshot import Snapshot
from vita.ui import style
from vita.ui.words import INK, PALETTE, Rgb, hexed, kind_of

SPAN_S = 20.0
POINTS = 240
PERIOD_S = 0.2
Container = viser.GuiTabHandle | viser.GuiFolderHandle


class History:
    """Samples of the last `SPAN_S` seconds, resampled to at most `POINTS` for the browser."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, np.ndarray]] = deque()

    def clear(self) -> None:
        self._rows.clear()

    def add(self, stamp: float, values: np.ndarray) -> None:
        if self._rows and stamp <= self._rows[-1][0]:
            if stamp < self._rows[-1][0] - 1.0:  # time went back: another rig or a reset
                self._rows.clear()
            else:
                return
        self._rows.append((stamp, np.array(values, float)))
        while self._rows and self._rows[0][0] < stamp - SPAN_S:
            self._rows.popleft()

    def columns(self, width: int) -> tuple[np.ndarray, ...]:
        """Seconds ago (negative), then one array per series. NaN would switch autorange off in uPlot,
        so a gap repeats the last finite value and a series that was never seen is zero."""
        if not self._rows:
            return (np.array([-SPAN_S, 0.0]), *(np.zeros(2) for _ in range(width)))
        rows = list(self._rows)
        rows = rows[:: max(1, len(rows) // POINTS)] + rows[-1:]
        ago = np.array([stamp for stamp, _ in rows]) - rows[-1][0]
        values = np.stack([v for _, v in rows])
        for column in values.T:
            good = np.isfinite(column)
            if not good.all():
                index = np.where(good, np.arange(len(column)), -1)
                index = np.maximum.accumulate(index)
                column[:] = np.where(index >= 0, column[np.maximum(index, 0)], 0.0)
        return (ago, *np.ascontiguousarray(values.T))


class Plot:
    """One uPlot whose series follow the task; it is made anew only when they change."""

    def __init__(
        self, gui: viser.GuiApi, container: Container, unit: str,
        right: tuple[str, tuple[str, ...]] | None = None, dashed: tuple[str, ...] = (),
    ) -> None:
        """`right`: a unit, and the series that are read off an axis of their own at the right; `dashed`:
        series that are drawn so."""
        self._gui, self._container, self._unit = gui, container, unit
        self._right, self._dashed = right, dashed
        with container:
            gui.add_html(style.PLOTS_MARK)
        self._history = History()
        self._names: tuple[tuple[str, Rgb], ...] | None = None
        self._handle: viser.GuiUplotHandle | None = None

    def feed(self, stamp: float, series: tuple[tuple[str, Rgb], ...], values: np.ndarray) -> None:
        """Remember one sample; cheap, called for every snapshot that is looked at."""
        if series != self._names:
            self._history.clear()
            self._names = series
            if self._handle is not None:
                self._handle.remove()
                self._handle = None
        self._history.add(stamp, values)

    def draw(self) -> None:
        """Push what has gathered to the browsers."""
        if not self._names:
            return
        data = self._history.columns(len(self._names))
        if self._handle is not None:
            self._handle.data = data
            return
        series = [uplot.Series(label="s")]
        for index, (name, color) in enumerate(self._names):
            look = uplot.Series(label=name, stroke=hexed(color), width=2.2 if index == 0 else 1.4)
            if self._right is not None and name in self._right[1]:
                look["scale"] = "right"
            if name in self._dashed:
                look["dash"], look["width"] = (5.0, 4.0), 2.2
            series.append(look)
        scales = {
            "x": uplot.Scale(time=False, auto=False, range=(-SPAN_S, 0.0)), "y": uplot.Scale(auto=True)
        }
        axes = [
            uplot.Axis(size=36, space=60),  # type: ignore
            uplot.Axis(size=46, label=self._unit, labelSize=16, space=26),
        ]
        if self._right is not None:
            scales["right"] = uplot.Scale(auto=True)
            axes.append(
                uplot.Axis(scale="right", side=1, size=40, label=self._right[0], labelSize=16, space=26)
            )
        with self._container:
            self._handle = self._gui.add_uplot(
                data, tuple(series), scales=scales, axes=tuple(axes),
                legend=uplot.Legend(show=True, live=False), height=124, padding=(8, 12, 0, 0),
            )


class Plots:
    """The plots of the panel below the task: error and joints."""

    def __init__(self, gui: viser.GuiApi, error: Container, joints: viser.GuiTabHandle) -> None:
        self.joints_tab = joints
        self._error = Plot(gui, error, "px")
        self._joints = Plot(gui, joints, "deg")
        self._drawn_at = 0.0

    def update(self, snapshot: Snapshot, now: float) -> None:
        constraints = snapshot.scenario.constraint
        series: list[tuple[str, Rgb]] = [("total", INK)]
        values = [snapshot.error.norm]
        for index, spec in enumerate(constraints[:7]):
            rows = snapshot.error.of(spec.name)
            seen = rows[np.isfinite(rows)]
            series.append((spec.name, _shade(kind_of(spec.kind).color, index)))
            values.append(float(np.linalg.norm(seen)) if seen.size else float("nan"))
        self._error.feed(snapshot.stamp, tuple(series), np.array(values))
        names = tuple((j.name, PALETTE[i % len(PALETTE)]) for i, j in enumerate(snapshot.joints))
        self._joints.feed(snapshot.stamp, names, np.degrees(np.asarray(snapshot.q, float)))
        if now - self._drawn_at >= PERIOD_S:
            self._drawn_at = now
            self._error.draw()
            self._joints.draw()


def _shade(color: Rgb, index: int) -> Rgb:
    """A constraint's colour, a little darker for each further one so that neighbours differ."""
    factor = (1.0, 0.7, 0.85, 0.55)[index % 4]
    return tuple(int(c * factor) for c in color)  # type: ignore
