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


def worst_rows(error: ErrorVector, most: int = 3) -> str:
    """The names of the constraints whose errors are at least half of the largest, the worst first."""
    size = np.where(np.isfinite(error.values), np.abs(error.values), 0.0)
    if not size.any():
        return "nothing"
    order = [int(i) for i in np.argsort(-size, kind="stable") if size[i] >= 0.5 * size.max()]
    names = dict.fromkeys(f"{_place(error.labels[i])} ({error.labels[i].component})" for i in order)
    return ", ".join(list(names)[:most])


def unseen(error: ErrorVector) -> str:
    """The constraints with a row that is not seen."""
    rows = zip(error.labels, error.values, strict=True)
    names = dict.fromkeys(_place(label) for label, value in rows if not np.isfinite(value))
    return ", ".join(names) or "every constraint"


def _place(label: RowLabel) -> str:
    return repr(label.constraint) + (f" in camera {label.camera}" if label.camera else "")
