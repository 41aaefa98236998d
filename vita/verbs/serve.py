"""`vita serve`: the app."""

from __future__ import annotations

import argparse
from typing import Any

from vita.errors import BadInput, MissingDependency
from vita.sim.robot_names import ROBOTS
from vita.verbs.base import Verb, port


def _fill(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("scenario", nargs="?", metavar="SCENARIO", help="a file or the name of a shipped one")
    verb.add_argument("--host", default="127.0.0.1", help="address to listen on (default %(default)s)")
    verb.add_argument("--port", type=port, default=8080, help="port (default %(default)s; 0: a free one)")
    verb.add_argument("--robot", choices=ROBOTS, help="which robot the empty scene shows")
    verb.add_argument(
        "--allow-remote", action="store_true", help="listen on an address that other machines reach"
    )
    verb.add_argument("--token", default="", metavar="T", help="what pages must know, with --allow-remote")
    verb.add_argument(
        "--allow-unattended", action="store_true", help="keep moving when nobody drives (simulation only)"
    )


def _run(chosen: argparse.Namespace) -> int:
    from vita.scenario.library import welcome
    from vita.scenario.toml_io import load

    if chosen.scenario and chosen.robot:
        raise BadInput("give either a scenario or --robot; a scenario has its own robot")
    scenario = load(chosen.scenario) if chosen.scenario else welcome(chosen.robot)
    from vita.ui import serve

    try:
        serve(scenario, chosen.host, chosen.port, **_asked(chosen))
    except OSError as error:
        where = f"{chosen.host}:{chosen.port}"
        why = error.strerror or error
        raise MissingDependency(f"cannot listen on {where}: {why}. Try --port 0.") from None
    return 0


def _asked(chosen: argparse.Namespace) -> dict[str, Any]:
    """The permissions that were given; without any, the page's own careful defaults hold."""
    given = {key: getattr(chosen, key) for key in ("allow_remote", "token", "allow_unattended")}
    return {key: value for key, value in given.items() if value}


VERB = Verb("open the app in a browser", _fill, _run)
