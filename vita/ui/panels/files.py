"""Examples one click away; saving, loading, uploading and downloading tasks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import viser

from vita import commands as c
from vita.errors import BadInput
from vita.scenario import library, toml_io
from vita.scenario.schema import Scenario
from vita.scenario.seal import sealed
from vita.snapshot import Snapshot
from vita.types import MOVING_STATES
from vita.ui import style
from vita.ui.drawer import Drawer
from vita.ui.panels.base import Desk, Html
from vita.ui.words import safe

MAX_UPLOAD = 1_000_000
FIRST_EXAMPLE = "point_to_point"
NOTHING = "(nothing saved yet)"


def examples() -> list[tuple[str, str, str]]:
    """(name, title, robot) of the tasks that ship; a broken one must not keep the page from opening."""
    try:
        return [(entry.name, entry.title, entry.robot) for entry in library.catalogue()]
    except (BadInput, OSError, ImportError):
        return []


class FilesPanel:
    def __init__(self, desk: Desk, drawer: Drawer | None = None) -> None:
        self._desk = desk
        self._drawer = drawer or Drawer.default()
        self.identity: Callable[[int], str] = str
        """Who is behind a connection, as the drawer tells pages apart."""
        gui, guard = desk.gui, desk.guard
        Html(gui, style.TABS_MARK)
        self._sheet = Html(gui)
        self._title = Html(gui)
        self._examples = examples()
        buttons = []
        with gui.add_folder("Examples"):
            if not self._examples:
                Html(gui, '<div class="vita dim">No examples were found in this installation.</div>')
            for name, title, robot in self._examples:
                button = gui.add_button(name.replace("_", " ").capitalize(), hint=f"{title} ({robot})")
                button.on_click(guard(lambda event, name=name: self.open_example(name)))
                buttons.append(button)
        with gui.add_folder("My tasks"):
            self._name = gui.add_text("Name", "my task", hint="Letters, digits, spaces, - and _.")
            self._save = gui.add_button("Save", icon=viser.Icon.DEVICE_FLOPPY)
            names = self._drawer.names()
            self._saved = gui.add_dropdown("Saved", tuple(names) or (NOTHING,))
            self._load = gui.add_button("Load", icon=viser.Icon.FOLDER_OPEN)
            Html(gui, f'<div class="vita dim">Kept in {safe(self._drawer.folder)}</div>')
        with gui.add_folder("This computer"):
            self._upload = gui.add_upload_button(
                "Upload a task", icon=viser.Icon.UPLOAD, mime_type=".toml",
                hint="A .toml file of at most 1 MB.",
            )
            self._download = gui.add_button("Download this task", icon=viser.Icon.DOWNLOAD)
        self._save.on_click(guard(self._do_save))
        self._load.on_click(guard(self._do_load))
        self._upload.on_upload(guard(self._do_upload))
        self._download.on_click(desk.anyone(self._do_download))
        self._sheet.show(
            style.sheet(
                style.side_by_side(buttons, 2),
                style.plain((*buttons, self._save, self._load, self._download)),
            )
        )

    def update(self, snapshot: Snapshot) -> None:
        scenario = snapshot.scenario
        about = f'<div class="dim">{safe(scenario.description)}</div>' if scenario.description else ""
        self._title.show(
            f'<div class="vita"><div class="card"><b>{safe(scenario.title)}</b>'
            f'<div class="dim">{safe(scenario.scene.robot)} · {len(scenario.camera)} cameras</div>'
            f"{about}</div></div>"
        )

    def show_me(self, event: Any) -> None:
        """The one-click way to a finished task."""
        names = [name for name, _, _ in self._examples]
        if not names:
            raise BadInput("no examples were found in this installation; click a task together instead")
        self.open_example(FIRST_EXAMPLE if FIRST_EXAMPLE in names else names[0])

    def open_example(self, name: str) -> None:
        self._open(toml_io.load(library.shipped()[name]))

    def _open(self, scenario: Scenario) -> None:
        if self._desk.snapshot().status.state in MOVING_STATES:
            raise BadInput("the arm is moving: press Stop first, then load")
        self._desk.composer.put_away()
        self._desk.submit(c.LoadTask(scenario))

    def _task(self) -> Scenario:
        """What is saved: the task as it is seen, without script and expectations."""
        return replace(self._desk.snapshot().scenario, script=(), expect=None)

    def _do_save(self, event: Any) -> None:
        name = self._drawer.save(str(self._name.value), self._task(), self._who(event))
        self._saved.options = tuple(self._drawer.names()) or (NOTHING,)
        self._saved.value = name
        self._desk.tell(event.client, "info", f"Saved as {name}.")

    def _do_load(self, event: Any) -> None:
        name = str(self._saved.value)
        self._open(self._drawer.load(name, self._who(event)))
        if note := self._drawer.note(name):
            self._desk.tell(event.client, "info", note)

    def _do_upload(self, event: Any) -> None:
        content: bytes = event.target.value.content  # the name that the browser gives is not used
        if len(content) > MAX_UPLOAD:
            raise BadInput("the file is too big: at most 1 MB", "upload")
        self._open(toml_io.loads(content, source="upload"))

    def _do_download(self, event: Any) -> None:
        text = sealed(toml_io.dumps(self._task()))
        event.client.send_file_download("task.toml", text.encode(), save_immediately=True)

    def _who(self, event: Any) -> str:
        return self.identity(getattr(event.client, "client_id", -1))
