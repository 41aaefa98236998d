"""Faults of what happens to files (rows P)."""

from __future__ import annotations
