"""Faults that end in a refusal: what is tried, and that nothing came of it, is what people are shown."""

from __future__ import annotations

from collections.abc import Callable

from vita.errors import BadInput, VitaError
from vita.faults.site import Site
from vita.scenario import toml_io
from vita.scenario.schema import Scenario


def refused(what: str, attempt: Callable[[], object]) -> None:
    """Show the refusal that an attempt ends with. One that succeeds is a hole, and an error of ours."""
    try:
        attempt()
    except VitaError as refusal:
        raise BadInput(f"Tried: {what}. Refused, nothing was changed: {refusal}") from None
    raise AssertionError(f"{what} was accepted")


def task(site: Site) -> Scenario:
    """The task that is loaded."""
    return site.engine.present()


def text(site: Site) -> str:
    """The file that saving it would write, without its check sum."""
    return toml_io.dumps(task(site))


def read(changed: str) -> Callable[[], object]:
    return lambda: toml_io.loads(changed, source="the file")
