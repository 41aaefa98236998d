"""`vita replay`: what happened in the seconds before a fault, from its recording."""

from __future__ import annotations

import argparse
from pathlib import Path

from vita.verbs.base import Verb, as_json


def _fill(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("recording", type=Path, metavar="RECORDING", help="either file of a recording")
    verb.add_argument("--out", type=Path, metavar="DIR", help="write tables and plot there")
    as_json(verb)


def _run(chosen: argparse.Namespace) -> int:
    from vita.scenario.replay import replay

    return replay(chosen.recording, out=chosen.out, as_json=chosen.json)


VERB = Verb("show what a recording of a fault holds, moment by moment", _fill, _run)
