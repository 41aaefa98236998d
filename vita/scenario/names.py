"""The names that a scenario may use, asked of the rooms that own them and only when needed.

Every import is inside a function: reading a task file must not load a simulator or OpenCV first.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from vita.errors import BadInput, UnknownName
from vita.scenario.typed import shown
from vita.types import Joint

if TYPE_CHECKING:
    from vita.sim.robots import RobotModel

OUTCOMES = ("converged", "limited", "held", "fault", "timeout")
MODES = ("uvs", "impedance")
NO_TOOL = "none"
LINE = "line"
"""The tracker kind that gives two points, the ends of a line."""


def constraint_kinds() -> tuple[str, ...]:
    from vita.constraints import CONSTRAINTS

    return tuple(CONSTRAINTS)


def constraint_fits(kind: str, widths: list[int]) -> bool:
    """Whether trackers that give `widths` points each fill the roles of a constraint."""
    from vita.constraints import CONSTRAINTS

    return CONSTRAINTS[kind].fits(widths)


def constraint_roles(kind: str) -> tuple[str, ...]:
    """What each point of a constraint is."""
    from vita.constraints import CONSTRAINTS

    return CONSTRAINTS[kind].roles


def constraint_lines(kind: str) -> tuple[tuple[int, int], ...]:
    """Which pairs of a constraint's points are the ends of a line."""
    from vita.constraints import CONSTRAINTS

    return CONSTRAINTS[kind].lines()


def shortest_line_px() -> float:
    from vita.constraints.base import MIN_LINE_PX

    return MIN_LINE_PX


def tracker_kinds() -> tuple[str, ...]:
    from vita.vision import TRACKER_KINDS

    return tuple(dict.fromkeys((*TRACKER_KINDS, "fixed", "projected")))


def noise_kinds() -> tuple[str, ...]:
    from vita.vision import NOISE_KINDS

    return tuple(NOISE_KINDS)


def reasons() -> tuple[str, ...]:
    """The codes that a run may end with."""
    from vita.servo import REASONS

    return tuple(reason for reason in REASONS if reason)


def object_kinds() -> tuple[str, ...]:
    from vita.sim.objects import OBJECT_KINDS

    return tuple(OBJECT_KINDS)


def tools() -> tuple[str, ...]:
    from vita.sim.tools import TOOLS

    return tuple(dict.fromkeys((*TOOLS, NO_TOOL)))


@dataclass(frozen=True)
class RobotNames:
    """What a scenario needs to know of its robot."""

    joints: tuple[Joint, ...]
    """The joints with the robot's own limits."""
    links: tuple[str, ...]
    """Its bodies, `flange` and `tool` among them."""


def robot(name_or_path: str) -> RobotNames:
    """The names of a robot; raises `BadInput` when there is no such robot."""
    from vita.sim.robots import ROBOTS, load_robot

    path = Path(name_or_path).expanduser()
    if name_or_path not in ROBOTS and path.suffix.lower() not in (".urdf", ".xml"):
        raise UnknownName("robot", name_or_path[:80], (*ROBOTS, "the path of a .urdf file"))
    if name_or_path not in ROBOTS and not path.is_file():  # a device or pipe would be read for ever
        raise BadInput(f"there is no file {shown(name_or_path)}")
    return _shipped(name_or_path) if name_or_path in ROBOTS else _names(load_robot(name_or_path))


@lru_cache(maxsize=8)
def _shipped(name: str) -> RobotNames:
    """Read once: the page checks the whole task after every click."""
    from vita.sim.robots import load_robot

    return _names(load_robot(name))


def _names(model: RobotModel) -> RobotNames:
    return RobotNames(tuple(model.joints), (*model.link_names, "flange", "tool"))
