"""Where vita keeps what people make with it."""

from __future__ import annotations

import os
from pathlib import Path


def tasks_folder() -> Path:
    """Saved tasks: `VITA_DATA`, or `vita/tasks` in the user's data folder."""
    given = os.environ.get("VITA_DATA")
    return Path(given).expanduser() if given else _home() / "tasks"


def faults_folder() -> Path:
    """Recordings that faults leave: `faults` in `VITA_DATA`, or in `vita` in the user's data folder."""
    given = os.environ.get("VITA_DATA")
    return (Path(given).expanduser() if given else _home()) / "faults"


def _home() -> Path:
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "vita"
