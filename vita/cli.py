"""The command line. The exit code is the verdict.

0 good, 1 an expectation failed, 2 bad usage or a bad file, 3 the environment lacks something.
Simulator and page are imported by the verbs that need them, so that `vita list` is quick.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

# The matrices here are small: numpy's threads only wait for one another, and for the renderer. The
# variable counts when numpy is loaded, and is inherited by the simulation's process.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from vita import __version__  # noqa: E402
from vita.calibration import arguments as calibration  # noqa: E402
from vita.errors import BadInput, MissingDependency, VitaError  # noqa: E402
from vita.sim.robot_names import ROBOTS  # noqa: E402

if TYPE_CHECKING:
    from vita.scenario.record import RunRecord
    from vita.scenario.schema import Scenario

OURS = ("vita", "")


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


def complain(error: VitaError | ModuleNotFoundError) -> int:
    """One line on stderr; returns the exit code. An import error of our own code is a bug: raised."""
    if isinstance(error, ModuleNotFoundError):
        if (error.name or "").partition(".")[0] in OURS:
            raise error
        error = MissingDependency(f"the package {error.name!r} is missing; install vita once more")
    print(f"vita: {' '.join(str(error).split())}", file=sys.stderr)
    return error.exit_code


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
    for name, (help_, fill, run) in VERBS.items():
        verb = verbs.add_parser(name, help=help_, description=help_)
        fill(verb)
        verb.set_defaults(run=run)
    return parser


def _port(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text[:9]) <= 65535):
        raise argparse.ArgumentTypeError(f"{text!r} is not a port (0 to 65535; 0 takes a free one)")
    return int(text)


# serve ------------------------------------------------------------------------------------------


def _fill_serve(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("scenario", nargs="?", metavar="SCENARIO", help="a file or the name of a shipped one")
    verb.add_argument("--host", default="127.0.0.1", help="address to listen on (default %(default)s)")
    verb.add_argument("--port", type=_port, default=8080, help="port (default %(default)s; 0: a free one)")
    verb.add_argument("--robot", choices=ROBOTS, help="which robot the empty scene shows")


def _serve(chosen: argparse.Namespace) -> int:
    from vita.scenario.library import welcome
    from vita.scenario.toml_io import load

    if chosen.scenario and chosen.robot:
        raise BadInput("give either a scenario or --robot; a scenario has its own robot")
    scenario = load(chosen.scenario) if chosen.scenario else welcome(chosen.robot)
    from vita.ui import serve

    try:
        serve(scenario, chosen.host, chosen.port)
    except OSError as error:
        where = f"{chosen.host}:{chosen.port}"
        why = error.strerror or error
        raise MissingDependency(f"cannot listen on {where}: {why}. Try --port 0.") from None
    return 0


# run --------------------------------------------------------------------------------------------


def _fill_run(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("scenario", nargs="+", metavar="SCENARIO", help="a file or the name of a shipped one")
    verb.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="assignments",
        help="change a value of every scenario, e.g. servo.gain=0.3 (may be repeated)",
    )  # fmt: skip
    verb.add_argument("--out", type=Path, metavar="DIR", help="write recording and plot there")
    verb.add_argument("--json", action="store_true", help="one JSON object a line and nothing else")
    verb.add_argument("--speed", choices=("fast", "realtime"), default="fast", help="default %(default)s")


def _run(chosen: argparse.Namespace) -> int:
    from vita.scenario.overrides import override
    from vita.scenario.toml_io import load

    # All files are read before the first one runs: a typo in the last must not cost minutes.
    scenarios = [(given, override(load(given), chosen.assignments)) for given in chosen.scenario]
    if chosen.out is not None:
        _make_folder(chosen.out)
    from vita.scenario.headless import run_scenario
    from vita.scenario.report import header, row

    worst, stems = 0, set()
    width = max(len(given) for given, _ in scenarios)
    if not chosen.json:
        print(header(width))
    for given, scenario in scenarios:
        try:
            record = run_scenario(scenario, realtime=chosen.speed == "realtime", name=given)
        except (VitaError, ModuleNotFoundError) as error:
            worst = max(worst, complain(_named(error, given)))
            continue
        line = json.dumps(record.summary(), allow_nan=False) if chosen.json else row(record, width)
        print(line, flush=True)
        if chosen.out is not None:
            record.save(chosen.out, _free_stem(record, stems))
        worst = max(worst, 0 if record.passed else 1)
    return worst


def _named(error: VitaError | ModuleNotFoundError, given: str) -> VitaError | ModuleNotFoundError:
    if isinstance(error, VitaError):
        error.args = (f"{given}: {error}",)
    return error


def _free_stem(record: RunRecord, taken: set[str]) -> str:
    """A file name that no other scenario of this command has: `a/task.toml` and `b/task.toml` may meet."""
    stem, i = record.stem, 2
    while stem in taken:
        stem, i = f"{record.stem}_{i}", i + 1
    taken.add(stem)
    return stem


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"cannot make the folder: {error.strerror or error}", str(folder)) from None


# check and list ---------------------------------------------------------------------------------


def _fill_check(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("scenario", nargs="+", metavar="SCENARIO", help="a file or the name of a shipped one")
    verb.add_argument("--json", action="store_true", help="one JSON object a line and nothing else")


def _check(chosen: argparse.Namespace) -> int:
    from vita.scenario.toml_io import load

    worst = 0
    for given in chosen.scenario:
        try:
            print(_checked(given, load(given), chosen.json), flush=True)
        except (VitaError, ModuleNotFoundError) as error:
            worst = max(worst, complain(error))
    return worst


def _checked(given: str, scenario: Scenario, as_json: bool) -> str:
    from vita.scenario.checkup import check_up
    from vita.scenario.report import contents

    checkup = check_up(scenario)
    if not as_json:
        return contents(given, scenario, checkup.freedom, checkup.findings)
    head = {"scenario": given, "title": scenario.title, "robot": scenario.scene.robot}
    return json.dumps(head | checkup.summary(), allow_nan=False)


def _fill_list(verb: argparse.ArgumentParser) -> None:
    del verb  # it has no arguments


def _list(chosen: argparse.Namespace) -> int:
    del chosen
    from vita.scenario.library import catalogue
    from vita.scenario.report import table

    print(table([("name", "robot", "title"), *((e.name, e.robot, e.title) for e in catalogue())]))
    return 0


# track ------------------------------------------------------------------------------------------


def _fill_track(verb: argparse.ArgumentParser) -> None:
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


def _track(chosen: argparse.Namespace) -> int:
    from vita.tracking import Request, track

    c = chosen
    return track(Request(c.source, tuple(c.at), c.tracker, c.out, c.show, c.first, c.frames))


# experiment -------------------------------------------------------------------------------------


def _fill_experiment(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("name", nargs="*", metavar="NAME", help="an experiment, or all (--list names them)")
    verb.add_argument("--list", action="store_true", help="name the experiments and what each one asks")
    verb.add_argument("--quick", action="store_true", help="a thinner sweep, under 30 s each")
    verb.add_argument("--workers", type=_whole, metavar="N", help="processes (default: one for each core)")
    verb.add_argument("--scheduler", default="", metavar="ADDRESS", help="let a Dask cluster do the work")
    verb.add_argument(
        "--out", type=Path, default=Path("out/experiments"), metavar="DIR",
        help="write report, CSV and plots to DIR/NAME (default %(default)s)",
    )  # fmt: skip
    verb.add_argument("--seed", type=_whole, default=0, metavar="N", help="of the noise; default %(default)s")


def _whole(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 10):
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number")
    return int(text)


def _experiment(chosen: argparse.Namespace) -> int:
    from vita.experiments.runner import Request, listing, run_experiments

    c = chosen
    if c.list:
        print(listing())
        return 0
    return run_experiments(Request(tuple(c.name), c.quick, c.workers, c.scheduler, c.out, c.seed))


Fill = Callable[[argparse.ArgumentParser], None]
Run = Callable[[argparse.Namespace], int]
VERBS: dict[str, tuple[str, Fill, Run]] = {
    "serve": ("open the app in a browser", _fill_serve, _serve),
    "run": ("run scenarios without a browser and judge them", _fill_run, _run),
    "check": ("say whether scenario files are right, and what is wrong where", _fill_check, _check),
    "list": ("list the scenarios that ship", _fill_list, _list),
    "track": ("follow places in your own video, images or camera", _fill_track, _track),
    "calibrate": ("learn the lenses of one camera or two from pictures of a board", *calibration.VERB),
    "experiment": ("run the documents' experiments and report their figures", _fill_experiment, _experiment),
}


def entry() -> None:
    """The console script."""
    sys.exit(main())


if __name__ == "__main__":
    entry()
