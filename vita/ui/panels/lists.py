"""The lists of the task as HTML. All text in them is escaped; their rows press hidden buttons."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vita.snapshot import Snapshot
from vita.ui.words import GREEN, GREY, RED, TEAL, Rgb, hexed, kind_of, pixels, safe

Ids = Callable[[int, str], tuple[str, str]]
"""(row, name) to the ids of the buttons that select and delete it."""
AMBER: Rgb = (181, 71, 8)


def _list(title: str, count: int, rows: Sequence[str], empty: str) -> str:
    body = "".join(rows) if rows else f'<div class="empty">{empty}</div>'
    return (
        f'<div class="vita"><h4><span>{title}</span><span class="dim">{count or ""}</span></h4>'
        f'<div class="list">{body}</div></div>'
    )


def _row(
    sign: str, title: str, about: str, value: str, ids: tuple[str, str], on: bool, hint: str = ""
) -> str:
    pick, drop = ids
    return (
        f'<div class="item{" on" if on else ""}">{sign}'
        f'<label class="grow" for="{pick}" title="{safe(hint)}"><b>{safe(title)}</b> '
        f'<span class="dim">{safe(about)}</span></label><span class="num">{safe(value)}</span>'
        f'<label class="x" for="{drop}" title="Delete">×</label></div>'
    )


def _sign(shape: str, color: Rgb) -> str:
    return f'<span class="{shape}" style="background:{hexed(color)}"></span>'


def trackers(snapshot: Snapshot, selected: str | None, ids: Ids) -> str:
    """One row per tracker: whether it is seen, its camera, kind and place."""
    rows = []
    for index, spec in enumerate(snapshot.scenario.tracker):
        feature = snapshot.features.get(spec.name)
        lost = feature is not None and not feature.ok
        color = RED if lost else TEAL if spec.kind == "fixed" else GREEN
        at = feature.uv if feature is not None else spec.at
        where = f"{at[0]:.1f}, {at[1]:.1f}" if at is not None else ""
        about = f"{spec.camera} · {'lost' if lost else spec.kind}"
        hint = feature.detail if feature is not None else ""
        rows.append(
            _row(_sign("dot", color), spec.name, about, where, ids(index, spec.name),
                 selected == spec.name, hint)
        )
    return _list("Trackers", len(rows), rows, "None yet. Your clicks make them.")


def constraints(snapshot: Snapshot, selected: str | None, ids: Ids) -> str:
    """One row per constraint: its colour, kind, trackers and residual."""
    rows = []
    for index, spec in enumerate(snapshot.scenario.constraint):
        kind = kind_of(spec.kind)
        residual = np.asarray(snapshot.error.of(spec.name))
        seen = residual[np.isfinite(residual)]
        value = pixels(float(np.linalg.norm(seen)) if seen.size else float("nan"))
        weight = f" · weight {spec.weight:g}" if spec.weight != 1.0 else ""
        about = f"{kind.label} · {', '.join(spec.points)}{weight}"
        rows.append(
            _row(_sign("bar", kind.color), spec.name, about, value, ids(index, spec.name),
                 selected == spec.name, about)
        )
    return _list("Constraints", len(rows), rows, "None yet. They tell the arm what to bring where.")


def messages(snapshot: Snapshot) -> str:
    """The last few messages, newest first, so that an error can be read again."""
    if not snapshot.notices:
        return ""
    colors = {"error": RED, "warning": AMBER, "info": GREY}
    rows = [
        f'<div class="item">{_sign("bar", colors.get(n.level, GREY))}<span>{safe(n.text)}</span></div>'
        for n in reversed(snapshot.notices[-4:])
    ]
    return _list("Messages", 0, rows, "")
