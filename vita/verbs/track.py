"""`vita track`: the trackers on people's own pictures."""

from __future__ import annotations

import argparse
from pathlib import Path

from vita.verbs.base import Verb


def _fill(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("source", metavar="SOURCE", help="a video, a folder of images or a camera's number")
    verb.add_argument(
        "--at", action="append", required=True, metavar="U,V[,W,H]",
        help="pixel to follow in the first frame, and the size of the region around it; with --tracker line "
        "U,V,U2,V2 are its ends (may be repeated; NAME=U,V names it)",
    )  # fmt: skip
    verb.add_argument("--tracker", default="auto", metavar="NAME", help="its kind (default %(default)s)")
    verb.add_argument("--out", type=Path, metavar="CSV", help="write the table there (default: print it)")
    verb.add_argument("--show", type=Path, metavar="VIDEO", help="write an annotated video there")
    verb.add_argument("--from", type=_count, default=0, dest="first", metavar="FRAME", help="the first frame")
    verb.add_argument("--frames", type=_count, metavar="N", help="stop after so many frames")


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of frames")
    return int(text)


def _run(chosen: argparse.Namespace) -> int:
    from vita.tracking import Request, track

    c = chosen
    return track(Request(c.source, tuple(c.at), c.tracker, c.out, c.show, c.first, c.frames))


VERB = Verb("follow places in your own video, images or camera", _fill, _run)
