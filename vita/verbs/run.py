"""`vita run`: scenarios without a browser, judged."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from vita.errors import VitaError
from vita.verbs.base import Verb, as_json, complain, make_folder, scenarios

if TYPE_CHECKING:
    from vita.scenario.record import RunRecord


def _fill(verb: argparse.ArgumentParser) -> None:
    scenarios(verb)
    verb.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="assignments",
        help="change a value of every scenario, e.g. servo.gain=0.3 (may be repeated)",
    )  # fmt: skip
    verb.add_argument("--out", type=Path, metavar="DIR", help="write recording and plot there")
    as_json(verb)
    verb.add_argument("--speed", choices=("fast", "realtime"), default="fast", help="default %(default)s")


def _run(chosen: argparse.Namespace) -> int:
    from vita.scenario.overrides import override
    from vita.scenario.toml_io import load

    # All files are read before the first one runs: a typo in the last must not cost minutes.
    scenarios = [(given, override(load(given), chosen.assignments)) for given in chosen.scenario]
    if chosen.out is not None:
        make_folder(chosen.out)
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


VERB = Verb("run scenarios without a browser and judge them", _fill, _run)
