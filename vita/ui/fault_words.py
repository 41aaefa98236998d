"""The catalogue of faults in words: what should happen, and how a row is proven. Pure, without viser."""

from __future__ import annotations

import re

from vita.faults import Row
from vita.ui.words import AMBER, BLUE, GREEN, GREY, ORANGE, RED, Rgb

GROUPS: dict[str, str] = {
    "V": "Cameras and trackers", "T": "Task", "C": "Servo", "R": "Robot", "U": "Page", "P": "Files",
    "Q": "Long run",
}
"""First letter of a row to the group that it belongs to."""
OWNED = ("U1", "U5")
"""Rows that two people try with two windows."""
COMMANDS = {
    "U8": "vita fuzz frames", "P7": "vita fuzz files", "U11": "vita fuzz files", "C7": "vita fuzz gate",
    "Q1": "vita soak", "Q3": "vita soak",
}
"""Rows with a command of their own that tries them by the thousand."""

VERDICTS: dict[str, tuple[str, Rgb]] = {
    "refused": ("refused", BLUE), "degraded": ("half speed", AMBER), "hold": ("held", ORANGE),
    "fault": ("fault", RED), "estop": ("emergency stop", RED), "offline": ("offline", GREY),
    "harmless": ("harmless", GREEN),
}
"""What becomes of a moving arm: the word on its chip, and the colour."""
SENTENCES = {
    "refused": "It is refused with a sentence, and nothing changes.",
    "degraded": "The arm goes on at half speed.",
    "hold": "The arm brakes and is held.",
    "fault": "The arm brakes, and the fault has to be acknowledged.",
    "estop": "The arm brakes, and the emergency stop latches.",
    "offline": "The arm is at rest, and the page says that the simulation is gone.",
    "harmless": "Nothing bad happens: the arm goes on, or never moves.",
}


def group_of(row: str) -> str:
    return GROUPS[row[0]]


def expected(row: Row) -> str:
    """What becomes of the arm, within which time, and how to go on."""
    within = f"within {row.bound}" if re.match(r"\d+ (s|ms|period|gate)", row.bound) else row.bound
    when = f" ({within})" if within else ""
    after = "" if row.recover == "nothing to do" else f" Then: {row.recover}."
    return f"{SENTENCES[row.verdict][:-1]}{when}.{after}"


def proof(row: Row) -> str:
    """The command that proves a row, for those that cannot be tried in a running app."""
    return COMMANDS.get(row.id) or f"pytest tests/faults --row {row.id}"


def proven(row: Row) -> str:
    """How to see for oneself that a row without a button holds."""
    here = "Open this page in a second window and see. " if row.id in OWNED else ""
    return f"{here}Proven by: {proof(row)}"
