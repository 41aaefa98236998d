"""Row of the catalogue to the code that makes it happen."""

from __future__ import annotations

from collections.abc import Callable

from vita.errors import BadInput, UnknownName
from vita.faults.site import Site

Injector = Callable[[Site], None]
INJECTORS: dict[str, Injector] = {}


def injector(row: str) -> Callable[[Injector], Injector]:
    """Register the injector of a row; a row has one."""

    def register(function: Injector) -> Injector:
        if row in INJECTORS:
            raise ValueError(f"fault {row} has an injector already")
        INJECTORS[row] = function
        return function

    return register


def inject(row: str, site: Site) -> None:
    """Make a fault happen. Raises `UnknownName` for a row that has no injector, `BadInput` where the task or
    the rig of now does not allow it; nothing has happened then."""
    if row not in INJECTORS:
        raise UnknownName("fault", row[:16], INJECTORS, "inject")
    if row in site.tap.rows:
        raise BadInput("this fault is in force already; mend it first", row)
    INJECTORS[row](site)
