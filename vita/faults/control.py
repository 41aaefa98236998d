"""Faults of what the servo does (rows C)."""

from __future__ import annotations
