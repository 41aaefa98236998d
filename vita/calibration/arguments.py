"""The arguments of `vita calibrate`; light, because every verb's arguments are read at each start."""

from __future__ import annotations

import argparse
from pathlib import Path


def fill(verb: argparse.ArgumentParser) -> None:
    """Declare them."""
    verb.add_argument(
        "source", nargs="*", metavar="SOURCE",
        help="a folder of images, a video or a camera's number; two of them for a stereo rig, left one first",
    )  # fmt: skip
    verb.add_argument(
        "--board", required=True, metavar="BOARD",
        help="charuco:COLSxROWS:SQUARE_MM:MARKER_MM or checker:COLSxROWS:SQUARE_MM; squares are counted",
    )  # fmt: skip
    verb.add_argument("--out", type=Path, metavar="TOML", help="the calibration file (default: print it)")
    verb.add_argument(
        "--show", type=Path, metavar="DIR", help="write the views with corners and errors there"
    )
    verb.add_argument(
        "--print", type=Path, metavar="FILE", dest="print_to",
        help="write the board to print, at true size, to a .pdf or .png; needs no SOURCE",
    )  # fmt: skip
    verb.add_argument("--dpi", type=_dpi, default=300, metavar="N", help="of --print (default %(default)s)")


def _dpi(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 5 and 50 <= int(text) <= 2400):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of dots per inch (50 to 2400)")
    return int(text)


def run(chosen: argparse.Namespace) -> int:
    """Do it; returns the exit code."""
    if len(chosen.source) > 2:
        from vita.errors import BadInput

        raise BadInput(f"{len(chosen.source)} sources; give one camera's or two", "SOURCE")
    from vita.calibration.command import Request, calibrate

    c = chosen
    return calibrate(Request(tuple(c.source), c.board, c.out, c.show, c.print_to, c.dpi))


VERB = fill, run
