"""vita: show a robot what to do by drawing on its camera images, with no calibration.

`vita.run` executes a task file, `vita.load` and `vita.save` handle them, `vita.servo.VisualServo`
servoes any robot on any error vector. Neither viser nor pybullet is imported until it is needed.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vita.errors import BadInput, VitaError
    from vita.scenario.record import RunRecord
    from vita.scenario.schema import Scenario
    from vita.servo import Joint, ServoConfig, VisualServo

__version__ = "0.1.0"


_HOMES = {
    "BadInput": "vita.errors",
    "VitaError": "vita.errors",
    "Scenario": "vita.scenario.schema",
    "Joint": "vita.servo",
    "ServoConfig": "vita.servo",
    "VisualServo": "vita.servo",
}


def __getattr__(name: str) -> object:
    """The public names, fetched when they are first used: the command line can then set the number
    of numpy's threads before numpy is loaded."""
    if name not in _HOMES:
        raise AttributeError(f"module 'vita' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def load(path_or_name: str | Path) -> Scenario:
    """Read a scenario file, or one that ships by its name. Raises `BadInput`."""
    from vita.scenario.toml_io import load as read

    return read(path_or_name)


def save(scenario: Scenario, path: str | Path) -> None:
    """Write a scenario file, atomically."""
    from vita.scenario.toml_io import save as write

    write(scenario, path)


def run(scenario: Scenario | str | Path) -> RunRecord:
    """Run a scenario headless in the simulator; the record holds arrays per tick and the verdict."""
    from vita.scenario.headless import run_scenario

    if isinstance(scenario, (str, Path)):
        return run_scenario(load(scenario), name=str(scenario))
    return run_scenario(scenario)


__all__ = [
    "BadInput",
    "Joint",
    "Scenario",
    "ServoConfig",
    "VisualServo",
    "VitaError",
    "__version__",
    "load",
    "run",
    "save",
]
