"""Faults of what cameras and trackers do (rows V)."""

from __future__ import annotations
