"""The colours that things of our own share, as red, green, blue from 0 to 1."""

from __future__ import annotations

PAPER = (0.93, 0.91, 0.86)
STEEL = (0.62, 0.64, 0.67)
DARK = (0.16, 0.17, 0.19)
ORANGE = (0.93, 0.45, 0.12)
TEAL = (0.10, 0.47, 0.52)
GLASS = (0.09, 0.13, 0.24)
SKIN = (0.87, 0.67, 0.54)
HAIR = (0.28, 0.18, 0.12)
DENIM = (0.20, 0.25, 0.38)
CANVAS = (0.90, 0.89, 0.86)
