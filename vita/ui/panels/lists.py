"""The lists of the task as HTML. All text in them is escaped; their rows press hidden buttons."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vita.snapshot import Snapshot
from vita.types import Feature
from vita.ui.findings import TINT, of_the_task, sentences, verdict
from vita.ui.words import (
    GREY,
    LOST_ADVICE,
    RED,
    TEAL,
    Rgb,
    follow_label,
    hexed,
    kind_of,
    pixels,
    quality,
    safe,
)

Ids = Callable[[int, str], tuple[str, str]]
"""(row, name) to the ids of the buttons that select and delete it."""
AMBER: Rgb = (181, 71, 8)
SENTENCES = 2
"""So many of the doctor's sentences fit beside the lists of a small window; one when nothing is wrong."""
NOTHING_YET = (
    "None yet. They tell the arm what to bring where. Once there is one, this says what it holds and what is "
    "missing, before anything moves."
)


def _list(title: str, count: int, rows: Sequence[str], empty: str, about: str = "") -> str:
    """`about` is HTML in the heading."""
    body = "".join(rows) if rows else f'<div class="empty">{empty}</div>'
    return (
        f'<div class="vita"><h4><span>{title}</span>{about}<span class="dim">{count or ""}</span></h4>'
        f'<div class="list">{body}</div></div>'
    )


def _row(
    sign: str, title: str, about: str, value: str, ids: tuple[str, str], on: bool, hint: str = "",
    extra: str = "",
) -> str:
    """`extra` is HTML between the words and the value."""
    pick, drop = ids
    return (
        f'<div class="item{" on" if on else ""}">{sign}'
        f'<label class="grow" for="{pick}" title="{safe(hint)}"><b>{safe(title)}</b> '
        f'<span class="dim">{safe(about)}</span></label>{extra}<span class="num">{safe(value)}</span>'
        f'<label class="x" for="{drop}" title="Delete">×</label></div>'
    )


def _sign(shape: str, color: Rgb) -> str:
    return f'<span class="{shape}" style="background:{hexed(color)}"></span>'


def quality_bar(feature: Feature) -> str:
    """A small bar: how well the tracker recognises its target."""
    share = min(max(feature.score, 0.0), 1.0)
    return (
        f'<span class="quality" title="Quality {100 * share:.0f} %: how well it recognises its target">'
        f'<i style="width:{100 * share:.0f}%;background:{hexed(quality(share))}"></i></span>'
    )


def trackers(snapshot: Snapshot, selected: str | None, ids: Ids) -> str:
    """One row per tracker: its camera, kind, quality and place; and what to do if it is lost."""
    rows = []
    for index, spec in enumerate(snapshot.scenario.tracker):
        feature = snapshot.features.get(spec.name)
        lost = feature is not None and not feature.ok
        color = RED if lost else TEAL if spec.kind == "fixed" else quality(feature.score if feature else 1.0)
        at = feature.uv if feature is not None else spec.at
        where = f"{at[0]:.1f}, {at[1]:.1f}" if at is not None else ""
        about = f"{spec.camera} · {'lost' if lost else follow_label(spec.kind)}"
        hint = feature.detail if feature is not None else ""
        follows = feature is not None and spec.kind != "fixed" and not lost
        bar = quality_bar(feature) if feature is not None and follows else ""
        row = _row(
            _sign("dot", color), spec.name, about, where, ids(index, spec.name), selected == spec.name,
            hint, bar,
        )
        if lost:
            why = f"{spec.name} lost: {hint}." if hint else f"{spec.name} is lost."
            row += f'<div class="lost"><b>{safe(why)}</b> {LOST_ADVICE}</div>'
        rows.append(row)
    return _list("Trackers", len(rows), rows, "None yet. Your clicks make them.")


def constraints(snapshot: Snapshot, selected: str | None, ids: Ids) -> str:
    """One row per constraint: its colour, kind, trackers and residual; then what the doctor says of them."""
    rows = []
    for index, spec in enumerate(snapshot.scenario.constraint):
        kind = kind_of(spec.kind)
        residual = np.asarray(snapshot.error.of(spec.name))
        seen = residual[np.isfinite(residual)]
        value = pixels(float(np.linalg.norm(seen)) if seen.size else float("nan"))
        weight = f" · weight {spec.weight:g}" if spec.weight != 1.0 else ""
        rank = f" · priority {spec.priority}" if spec.priority != 1 else ""
        about = f"{kind.label} · {', '.join(spec.points)}{weight}{rank}"
        rows.append(
            _row(_sign("bar", kind.color), spec.name, about, value, ids(index, spec.name),
                 selected == spec.name, about)
        )
    said, level = verdict(snapshot.findings, len(rows))
    about = f'<span class="verdict" style="color:{hexed(TINT[level])}">{said}</span>' if said else ""
    advice = sentences(of_the_task(snapshot.findings), SENTENCES if level != "good" else 1) if rows else ""
    if advice:
        rows.append(f'<div class="doctor">{advice}</div>')
    return _list("Constraints", len(snapshot.scenario.constraint), rows, NOTHING_YET, about)


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
