"""The folder in which the page keeps the tasks that people save."""

from __future__ import annotations

import os
import re
from pathlib import Path

from vita.errors import BadInput, UnknownName
from vita.scenario import toml_io
from vita.scenario.schema import Scenario

_GOOD = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _-]{0,62}")
_RESERVED = {"con", "prn", "aux", "nul", *(f"com{i}" for i in range(10)), *(f"lpt{i}" for i in range(10))}


class Drawer:
    """Saves under plain names only, so that no name can lead out of the folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @classmethod
    def default(cls) -> Drawer:
        """`VITA_DATA`, or `vita` in the user's data folder."""
        base = os.environ.get("VITA_DATA")
        if base:
            return cls(Path(base).expanduser())
        home = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
        return cls(home / "vita" / "tasks")

    def names(self) -> list[str]:
        try:
            found = [path.stem for path in self.folder.glob("*.toml") if path.is_file()]
        except OSError:
            return []
        return sorted(name for name in found if _GOOD.fullmatch(name))

    def save(self, name: str, scenario: Scenario) -> str:
        """Write the task; returns the name that it was saved under."""
        path = self._path(name)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            toml_io.save(scenario, path)
        except OSError as error:
            raise BadInput(f"not saved: {error.strerror or error}", str(self.folder)) from None
        return path.stem

    def load(self, name: str) -> Scenario:
        if name not in self.names():
            raise UnknownName("saved task", name, self.names())
        return toml_io.load(self._path(name))

    def _path(self, name: str) -> Path:
        plain = name.strip()
        if not _GOOD.fullmatch(plain) or plain.lower() in _RESERVED:
            raise BadInput("use 1 to 63 letters, digits, spaces, - and _", "name")
        path = self.folder / f"{plain}.toml"
        if path.is_symlink():
            raise BadInput("is a link to somewhere else; choose another name", plain)
        return path
