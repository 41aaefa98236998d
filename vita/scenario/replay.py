"""`vita replay`: what happened by a recording, moment by moment, and whether the servo would do so again."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from vita.errors import BadInput
from vita.scenario.plot import plot
from vita.scenario.record import RunRecord
from vita.scenario.rerun import Rerun, rerun
from vita.types import Array

EVERY = 30
"""A line of numbers is printed so often [ticks], and for each of the last `LAST`."""
LAST = 10


def replay(recording: Path, *, out: Path | None = None, as_json: bool = False) -> int:
    """Print the story of a recording. 0 when all is well, 1 when the servo would not do the same again.

    out: folder for a plot and a table of every tick. Raises `BadInput` for what is no recording.
    """
    record = RunRecord.load(recording)
    again = rerun(record)
    if as_json:
        print(json.dumps(story(record, again), allow_nan=False))
    else:
        print("\n".join(lines(record, again)))
    if out is not None:
        _write(record, Path(out))
    return 1 if again.different else 0


def story(record: RunRecord, again: Rerun) -> dict[str, Any]:
    """Everything as plain data."""
    return {
        "recording": record.name,
        "outcome": record.outcome,
        "reason": record.reason,
        "message": record.message,
        "ticks": record.ticks,
        "timeline": [moment(record, i) for i in _shown(record)],
        "events": [dict(event) for event in record.events],
        "replayed": {
            "ticks": again.ticks,
            "identical": again.identical if not again.why_not else None,
            "different": list(again.different[:20]),
            "why_not": again.why_not,
        },
    }


def moment(record: RunRecord, i: int) -> dict[str, Any]:
    """The numbers of one tick."""
    seen = record.seen[i] if record.seen.size else ()
    lost = [name for name, ok in zip(record.trackers, seen, strict=False) if not ok]
    return {
        "stamp": float(record.stamp[i]),
        "frame": _number(record, "frame", i),
        "state": record.state[i],
        "error_px": _finite(_largest(record.error[i])),
        "step_deg": _finite(np.rad2deg(_largest(record.command[i]))),
        "lost": lost,
        "gate_stopped": _number(record, "gate_stopped", i),
        "gate_dropped": _number(record, "gate_dropped", i),
        "gate_at_rest": _number(record, "gate_at_rest", i),
    }


def lines(record: RunRecord, again: Rerun) -> list[str]:
    """The story as text."""
    verdict = f"{record.outcome} ({record.reason})" if record.reason else record.outcome
    told = [f"{record.name or record.scenario.title}: {verdict}, {record.ticks} ticks"]
    told += [f"  {record.message}"] if record.message else []
    told += ["", "    time   frame  state     error px  step deg  gate      lost"]
    events = sorted(record.events, key=lambda event: float(event["stamp"]))
    for i in _shown(record):
        while events and float(events[0]["stamp"]) < record.stamp[i]:
            told.append(_event_line(events.pop(0)))
        told.append(_tick_line(moment(record, i)))
    told += [_event_line(event) for event in events]
    return [*told, "", *_verdict(again, record)]


def _verdict(again: Rerun, record: RunRecord) -> list[str]:
    if again.why_not:
        return [f"The servo was not run again: {again.why_not}."]
    if again.different:
        i = again.different[0]
        first = f"the first at {record.stamp[i]:.3f} s (tick {i})"
        return [f"The servo was run again: {len(again.different)} of {again.ticks} steps differ, {first}."]
    told = f"The servo was run again on what it saw: all {again.ticks} steps are the same to the bit."
    stops = [f"{state} at {record.stamp[i]:.3f} s" for i, state in again.outside]
    return [told, *([f"Ended from outside of the servo: {', '.join(stops)}."] if stops else [])]


def _event_line(event: Any) -> str:
    reason = f" ({event['reason']})" if event.get("reason") else ""
    message = f": {event['message']}" if event.get("message") else ""
    return f"{float(event['stamp']):8.3f}         * {event['kind']}: {event['text']}{reason}{message}"


def _tick_line(tick: dict[str, Any]) -> str:
    frame = "-" if tick["frame"] is None else f"{tick['frame']:.0f}"
    error = "-" if tick["error_px"] is None else f"{tick['error_px']:.2f}"
    step = f"{tick['step_deg']:.3f}" if tick["step_deg"] else "-"
    gate = "" if tick["gate_stopped"] is None else "stopped" if tick["gate_stopped"] else "open"
    if tick["gate_dropped"]:
        gate += f" -{tick['gate_dropped']:.0f}"
    return (
        f"{tick['stamp']:8.3f} {frame:>7}  {tick['state']:<9} {error:>8}  {step:>8}  {gate:<8}  "
        f"{', '.join(tick['lost'])}"
    ).rstrip()


def _shown(record: RunRecord) -> list[int]:
    """The ticks worth a line: changes of state, one in `EVERY`, and the last ones."""
    state, count = record.state, len(record.state)
    changes = {i for i in range(1, count) if state[i] != state[i - 1]}
    return sorted({*range(0, count, EVERY), *changes, *range(max(count - LAST, 0), count)})


def _write(record: RunRecord, folder: Path) -> None:
    """STEM.png and STEM.csv, a row for each tick."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / f"{record.stem}.csv").open("w", newline="", encoding="utf-8") as file:
            rows = [moment(record, i) for i in range(record.ticks)]
            table = csv.DictWriter(file, fieldnames=[*(rows[0] if rows else {"stamp": 0.0}), "q_deg"])
            table.writeheader()
            for i, row in enumerate(rows):
                q = " ".join(f"{value:.4f}" for value in np.rad2deg(record.q[i]))
                table.writerow(row | {"lost": " ".join(row["lost"]), "q_deg": q})
    except OSError as error:
        raise BadInput(f"cannot write there: {error.strerror or error}", str(folder)) from None
    plot(record, folder / f"{record.stem}.png")


def _number(record: RunRecord, series: str, i: int) -> float | None:
    values = record.series.get(series)
    return None if values is None else _finite(float(values[i]))


def _largest(values: Array) -> float:
    seen = np.abs(values[np.isfinite(values)])
    return float(seen.max()) if seen.size else math.nan


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
