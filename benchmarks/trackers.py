"""Trackers against exact ground truth, vita's beside OpenCV's, on photographs.

    python benchmarks/trackers.py [--quick] [--workers 2] [--out DIR] [--check]

A photographed card moves over another photograph, 640 x 480 pixels: 1 to 12 px a frame with
perspective, blur, changing light, noise, something in front, out of the view and back, with regions
of 30, 60 and 100 px. Every tracker is started once by a click in the first frame and never helped.
Prints tables and a verdict; see docs/trackers.md for what the figures mean.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import tracker_plots
import tracker_report as report
from tracker_cases import CASES, SIDES, shoot
from tracker_follow import Track, follow_all
from tracker_photos import Photo, load_photos
from tracker_rivals import OPENCV, SLOW, Maker, makers
from tracker_speed import COUNTS, SPEEDS, Load, all_loads
from tracker_verdict import verdict

from vita.errors import BadInput, UnknownName, VitaError


@dataclass(frozen=True)
class Plan:
    """How much is done."""

    sequences: int
    """Per case and size."""
    more: int
    """Times as many for `MORE`, whose figures hang on few numbers."""
    frames: int
    """Of a sequence, where the case does not need its own number."""
    slow_sequences: int
    """Per case for trackers that take long; they get regions of `SLOW_SIDE` only."""
    slow_cases: tuple[str, ...]
    speed_frames: int
    speed_repeats: int


MORE = tuple(c.name for c in CASES if c.about != "success")
FULL = Plan(10, 1, 80, 2, tuple(c.name for c in CASES), 50, 3)
QUICK = Plan(1, 2, 22, 1, ("move3", "light", "away"), 9, 2)
SLOW_SIDE = 60


@dataclass(frozen=True)
class Job:
    """One sequence to be made and followed, in whichever process."""

    case: str
    side: int
    number: int
    seed: int
    frames: int
    trackers: tuple[str, ...]
    photos: Path | None


_photos: dict[Path | None, list[Photo]] = {}


def run(job: Job) -> list[Track]:
    """Make the frames once and let all trackers see them."""
    cv2.setNumThreads(1)
    if job.photos not in _photos:
        _photos[job.photos] = load_photos(job.photos)
    case = next(c for c in CASES if c.name == job.case)
    shot = shoot(case, job.side, job.number, _photos[job.photos], job.seed, job.frames)
    named = makers()
    return follow_all({name: named[name] for name in job.trackers}, shot, shot.sequence)


def jobs_of(
    plan: Plan, cases: Sequence[str], trackers: Sequence[str], seed: int, photos: Path | None
) -> list[Job]:
    """Every sequence that is to be made, and who is to follow it."""
    jobs = []
    for case in cases:
        for side in SIDES:
            for number in range(plan.sequences * (plan.more if case in MORE else 1)):
                slow_too = case in plan.slow_cases and side == SLOW_SIDE and number < plan.slow_sequences
                given = tuple(t for t in trackers if slow_too or t not in SLOW)
                jobs.append(Job(case, side, number, seed, plan.frames, given, photos))
    return jobs


class Progress:
    """A bar on stderr, only where people look at it."""

    def __init__(self, total: int, what: str) -> None:
        self._total, self._what, self._done, self._began = total, what, 0, time.monotonic()
        self._shown = sys.stderr.isatty()

    def tick(self) -> None:
        self._done += 1
        if not self._shown:
            return
        share = self._done / self._total
        left = (time.monotonic() - self._began) * (1 / share - 1)
        text = f"\r{self._what} [{'#' * round(30 * share):30}] {share:4.0%}, {left:3.0f} s left "
        end = "\n" if self._done == self._total else ""
        print(text, end=end, file=sys.stderr, flush=True)


def follow_jobs(jobs: list[Job], workers: int) -> list[Track]:
    progress = Progress(len(jobs), "sequences")
    tracks: list[Track] = []
    if workers == 1:
        for job in jobs:
            tracks += run(job)
            progress.tick()
        return tracks
    # Ctrl-C reaches the whole group of processes: only this one answers, by ending the others.
    deaf = signal.signal, (signal.SIGINT, signal.SIG_IGN)
    with multiprocessing.get_context("spawn").Pool(workers, *deaf) as pool:
        for done in pool.imap(run, jobs):
            tracks += done
            progress.tick()
    return tracks


def arguments(words: Sequence[str] | None) -> argparse.Namespace:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    add = parser.add_argument
    add("--quick", action="store_true", help="fewer and shorter sequences: a minute instead of ten")
    add("--only", nargs="+", metavar="CASE", help=f"of {', '.join(c.name for c in CASES)}, speed")
    add("--trackers", nargs="+", metavar="NAME", help=f"of {', '.join(makers())}")
    add("--sequences", type=int, metavar="N", help=f"sequences per case and size (default {FULL.sequences})")
    add("--seed", type=int, default=0, help="other seeds are other sequences (default 0)")
    add("--photos", type=Path, metavar="DIR", help="your own pictures as textures")
    add("--workers", type=int, default=1, metavar="N", help="processes (default 1)")
    add("--out", type=Path, metavar="DIR", help="write CSV, a report in Markdown and plots there")
    add("--check", action="store_true", help="exit code 1 when a figure is missed")
    return parser.parse_args(words)


def _chosen(
    what: str, given: Sequence[str] | None, choices: Sequence[str], usual: Sequence[str]
) -> list[str]:
    for name in given or ():
        if name not in choices:
            raise UnknownName(what, name, choices)
    return list(dict.fromkeys(given or usual))


def main(words: Sequence[str] | None = None) -> int:
    options = arguments(words)
    try:
        return benchmark(options)
    except VitaError as problem:
        print(f"trackers: {problem}", file=sys.stderr)
        return problem.exit_code
    except KeyboardInterrupt:
        print("\ntrackers: stopped", file=sys.stderr)
        return 130


def benchmark(options: argparse.Namespace) -> int:
    began = time.monotonic()
    plan = QUICK if options.quick else FULL
    if options.sequences is not None:
        if options.sequences < 1:
            raise BadInput("expected a number of sequences above 0", "--sequences")
        plan = replace(plan, sequences=options.sequences)
    if options.workers < 1:
        raise BadInput("expected a number of processes above 0", "--workers")
    names = [c.name for c in CASES]
    only = _chosen("case", options.only, [*names, "speed"], [*names, "speed"])
    named = makers()
    trackers = _chosen("tracker", options.trackers, list(named), ["auto", *OPENCV])
    photos = load_photos(options.photos)
    jobs = jobs_of(plan, [c for c in only if c != "speed"], trackers, options.seed, options.photos)
    tracks = follow_jobs(jobs, min(options.workers, max(1, len(jobs))))
    loads: list[Load] = []
    if "speed" in only:
        racing: dict[str, Maker] = {t: named[t] for t in trackers if not (options.quick and t in SLOW)}
        progress = Progress(len(racing) * len(SPEEDS) * len(COUNTS), "speed    ")
        loads = all_loads(racing, photos, options.seed, plan.speed_frames, plan.speed_repeats, progress.tick)
    text = written(tracks, loads, trackers)
    judged = [t for t in trackers if t not in OPENCV]
    lines = verdict(tracks, loads, judged[0]) if judged else []
    if lines:
        rows = [[x.what, x.wanted, x.shown if x.measured else "", x.word] for x in lines]
        table = report.markdown(["figure", "wanted", "measured", "reached"], rows)
        text += f"\n\n## Verdict on {judged[0]}\n\n{table}"
    took = f"{time.monotonic() - began:.0f} s, {os.cpu_count()} cores"
    text += f"\n\nSeed {options.seed}, {len(jobs)} sequences, {len(photos)} photographs, {took}."
    print(text)
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        report.write_csv(options.out, tracks, loads)
        (options.out / "report.md").write_text(f"# Tracker benchmark\n\n{text}\n")
        if tracks:
            tracker_plots.plot(options.out / "trackers.png", tracks, trackers)
    missed = [x for x in lines if x.measured and not x.reached]
    return 1 if options.check and missed else 0


def written(tracks: list[Track], loads: list[Load], trackers: Sequence[str]) -> str:
    parts = []
    if any(t.case in report.about("success") for t in tracks):
        title = "## Success [%] at 1 px / at 2 px / median error [px]"
        parts.append(f"{title}\n\n{report.success_table(tracks, trackers)}")
    if any(t.case in report.about("jitter") for t in tracks):
        parts.append(f"## Static jitter [px]\n\n{report.jitter_table(tracks, trackers)}")
    if tracks:
        parts.append(f"## Loss\n\n{report.loss_table(tracks, trackers)}")
    if loads:
        title = "## CPU time a frame [ms], as a ratio to cv-klt, and share within 1 px"
        parts.append(f"{title}\n\n{report.speed_table(loads, trackers, 'cv-klt')}")
    refused = [t for t in tracks if t.refused]
    if refused:
        places = [
            f"- {t.tracker}, {t.case} {t.side} px, {t.photo} ({t.number}): {t.refused}" for t in refused
        ]
        parts.append("## Clicks refused, counted as failures\n\n" + "\n".join(places))
    return "\n\n".join(parts)


if __name__ == "__main__":
    sys.exit(main())
