"""Which constraint is behind what happened, in words for people."""

from __future__ import annotations

import numpy as np

from vita.types import ErrorVector, RowLabel


def worst_row(error: ErrorVector) -> str:
    """The name of the row with the largest error among those that are seen."""
    if not np.isfinite(error.values).any():
        return "nothing"
    label = error.labels[int(np.nanargmax(np.abs(error.values)))]
    return f"{_place(label)} ({label.component})"


def unseen(error: ErrorVector) -> str:
    """The constraints with a row that is not seen."""
    rows = zip(error.labels, error.values, strict=True)
    names = dict.fromkeys(_place(label) for label, value in rows if not np.isfinite(value))
    return ", ".join(names) or "every constraint"


def _place(label: RowLabel) -> str:
    return repr(label.constraint) + (f" in camera {label.camera}" if label.camera else "")
