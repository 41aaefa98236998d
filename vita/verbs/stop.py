"""`vita stop`: a hand on the arm that needs no page."""

from __future__ import annotations

import argparse

from vita.verbs.base import Verb, port


def _fill(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--port", type=port, help="the app's port (without it, every app that runs)")
    verb.add_argument(
        "--emergency", action="store_true", help="stay at rest until somebody resets it at the page"
    )


def _run(chosen: argparse.Namespace) -> int:
    from vita.stopping import stop

    return stop(chosen.port, chosen.emergency)


VERB = Verb("stop the arm of an app that runs on this machine, even when its page hangs", _fill, _run)
