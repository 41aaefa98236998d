"""Faults of what happens at the page (rows U)."""

from __future__ import annotations
