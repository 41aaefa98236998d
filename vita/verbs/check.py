"""`vita check`: whether scenario files are right, and what is wrong where."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING

from vita.errors import VitaError
from vita.verbs.base import Verb, as_json, complain, scenarios

if TYPE_CHECKING:
    from vita.scenario.schema import Scenario


def _fill(verb: argparse.ArgumentParser) -> None:
    scenarios(verb)
    as_json(verb)


def _run(chosen: argparse.Namespace) -> int:
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


VERB = Verb("say whether scenario files are right, and what is wrong where", _fill, _run)
