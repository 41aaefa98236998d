"""The arms that ship, by name."""

from __future__ import annotations

from collections.abc import Mapping

from vita.sim.arm_spec import ArmSpec
from vita.sim.puma import PUMA
from vita.sim.robot_names import ROBOTS
from vita.sim.tx90 import TX90
from vita.sim.wam import WAMS

_SPECS = {spec.name: spec for spec in (*WAMS.values(), TX90, PUMA)}
SHIPPED: Mapping[str, ArmSpec] = {name: _SPECS[name] for name in ROBOTS}
