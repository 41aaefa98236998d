"""`vita list` and `vita faults`: what there is."""

from __future__ import annotations

import argparse

from vita.verbs.base import Verb


def _nothing(verb: argparse.ArgumentParser) -> None:
    del verb  # it has no arguments


def _list(chosen: argparse.Namespace) -> int:
    del chosen
    from vita.scenario.library import catalogue
    from vita.scenario.report import table

    print(table([("name", "robot", "title"), *((e.name, e.robot, e.title) for e in catalogue())]))
    return 0


def _faults(chosen: argparse.Namespace) -> int:
    del chosen
    from vita.faults import CATALOGUE, injectors
    from vita.scenario.report import table

    buttons = injectors()
    rows = [("row", "fault", "what becomes of the arm", "within", "how to go on", "button")]
    for row in CATALOGUE.values():
        button = "yes" if row.id in buttons else "-"
        rows.append((row.id, row.title, row.verdict, row.bound or "-", row.recover, button))
    print(table(rows))
    return 0


LIST = Verb("list the scenarios that ship", _nothing, _list)
FAULTS = Verb("list the faults that vita is held against, and how to go on after each", _nothing, _faults)
