"""Text for people: the rows of `vita run`, `vita check` and `vita list`."""

from __future__ import annotations

import math
import sys
import textwrap
from collections.abc import Sequence

from vita.scenario.record import RunRecord
from vita.scenario.schema import Scenario
from vita.servo.insight import Finding

_COLUMNS = "    {name:<{width}}  {outcome:<10} {error:>9} {distance:>9} {time:>7}  {reason}"


def table(rows: Sequence[Sequence[str]]) -> str:
    """Rows as aligned columns."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def header(width: int) -> str:
    """The heading of `row`s whose scenario column is `width` wide."""
    return _COLUMNS.format(
        name="scenario", width=max(width, 8), outcome="outcome", error="error px", distance="mm", time="s",
        reason="reason",
    )  # fmt: skip


def row(record: RunRecord, width: int) -> str:
    """One run in one line, and one more line for each expectation that failed."""
    line = _COLUMNS.format(
        name=record.name,
        width=max(width, 8),
        outcome=record.outcome,
        error=_number(record.final_error_px, 2),
        distance=_number(record.final_distance_mm, 2),
        time=_number(record.sim_time_s, 1),
        reason=record.reason,
    )
    lines = [mark(record.passed) + line[1:].rstrip()]
    if not record.passed:
        lines += [f"      not met: {key}" for key, met in record.expect.items() if not met]
        lines += [f"      {record.message}"] if record.message else []
    return "\n".join(lines)


def mark(good: bool) -> str:
    """A tick or a cross, in letters where the terminal cannot show them."""
    sign = "✓" if good else "✗"
    try:
        sign.encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return "+" if good else "x"
    return sign


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}f}"


def contents(given: str, scenario: Scenario, freedom: str, findings: Sequence[Finding] = ()) -> str:
    """What a valid scenario holds, and what the doctor says of it."""
    lines = [
        f"{mark(True)} {given}: {scenario.title}",
        f"    robot        {scenario.scene.robot}, tool {scenario.scene.tool}",
        f"    objects      {_names([f'{o.name} ({o.kind})' for o in scenario.scene.objects])}",
        f"    cameras      {_names([c.name for c in scenario.camera])}",
        f"    trackers     {_names([t.name for t in scenario.tracker])}",
    ]
    for i, constraint in enumerate(scenario.constraint):
        head = "constraints" if i == 0 else ""
        lines.append(f"    {head:<12} {constraint.name}: {constraint.kind} of {', '.join(constraint.points)}")
    lines.append(f"    freedom      {freedom}")
    for i, finding in enumerate(findings):
        head = "findings" if i == 0 else ""
        lines += _wrapped(f"    {head:<12} ", f"{_SIGNS[finding.level]} {finding.text}")
    return "\n".join(lines)


_SIGNS = {"bad": "!!", "warning": "! ", "info": "- ", "good": "ok"}
_WIDTH = 110


def _wrapped(head: str, text: str) -> list[str]:
    """A paragraph beside its heading; what follows the first line stands under the words."""
    indent = " " * (len(head) + 3)
    return textwrap.wrap(head + text, _WIDTH, subsequent_indent=indent, drop_whitespace=True)


def _names(names: Sequence[str]) -> str:
    return f"{len(names)}: {', '.join(names)}" if names else "none"
