"""Row of the catalogue to the code that makes it happen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module

from vita.errors import BadInput, UnknownName
from vita.faults.site import Site

Injector = Callable[[Site], None]
_ROOMS = ("vision", "tasks", "control", "robot", "web", "pages", "files", "long_run")
_INJECTORS: dict[str, Injector] = {}


def injector(row: str) -> Callable[[Injector], Injector]:
    """Register the injector of a row; a row has one."""

    def register(function: Injector) -> Injector:
        if row in _INJECTORS:
            raise ValueError(f"fault {row} has an injector already")
        _INJECTORS[row] = function
        return function

    return register


def injectors() -> Mapping[str, Injector]:
    """Every row that can be tried in a running app. They reach into all rooms, so they are read late."""
    for room in _ROOMS:
        import_module(f"vita.faults.{room}")
    return dict(_INJECTORS)


def inject(row: str, site: Site) -> None:
    """Make a fault happen. Raises `UnknownName` for a row that has no injector, `BadInput` where the task or
    the rig of now does not allow it; nothing has happened then."""
    known = injectors()
    if row not in known:
        raise UnknownName("fault", row[:16], known, "inject")
    if row in site.tap.rows:
        raise BadInput("this fault is in force already; mend it first", row)
    known[row](site)
