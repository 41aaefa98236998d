"""Which of the two modes is in force, and which tabs it shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from vita.snapshot import Snapshot

if TYPE_CHECKING:
    import viser

UVS, IMPEDANCE = "uvs", "impedance"
LABELS = {UVS: "UVS", IMPEDANCE: "Stereo impedance"}
ABOUT = {
    UVS: "Uncalibrated visual servoing: the arm brings about what is drawn on the pictures.",
    IMPEDANCE: "The arm follows a marker seen by two cameras, drawn by a virtual spring and kept clear of "
    "everything. It learns where the cameras stand by itself.",
}
WAIT = "Stop the arm first: the mode cannot be changed while it moves."

Face = tuple[str, Any]
"""Label and icon of a tab."""


def following(snapshot: Snapshot) -> bool:
    """Whether the stereo-impedance mode is in force."""
    return snapshot.scenario.mode == IMPEDANCE


class TwoFaced:
    """A tab that shows something else in each mode, under another name.

    viser keeps no place for a tab that is taken away: its panel would be docked anew, and torn apart. So the
    first tabs of a panel stay, and what is in them changes.
    """

    def __init__(self, gui: viser.GuiApi, panel: viser.PanelHandle, faces: Mapping[str, Face]) -> None:
        """`faces`: mode to label and icon; the first is shown at first."""
        self._faces = dict(faces)
        self.handle: Any = panel.add_tab(*next(iter(self._faces.values())))
        with self.handle:
            self._folders = {mode: gui.add_folder(None, visible=mode == UVS) for mode in self._faces}

    def face(self, mode: str) -> viser.GuiFolderHandle:
        """The container of what is shown in a mode."""
        return self._folders[mode]

    def show(self, mode: str) -> None:
        self.handle._label, self.handle._icon = self._faces[mode]
        for other, folder in self._folders.items():
            if folder.visible != (other == mode):
                folder.visible = other == mode


class Tabs:
    """The tabs of a panel, of which each mode shows its own. The first must be the same in both."""

    def __init__(
        self, panel: viser.PanelHandle, tabs: Mapping[str, Sequence[TwoFaced | viser.GuiTabHandle]]
    ) -> None:
        self._panel: Any = panel
        self._tabs = {mode: tuple(shown) for mode, shown in tabs.items()}
        self._mode = ""

    def show(self, mode: str) -> None:
        """Show the tabs of a mode. Hidden ones keep their content and come back with it."""
        if mode == self._mode or mode not in self._tabs:
            return
        self._mode = mode
        handles = []
        for tab in self._tabs[mode]:
            if isinstance(tab, TwoFaced):
                tab.show(mode)
            handles.append(tab.handle if isinstance(tab, TwoFaced) else tab)
        # viser can only remove a tab for good; what it sends to browsers is made from this list.
        self._panel._tab_handles = handles
        self._panel._rebuild_tab_props()
