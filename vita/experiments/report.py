"""What an experiment found, as files: CSV with all figures, a markdown report, PNG plots."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from numbers import Integral, Real
from pathlib import Path

import numpy as np

from vita.errors import BadInput
from vita.experiments.base import Check, Experiment, Report, Table

DASH = "–"
DIGITS = 4
"""Significant digits of the markdown tables; the CSV files have all."""


def write(experiment: Experiment, report: Report, folder: Path) -> list[Path]:
    """Write the files into `folder` and name them; raises `BadInput` when that cannot be done."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        written = [folder / "report.md"]
        written[0].write_text(f"# {experiment.title}\n\n{experiment.doc}\n\n{_body(report)}", "utf-8")
        for name, table in report.data.items():
            written.append(folder / f"{name}.csv")
            _write_csv(table, written[-1])
        for name, figure in report.figures.items():
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1], format="png")
    except OSError as error:
        raise BadInput(f"cannot write there: {error.strerror or error}", str(folder)) from None
    return written


def words(report: Report) -> str:
    """Summary and tables as markdown, for the terminal."""
    parts = [report.summary.strip()]
    if report.checks:
        parts.append(markdown(_checks(report.checks)))
    return "\n\n".join([*parts, *(markdown(table) for table in report.tables)]) + "\n"


def _body(report: Report) -> str:
    pictures = "".join(f"\n![{name}]({name}.png)\n" for name in report.figures)
    files = ", ".join(f"[{name}.csv]({name}.csv)" for name in report.data)
    return words(report) + pictures + (f"\nAll figures: {files}.\n" if files else "")


def markdown(table: Table) -> str:
    """The table with its title above and its notes below."""
    cells = [[*map(cell, row)] for row in table.rows]
    widths = [
        max(len(column), *(len(row[i]) for row in cells)) if cells else len(column)
        for i, column in enumerate(table.columns)
    ]
    numeric = [all(_is_number(row[i]) for row in table.rows) for i in range(len(table.columns))]

    def line(row: Sequence[str]) -> str:
        padded = (
            text.rjust(width) if right else text.ljust(width)
            for text, width, right in zip(row, widths, numeric, strict=True)
        )
        return f"| {' | '.join(padded)} |"

    rule = "|".join(
        "-" * (width + 1) + ":" if right else "-" * (width + 2)
        for width, right in zip(widths, numeric, strict=True)
    )
    parts = [f"**{table.title}**", "", line(table.columns), f"|{rule}|", *map(line, cells)]
    return "\n".join([*parts, "", table.notes] if table.notes else parts)


def cell(value: object) -> str:
    """A value as people read it: four significant digits, and a dash for what is missing."""
    if value is None:
        return DASH
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, Integral):
        return str(int(value))
    if isinstance(value, Real):
        number = float(value)
        if math.isnan(number):
            return DASH
        if math.isinf(number) or number == 0.0:
            return f"{number:g}"
        if 1e-3 <= abs(number) < 1e6:
            digits = max(DIGITS - 1 - math.floor(math.log10(abs(number))), 0)
            text = f"{number:.{min(digits, 4)}f}"
            return text.rstrip("0").rstrip(".") if "." in text else text
        return f"{number:.{DIGITS - 1}g}"
    return str(value).replace("|", "\\|")


def _is_number(value: object) -> bool:
    return value is None or (isinstance(value, Real) and not isinstance(value, bool))


def _checks(checks: Sequence[Check]) -> Table:
    rows = [(check.what, check.wanted, check.ours, check.met) for check in checks]
    return Table("Figures to reach", ("figure", "wanted", "ours", "reached"), rows)


def _write_csv(table: Table, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table.columns)
        writer.writerows([["" if _missing(value) else _plain(value) for value in row] for row in table.rows])


def _missing(value: object) -> bool:
    return value is None or (isinstance(value, Real) and math.isnan(float(value)))


def _plain(value: object) -> object:
    """numpy's numbers as Python's, whose text has every digit and nothing else; truth as 1 or 0."""
    if isinstance(value, Integral | np.bool_):
        return int(value)
    return float(value) if isinstance(value, Real) else value
