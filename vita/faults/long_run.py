"""Faults of the long run (rows Q).

Starts and stops by the hundred (Q3) have no button: only Start moves the arm.
"""

from __future__ import annotations

from vita.errors import BadInput
from vita.faults.registry import injector
from vita.faults.site import Site


@injector("Q2")
def storm(site: Site) -> None:
    """Our own code fails in every period, until it is mended."""
    if site.later is None:
        raise BadInput("this fault needs a runner that survives it, as in the app")
    mode = site.engine.mode

    def fail(_: object) -> None:
        raise ArithmeticError("a storm of faults was injected")

    mode.see = fail  # type: ignore[method-assign]
    site.tap.undo["Q2"] = lambda: delattr(mode, "see")
