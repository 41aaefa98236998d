"""The constraint doctor's sentences as HTML: worst first, escaped, with the colour of their weight."""

from __future__ import annotations

from collections.abc import Sequence

from vita.servo.insight import Finding, Level
from vita.ui.words import GREEN, RED, Rgb, hexed, safe

ORDER: tuple[Level, ...] = ("bad", "warning", "info", "good")
TINT: dict[Level, Rgb] = {"bad": RED, "warning": (181, 71, 8), "info": (102, 112, 133), "good": GREEN}
"""Amber is darker than elsewhere: it is text here."""
SIGN: dict[Level, str] = {"bad": "✕", "warning": "!", "info": "i", "good": "✓"}


ESTIMATE = frozenset(("held", "nothing_held", "condition", "known", "agreement", "near"))
"""Codes of what is said of the estimate (`vita.servo.insight.words`); all others are about the task."""


def of_the_task(findings: Sequence[Finding]) -> list[Finding]:
    """What there is to say about the task itself, praise left out."""
    return [f for f in findings if f.code not in ESTIMATE and f.level != "good"]


def worst_first(findings: Sequence[Finding]) -> list[Finding]:
    """Sorted by weight; at equal weight what is said of the estimate comes first, since the task's
    sentences also stand beside its constraints."""
    return sorted(findings, key=lambda f: (ORDER.index(f.level), f.code not in ESTIMATE))


def without_praise(findings: Sequence[Finding]) -> list[Finding]:
    """What is not good already; when all is well, that alone."""
    ordered = worst_first(findings)
    return [f for f in ordered if f.level != "good"] or ordered[:1]


def sentences(findings: Sequence[Finding], limit: int) -> str:
    """At most `limit` sentences; the rest is counted, and can be read by pointing at the count."""
    ordered = worst_first(findings)
    rows = [
        f'<div class="finding {f.level}"><i style="background:{hexed(TINT[f.level])}">{SIGN[f.level]}</i>'
        f"<span>{safe(f.text)}</span></div>"
        for f in ordered[:limit]
    ]
    rest = ordered[limit:]
    if rest:
        more = "\n".join(f.text for f in rest)
        rows.append(f'<div class="finding more" title="{safe(more)}">and {len(rest)} more</div>')
    return "".join(rows)


def verdict(findings: Sequence[Finding], constraints: int) -> tuple[str, Level]:
    """A few words on the whole task, for the heading above its constraints."""
    if not constraints:
        return "", "info"
    findings = of_the_task(findings)
    problems = sum(f.level in ("bad", "warning") for f in findings)
    if not problems:
        return "✓ no problem found", "good"
    level: Level = "bad" if any(f.level == "bad" for f in findings) else "warning"
    return f"{problems} problem{'s' if problems > 1 else ''} found", level
