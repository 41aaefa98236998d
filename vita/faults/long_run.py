"""Faults of the long run (rows Q)."""

from __future__ import annotations
