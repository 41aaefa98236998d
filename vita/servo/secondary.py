"""What joint motion that the task leaves free is used for."""

from __future__ import annotations

from typing import ClassVar


class NoSecondary:
    """The smallest motion that does the task."""

    kind: ClassVar[str] = "none"
    title: ClassVar[str] = "Nothing"
    doc: ClassVar[str] = "The smallest motion that does the task."


SECONDARIES: dict[str, type] = {NoSecondary.kind: NoSecondary}
"""Kind to secondary objective."""
