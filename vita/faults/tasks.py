"""Faults of what the task asks (rows T)."""

from __future__ import annotations
