"""Every experiment that there is: importing this module registers them, in the order of the documents."""

from __future__ import annotations

from importlib import import_module

MODULES = (
    "camera_rotation",
    "camera_baseline",
    "repeatability",
    "tracker_noise",
    "estimators",
    "placement",
)
"""One for each experiment, named as it is."""

for _module in MODULES:
    import_module(f"vita.experiments.{_module}")
