"""`vita experiment`: the documents' experiments."""

from __future__ import annotations

import argparse
from pathlib import Path

from vita.verbs.base import Verb, whole


def _fill(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("name", nargs="*", metavar="NAME", help="an experiment, or all (--list names them)")
    verb.add_argument("--list", action="store_true", help="name the experiments and what each one asks")
    verb.add_argument("--quick", action="store_true", help="a thinner sweep, under 30 s each")
    verb.add_argument("--workers", type=whole, metavar="N", help="processes (default: one for each core)")
    verb.add_argument("--scheduler", default="", metavar="ADDRESS", help="let a Dask cluster do the work")
    verb.add_argument(
        "--out", type=Path, default=Path("out/experiments"), metavar="DIR",
        help="write report, CSV and plots to DIR/NAME (default %(default)s)",
    )  # fmt: skip
    verb.add_argument("--seed", type=whole, default=0, metavar="N", help="of the noise; default %(default)s")


def _run(chosen: argparse.Namespace) -> int:
    from vita.experiments.runner import Request, listing, run_experiments

    c = chosen
    if c.list:
        print(listing())
        return 0
    return run_experiments(Request(tuple(c.name), c.quick, c.workers, c.scheduler, c.out, c.seed))


VERB = Verb("run the documents' experiments and report their figures", _fill, _run)
