"""The scenario files that ship, by name."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

from vita.assets import asset
from vita.errors import BadInput, UnknownName
from vita.scenario.schema import Scenario


@dataclass(frozen=True)
class Entry:
    """One shipped scenario, for lists."""

    name: str
    robot: str
    title: str
    path: Path


def shipped() -> dict[str, Path]:
    """Name to file of every scenario that ships, in alphabetic order."""
    return {path.stem: path for path in sorted(asset("scenarios").glob("*.toml"))}


def find(path_or_name: str | os.PathLike[str]) -> Path:
    """The file of a shipped scenario's name or of a path.

    A bare name means the shipped scenario even when the folder holds something of that name;
    `./name` means the file.
    """
    given = os.fspath(path_or_name)
    if "\0" in given:
        raise BadInput("a path cannot hold a zero byte", "scenario")
    names = shipped()
    if given in names:
        return names[given]
    path = Path(given).expanduser()
    try:
        if path.is_file():
            return path
        if path.is_dir():
            raise BadInput("is a folder, not a scenario file", given)
    except OSError as error:  # e.g. a name that is longer than the system allows
        raise BadInput(f"cannot be opened: {error.strerror or error}", given[:80]) from None
    if path.suffix or path.parent != Path("."):
        raise BadInput("there is no such file", given)
    raise UnknownName("scenario", given[:80], names)


def welcome(robot: str | None = None) -> Scenario:
    """What the app shows when nothing is asked for: the point-to-point scene with nothing drawn yet."""
    from vita.scenario.toml_io import load

    scenario = load("point_to_point")
    scene = scenario.scene if robot is None else replace(scenario.scene, robot=robot)
    bare = replace(scenario, scene=scene, tracker=(), constraint=(), script=(), expect=None)
    return replace(bare, title="Untitled task", description="")


def catalogue() -> list[Entry]:
    """Every shipped scenario with what a list shows of it."""
    from vita.scenario.toml_io import load

    entries = []
    for name, path in shipped().items():
        scenario = load(path)
        entries.append(Entry(name, scenario.scene.robot, scenario.title, path))
    return entries
