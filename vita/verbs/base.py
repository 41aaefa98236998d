"""What a verb is, and what several of them need."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vita.errors import BadInput, MissingDependency, VitaError

OURS = ("vita", "")


@dataclass(frozen=True)
class Verb:
    """One word of the command line."""

    help: str
    fill: Callable[[argparse.ArgumentParser], None]
    """Declares its arguments; called at every start, so it imports nothing heavy."""
    run: Callable[[argparse.Namespace], int]
    """Does it; returns the exit code."""


def complain(error: VitaError | ModuleNotFoundError) -> int:
    """One line on stderr; returns the exit code. An import error of our own code is a bug: raised."""
    if isinstance(error, ModuleNotFoundError):
        if (error.name or "").partition(".")[0] in OURS:
            raise error
        error = MissingDependency(f"the package {error.name!r} is missing; install vita once more")
    print(f"vita: {' '.join(str(error).split())}", file=sys.stderr)
    return error.exit_code


def make_folder(folder: Path) -> None:
    """Make a folder for results, or say why not before the work begins."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"cannot make the folder: {error.strerror or error}", str(folder)) from None


def port(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text[:9]) <= 65535):
        raise argparse.ArgumentTypeError(f"{text!r} is not a port (0 to 65535; 0 takes a free one)")
    return int(text)


def whole(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number")
    return int(text)


def duration(text: str) -> float:
    """A time above zero, in whatever unit the argument has."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value <= 1e6:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time above 0")
    return value


def scenarios(verb: argparse.ArgumentParser) -> None:
    """The argument that names one scenario or more."""
    verb.add_argument("scenario", nargs="+", metavar="SCENARIO", help="a file or the name of a shipped one")


def as_json(verb: argparse.ArgumentParser) -> None:
    """The argument for output that programs read."""
    verb.add_argument("--json", action="store_true", help="one JSON object a line and nothing else")
