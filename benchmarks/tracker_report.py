"""The benchmark's tables: CSV for machines, Markdown for people."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tracker_score as score
from tracker_cases import CASES, SIDES
from tracker_follow import Track
from tracker_speed import COUNTS, SPEEDS, Load

FRAME_COLUMNS = "tracker,size_px,sequence,photo,frame,visible,status,error_px,score,u,v,cpu_us".split(",")
SEQUENCE_COLUMNS = (
    "tracker,case,size_px,sequence,photo,frames,success_1px,success_2px,median_px,refused".split(",")
)
SPEED_COLUMNS = "tracker,speed_px_per_frame,trackers,cpu_ms_per_frame,success_1px".split(",")


def select(
    tracks: Sequence[Track], tracker: str, cases: Sequence[str], sides: Sequence[int] = SIDES
) -> list[Track]:
    """The tracks of one tracker in some cases and sizes."""
    return [t for t in tracks if t.tracker == tracker and t.case in cases and t.side in sides]


def about(kind: str) -> list[str]:
    return [c.name for c in CASES if c.about == kind]


def percent(value: float) -> str:
    return "" if np.isnan(value) else f"{100 * value:.1f}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def success_table(tracks: Sequence[Track], trackers: Sequence[str]) -> str:
    """Per case and size: success at 1 and 2 px [%] and the median error [px] of each tracker."""
    rows = []
    for case in (c for c in CASES if c.about == "success"):
        for side in SIDES:
            cells = []
            for tracker in trackers:
                chosen = select(tracks, tracker, [case.name], [side])
                if not chosen:
                    cells.append("")
                    continue
                one, two = (percent(score.success(chosen, limit)) for limit in (1.0, 2.0))
                cells.append(f"{one} / {two} / {score.median_error(chosen):.3f}")
            if any(cells):
                rows.append([case.name, str(side), *cells])
    return markdown(["case", "px", *trackers], rows)


def jitter_table(tracks: Sequence[Track], trackers: Sequence[str]) -> str:
    rows = []
    for tracker in trackers:
        values = [score.jitter(select(tracks, tracker, about("jitter"), [side])) for side in SIDES]
        if not all(np.isnan(values)):
            rows.append([tracker, *(f"{v:.4f}" for v in values)])
    limits = [[t.limit for t in tracks if t.side == side and not np.isnan(t.limit)] for side in SIDES]
    rows.append(["limit of a shift (Cramer-Rao)", *(f"{np.mean(x):.4f}" if x else "" for x in limits)])
    return markdown(["tracker", *(f"{side} px" for side in SIDES)], rows)


def loss_of(tracks: Sequence[Track], tracker: str) -> score.LossFigures:
    losses = select(tracks, tracker, about("loss"))
    return score.loss_figures(losses, select(tracks, tracker, about("success") + about("jitter")))


def loss_table(tracks: Sequence[Track], trackers: Sequence[str]) -> str:
    rows = []
    for tracker in trackers:
        f = loss_of(tracks, tracker)
        mine = [t for t in tracks if t.tracker == tracker]
        *_, area = score.roc(*score.judged(mine))
        seen = [x for x in f.latencies if x >= 0]
        late = f"{np.median(seen):.0f} / {max(seen)}" if seen else ""
        never = sum(x < 0 for x in f.latencies)
        rows.append([
            tracker, percent(f.flagged), str(f.bad), late, str(never), f"{f.false_per_1000:.2f}", str(f.good),
            percent(f.refound), str(f.returns), f"{area:.4f}",
        ])  # fmt: skip
    head = ["tracker", "flagged %", "of bad frames", "latency median / max", "never flagged"]
    more = ["false per 1000", "of good frames", "found again %", "of returns", "AUC of score"]
    return markdown([*head, *more], rows)


def speed_table(loads: Sequence[Load], trackers: Sequence[str], base: str) -> str:
    """CPU per frame [ms], as a ratio to `base`, and the share within 1 px."""
    rows = []
    for tracker in trackers:
        row = [tracker]
        for speed in SPEEDS:
            for count in COUNTS:
                mine = [x for x in loads if (x.tracker, x.speed, x.count) == (tracker, speed, count)]
                other = [x for x in loads if (x.tracker, x.speed, x.count) == (base, speed, count)]
                ratio = f" (x{mine[0].mean_ms / other[0].mean_ms:.2f})" if mine and other else ""
                row.append(f"{mine[0].mean_ms:.2f}{ratio} {percent(mine[0].success)}%" if mine else "")
        rows.append(row)
    head = [f"{count} at {speed:g} px" for speed in SPEEDS for count in COUNTS]
    return markdown(["tracker", *head], rows)


def write_csv(folder: Path, tracks: Sequence[Track], loads: Sequence[Load]) -> None:
    """One file of frames per case, one line per sequence in `sequences.csv`, and `speed.csv`."""
    frames = folder / "frames"
    frames.mkdir(parents=True, exist_ok=True)
    for case in dict.fromkeys(t.case for t in tracks):
        with (frames / f"{case}.csv").open("w", newline="") as file:
            out = csv.writer(file)
            out.writerow(FRAME_COLUMNS)
            for t in (t for t in tracks if t.case == case):
                for i in range(len(t.ok)):
                    out.writerow([
                        t.tracker, t.side, t.number, t.photo, i + 1, f"{t.visible[i]:.3f}",
                        "ok" if t.ok[i] else "lost", f"{t.error[i]:.4f}", f"{t.score[i]:.4f}",
                        f"{t.uv[i, 0]:.3f}", f"{t.uv[i, 1]:.3f}", f"{1e6 * t.cpu[i]:.0f}",
                    ])  # fmt: skip
    with (folder / "sequences.csv").open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(SEQUENCE_COLUMNS)
        for t in tracks:
            figures = score.success([t], 1), score.success([t], 2), score.median_error([t])
            written = [f"{x:.4f}" for x in figures]
            out.writerow([t.tracker, t.case, t.side, t.number, t.photo, len(t.ok), *written, t.refused])
    if loads:
        with (folder / "speed.csv").open("w", newline="") as file:
            out = csv.writer(file)
            out.writerow(SPEED_COLUMNS)
            for x in loads:
                out.writerow([x.tracker, x.speed, x.count, f"{x.mean_ms:.3f}", f"{x.success:.4f}"])
