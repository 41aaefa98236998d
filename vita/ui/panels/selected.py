"""The card of the selected tracker: the loupe on it, how it follows, and how to move it exactly."""

from __future__ import annotations

from vita.snapshot import Snapshot
from vita.ui import loupe
from vita.ui.panels.lists import quality_bar
from vita.ui.words import FOLLOW, LOST_ADVICE, RED, TEAL, hexed, quality, safe

KEYS = "Arrow keys move it by 1 px, with Shift by 0.1 px."


def selected_card(snapshot: Snapshot, name: str) -> str:
    """HTML; empty while the tracker is not in the task."""
    spec = next((t for t in snapshot.scenario.tracker if t.name == name), None)
    feature = snapshot.features.get(name)
    if spec is None or feature is None:
        return ""
    frame = snapshot.frames.get(spec.camera)
    fixed = spec.kind == "fixed"
    color = RED if not feature.ok else TEAL if fixed else quality(feature.score)
    label = FOLLOW.get(spec.kind, (spec.kind, ""))[0]
    how = f"{label}: {feature.detail}" if feature.detail else label
    sure = ""
    if not fixed:
        share = f'<span class="num">{100 * feature.score:.0f} %</span>'
        sure = f'<div class="row">{quality_bar(feature)}{share}</div>'
    if feature.ok:
        state = f"<div>{safe(how)}</div>{sure}"
    else:
        why = f"Lost: {feature.detail}." if feature.detail else "Lost."
        state = f'<div class="warn"><b>{safe(why)}</b> {LOST_ADVICE}</div>'
    u, v = (float(x) for x in feature.uv)
    return (
        f'<div class="vita" id="vita-selected"><div class="card prompt pair" '
        f'style="border-left-color:{hexed(color)}">'
        f"{loupe.card(frame, feature, color) if frame is not None else ''}"
        f'<div class="grow" style="white-space:normal;line-height:1.4"><b>{safe(name)}</b> '
        f'<span class="dim">{safe(spec.camera)}</span><div class="num">{u:.2f}, {v:.2f}</div>{state}'
        f'<div class="dim keys">{KEYS}</div></div></div></div>'
    )
