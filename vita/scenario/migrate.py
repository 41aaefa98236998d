"""Files of older versions of the format: brought up to date in memory, one version at a time.

Schema 1 is the only one so far. A new one adds a function here and a file in `tests/old_files`, and both
stay for ever.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Table = dict[str, Any]
MIGRATIONS: dict[int, Callable[[Table], Table]] = {}
"""Version to what turns a file of it into one of the next version."""


def version_of(table: Table) -> int | None:
    """The file's version, or None where it says none that could be one."""
    version = table.get("schema")
    return version if isinstance(version, int) and not isinstance(version, bool) else None


def migrated(table: Table) -> Table:
    """The table as the newest version that can be reached; a version without a way is left as it is."""
    while (version := version_of(table)) in MIGRATIONS:
        assert version is not None
        table = {**MIGRATIONS[version](table), "schema": version + 1}
    return table
