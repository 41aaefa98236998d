"""The check sum in the first line of a saved file: damage is noticed, and never taken for a task.

It is a comment, so that other TOML readers do not mind it. Files that people write have none.
"""

from __future__ import annotations

import hashlib
import re

from vita.errors import BadInput

_SEAL = re.compile(r"# vita task, sha256 ([0-9a-f]{64})[^\n]*\n?")


def sealed(text: str) -> str:
    """The text with its check sum in front."""
    head = f"# vita task, sha256 {_sum(text)} of what follows; delete this line after editing by hand"
    return f"{head}\n{text}"


def check_seal(text: str) -> None:
    """Raise `BadInput` when the text has a check sum of something else."""
    match = _SEAL.match(text)
    if match and match[1] != _sum(text[match.end() :]):
        raise BadInput("line 1: the file is damaged, or was edited by hand: then delete its first line")


def _sum(text: str) -> str:
    # Git and mail programs may turn line ends into those of Windows, which changes no task.
    return hashlib.sha256(text.replace("\r\n", "\n").encode("utf-8", "replace")).hexdigest()
