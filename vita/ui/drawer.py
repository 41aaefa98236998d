"""The folder in which the page keeps the tasks that people save."""

from __future__ import annotations

import hashlib
import re
import threading
from pathlib import Path

from vita.data import tasks_folder
from vita.errors import BadInput, UnknownName
from vita.scenario import disk, toml_io
from vita.scenario.schema import SCHEMA, Scenario

_GOOD = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _-]{0,62}")
_RESERVED = {"con", "prn", "aux", "nul", *(f"com{i}" for i in range(10)), *(f"lpt{i}" for i in range(10))}


class Drawer:
    """Saves under plain names only, so that no name can lead out of the folder, and never over a task that
    the page which saves has not seen."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._known: dict[tuple[str, str], str] = {}
        """(page, name) to the check sum of the file as that page last loaded or saved it."""
        self._one_at_a_time = threading.Lock()

    @classmethod
    def default(cls) -> Drawer:
        """`VITA_DATA`, or `vita` in the user's data folder; what killed programs left there is removed."""
        folder = tasks_folder()
        disk.sweep(folder)
        return cls(folder)

    def names(self) -> list[str]:
        try:
            found = [path.stem for path in self.folder.glob("*.toml") if path.is_file()]
        except OSError:
            return []
        return sorted(name for name in found if _GOOD.fullmatch(name))

    def save(self, name: str, scenario: Scenario, who: str = "") -> str:
        """Write the task; returns the name that it was saved under. `who` is the page that asks."""
        path = self._path(name)
        with self._one_at_a_time:
            self._check_seen(who, path)
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise BadInput(f"not saved: {disk.why(error)}", str(self.folder)) from None
            toml_io.save(scenario, path)
            self._known[who, path.stem] = _sum(path)
        return path.stem

    def load(self, name: str, who: str = "") -> Scenario:
        if name not in self.names():
            raise UnknownName("saved task", name, self.names())
        path = self._path(name)
        with self._one_at_a_time:
            seen = _sum(path)  # first: what changes while we read is then unknown, not known
            scenario = toml_io.load(path)
            self._known[who, path.stem] = seen
        return scenario

    def note(self, name: str) -> str:
        """What people should know of a saved task that they open; empty when there is nothing."""
        version = toml_io.version(self._path(name))
        if version is None or version >= SCHEMA:
            return ""
        return f"{name!r} was upgraded from {version}; saving it keeps the old file as {name}.toml.bak."

    def _path(self, name: str) -> Path:
        plain = name.strip()
        if not _GOOD.fullmatch(plain) or plain.lower() in _RESERVED:
            raise BadInput("use 1 to 63 letters, digits, spaces, - and _", "name")
        path = self.folder / f"{plain}.toml"
        try:
            link = path.is_symlink()
        except OSError as error:  # a folder that may not even be looked into
            raise BadInput(f"cannot be reached: {disk.why(error)}", str(path)) from None
        if link:
            raise BadInput("is a link to somewhere else; choose another name", plain)
        return path

    def _check_seen(self, who: str, path: Path) -> None:
        """Refuse to write over what this page does not know."""
        known = self._known.get((who, path.stem))
        there = _sum(path)
        if there and there != known:
            how = "was saved meanwhile from another page" if known else "exists already"
            raise BadInput(f"{path.stem!r} {how}; save under another name, or load it first")


def _sum(path: Path) -> str:
    """The check sum of a file's bytes; empty when there is none."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else ""
    except OSError as error:
        raise BadInput(f"cannot read the file: {disk.why(error)}", path.stem) from None
