"""`vita fuzz` and `vita soak`: try to break vita, and say what came of it."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from vita.verbs.base import Verb, duration, make_folder, whole

if TYPE_CHECKING:
    from vita.fuzz.base import Report

FUZZERS = ("gate", "files", "events", "frames")
SHOWN = 10
"""How many violations are written out."""


def _fill_fuzz(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "name", nargs="?", choices=(*FUZZERS, "all"), default="all", metavar="NAME",
        help=f"{', '.join(FUZZERS)} or all (default %(default)s)",
    )  # fmt: skip
    verb.add_argument(
        "--seconds", type=duration, default=10.0, metavar="S", help="for each (default %(default)g)"
    )
    verb.add_argument("--seed", type=whole, default=0, metavar="N", help="what is tried; default %(default)s")


def _fuzz(chosen: argparse.Namespace) -> int:
    worst = 0
    for name in FUZZERS if chosen.name == "all" else (chosen.name,):
        report = import_module(f"vita.fuzz.{name}").run(chosen.seconds, chosen.seed)
        print(line(report), flush=True)
        worst = max(worst, 0 if report.passed else 1)
    return worst


def line(report: Report) -> str:
    """A report on one line, and its first violations below."""
    bad = len(report.violations)
    words = [f"{'ok  ' if report.passed else 'FAIL'} {report.name}: {report.tried} {report.unit}"]
    words.append(f"{bad} violation{'' if bad == 1 else 's'}")
    words += [f"{key} {value:.5g}" for key, value in report.figures.items()]
    below = [f"     {violation}" for violation in report.violations[:SHOWN]]
    if bad > SHOWN:
        below.append(f"     and {bad - SHOWN} more")
    return "\n".join([", ".join(words), *below])


def _fill_soak(verb: argparse.ArgumentParser) -> None:
    verb.add_argument(
        "--minutes", type=duration, default=15.0, metavar="M", help="how long (default %(default)g)"
    )
    verb.add_argument("--out", type=Path, metavar="DIR", help="write the samples (CSV) and the verdict there")
    verb.add_argument("--seed", type=whole, default=0, metavar="N", help="what is done; default %(default)s")


def _soak(chosen: argparse.Namespace) -> int:
    if chosen.out is not None:
        make_folder(chosen.out)
    from vita.fuzz.soak import run

    report = run(60.0 * chosen.minutes, chosen.seed, out=chosen.out)
    print(line(report), flush=True)
    return 0 if report.passed else 1


FUZZ = Verb("throw hostile input at vita by the thousand", _fill_fuzz, _fuzz)
SOAK = Verb("use the app for a while, with faults, and watch memory, threads and handles", _fill_soak, _soak)
