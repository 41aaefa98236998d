"""The command line. The exit code is the verdict.

0 good, 1 an expectation failed, 2 bad usage or a bad file, 3 the environment lacks something.
Simulator and page are imported by the verbs that need them, so that `vita list` is quick.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

# The matrices here are small: numpy's threads only wait for one another, and for the renderer. The
# variable counts when numpy is loaded, and is inherited by the simulation's process.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from vita import __version__  # noqa: E402
from vita.calibration import arguments as calibration  # noqa: E402
from vita.errors import VitaError  # noqa: E402
from vita.verbs import check, experiment, fuzz, lists, replay, run, serve, stop, track  # noqa: E402
from vita.verbs.base import Verb, complain  # noqa: E402

VERBS: dict[str, Verb] = {
    "serve": serve.VERB,
    "stop": stop.VERB,
    "run": run.VERB,
    "replay": replay.VERB,
    "check": check.VERB,
    "list": lists.LIST,
    "track": track.VERB,
    "calibrate": Verb(
        "learn the lenses of one camera or two from pictures of a board", *calibration.VERB
    ),
    "experiment": experiment.VERB,
    "faults": lists.FAULTS,
    "fuzz": fuzz.FUZZ,
    "soak": fuzz.SOAK,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        chosen = _parser().parse_args(_with_verb(arguments))
    except SystemExit as end:  # argparse has printed its own message
        return int(end.code or 0)
    try:
        code = chosen.run(chosen)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # `vita list | head`: the reader has gone, which is no mistake of ours
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (VitaError, ModuleNotFoundError) as error:
        return complain(error)


def _with_verb(arguments: list[str]) -> list[str]:
    """`vita`, `vita --port 0` and `vita my.toml` mean `vita serve ...`."""
    first = arguments[0] if arguments else ""
    if first in ("-h", "--help", "--version") or first in VERBS:
        return arguments
    if not first or first.startswith("-") or first.endswith(".toml") or Path(first).is_file():
        return ["serve", *arguments]
    return arguments


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="vita",
        description="Show a robot arm what to do by clicking in camera images. Without a verb: serve.",
        epilog="Exit code: 0 good, 1 an expectation failed, 2 bad usage or file, 3 something is missing.",
    )
    parser.add_argument("--version", action="version", version=f"vita {__version__}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for name, verb in VERBS.items():
        sub = verbs.add_parser(name, help=verb.help, description=verb.help)
        verb.fill(sub)
        sub.set_defaults(run=verb.run)
    return parser


def entry() -> None:
    """The console script."""
    sys.exit(main())


if __name__ == "__main__":
    entry()
