"""Faults of who drives (rows U3 and U4); what else happens at the page is in `vita.faults.web`."""

from __future__ import annotations

from vita.errors import BadInput
from vita.faults.attacks import Outside, attack
from vita.faults.registry import injector
from vita.faults.site import Site


def _driver(site: Site, row: str) -> int:
    driver = None if site.page is None else site.page.driver()
    if driver is None:
        raise BadInput("nobody drives; press something first", row)
    return driver


@injector("U3")
def dropped_line(site: Site) -> None:
    """The line of the page that drives is cut. A browser connects again by itself, as after a reload."""
    site.page.drop(_driver(site, "U3"))


@injector("U4")
def another_page(site: Site) -> None:
    """A second page is opened and wants to take back the last edit."""
    _driver(site, "U4")

    def act(outside: Outside) -> str:
        with outside.client() as page:
            page.command("Undo")
            page.wait(lambda: page.notifications, "the refusal", 3.0)
            return f'a second page pressed Undo and read: "{page.notifications[-1][1]}"'

    attack(site, "U4", act)
