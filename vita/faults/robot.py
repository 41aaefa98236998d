"""Faults of the robot and its process (rows R)."""

from __future__ import annotations
