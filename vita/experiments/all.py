"""Every experiment that there is: importing this module registers them, in the order of the documents."""

from __future__ import annotations

from importlib import import_module

from vita.experiments.base import EXPERIMENTS

MODULES = (
    "camera_rotation",
    "camera_baseline",
    "repeatability",
    "tracker_noise",
    "estimators",
    "placement",
    "stereo_impedance",
    "side_by_side",
    "false_alarms",
)
"""One for each experiment, named as it is."""

for _module in MODULES:
    import_module(f"vita.experiments.{_module}")
    # Somebody may have imported one of them before; the order is the documents' all the same.
    _name = _module.replace("_", "-")
    EXPERIMENTS[_name] = EXPERIMENTS.pop(_name)
