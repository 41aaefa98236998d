"""Which apps run on this machine: one small file for each, so that they can be reached without their page.

A file may outlive its app (power cut, `kill -9`). It is believed only while both processes that it names are
the ones that it was written for: the same number, born at the same moment.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path


@dataclass(frozen=True)
class Running:
    """An app and the process of its arm."""

    port: int
    app: int
    """Process of the page and the servo."""
    app_born: str
    child: int
    """Process of the simulation, with the gate."""
    child_born: str
    memory: str
    """Name of the memory that both share."""

    @property
    def lives(self) -> bool:
        return bool(self.app_born) and born(self.app) == self.app_born

    @property
    def child_lives(self) -> bool:
        return bool(self.child_born) and born(self.child) == self.child_born


def run_folder() -> Path:
    """`run` in `VITA_DATA`, or a folder of this user's among the temporary files."""
    given = os.environ.get("VITA_DATA")
    if given:
        return Path(given).expanduser() / "run"
    return Path(tempfile.gettempdir()) / f"vita-{os.getuid() if hasattr(os, 'getuid') else 'user'}"


def born(pid: int) -> str:
    """When a process began, in words that never repeat for its number; empty when there is none."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
        # The name in brackets may hold anything; after it come the state and, 20th, the start time.
        state, *rest = text.rpartition(")")[2].split()
        return "" if state in "ZX" else rest[18]
    except FileNotFoundError:
        if os.path.isdir("/proc/self"):
            return ""
    except (OSError, IndexError):
        return ""
    try:
        asked = subprocess.run(
            ["ps", "-o", "lstart=", "-p", str(pid)], capture_output=True, text=True, timeout=5, check=False
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return asked.stdout.strip()


class RunFile:
    """The file of one app, from when its page is open to its end."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._path = run_folder() / f"{port}.json"
        self._said: tuple[int, str] | None = None

    def keep(self, child: int | None, memory: str) -> None:
        """Write which process the arm is in now, if that has changed. A folder that cannot be written costs
        `vita stop`, nothing else."""
        if child is None or self._said == (child, memory):
            return
        self._said = child, memory
        entry = Running(self.port, os.getpid(), born(os.getpid()), child, born(child), memory)
        fresh = self._path.with_suffix(f".{os.getpid()}")
        with contextlib.suppress(OSError):
            self._path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            fresh.write_text(json.dumps(asdict(entry)))
            fresh.replace(self._path)

    def follow(self, runner: object) -> None:
        """Write where the arm of a `vita.runner.Runner` is now; nothing for one without such a process."""
        process = getattr(runner, "arm_process", None)
        if process is not None:
            self.keep(*process)

    def remove(self) -> None:
        """Harmless when it is gone, or another app's by now."""
        entry = _read(self._path)
        if entry is not None and entry.app == os.getpid():
            with contextlib.suppress(OSError):
                self._path.unlink()


def running() -> list[Running]:
    """Every app of this user that lives, by port. Files that an app left behind are swept."""
    return sorted(_living(), key=lambda entry: entry.port)


def _living() -> Iterator[Running]:
    folder = run_folder()
    with contextlib.suppress(OSError):
        for path in folder.glob("*.json"):
            # Among the temporary files anybody may put a file; only our own say whom to signal.
            if hasattr(os, "getuid") and path.lstat().st_uid != os.getuid():
                continue
            entry = _read(path)
            if entry is not None and entry.lives:
                yield entry
            else:
                with contextlib.suppress(OSError):
                    path.unlink()


def _read(path: Path) -> Running | None:
    try:
        found = json.loads(path.read_text())
        kinds = (int, int, str, int, str, str)
        values = [found[name] for name in Running.__dataclass_fields__]
        good = all(type(value) is kind for value, kind in zip(values, kinds, strict=True))
        return Running(*values) if good and values[1] > 0 and values[3] > 0 else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
