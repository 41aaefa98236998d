"""Runs experiments one after the other, shows how far they are, and writes what they found."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from vita.errors import BadInput
from vita.experiments.base import EXPERIMENTS, Experiment, Report, experiment_of
from vita.experiments.progress import JobProgress
from vita.experiments.report import words, write
from vita.experiments.spread import results_of

ALL = "all"
OUT = Path("out/experiments")


@dataclass(frozen=True)
class Request:
    """What the command line asks for."""

    names: Sequence[str]
    quick: bool = False
    workers: int | None = None
    """None for as many as there are cores."""
    scheduler: str = ""
    out: Path = OUT
    seed: int = 0


def run_experiments(request: Request) -> int:
    """Run and report each; returns the exit code: 1 when a figure to reach was missed."""
    from vita.experiments import all as every  # noqa: F401 - importing it registers them

    chosen = _chosen(request.names)
    missed, done = False, []
    try:
        for experiment in chosen:
            start = time.monotonic()
            report = run_one(experiment, request, sys.stderr)
            files = write(experiment, report, request.out / experiment.name)
            print(f"# {experiment.title}\n\n{words(report)}")
            took = time.monotonic() - start
            print(f"{len(files)} files in {request.out / experiment.name} after {took:.1f} s\n", flush=True)
            missed |= not all(check.met for check in report.checks)
            done.append(experiment.name)
    except KeyboardInterrupt:
        finished = f"done and written: {', '.join(done)}" if done else "nothing was finished"
        print(f"vita: stopped; {finished}", file=sys.stderr)
        raise
    return 1 if missed else 0


def run_one(experiment: Experiment, request: Request, stream: TextIO | None = None) -> Report:
    """The report of one experiment, with its progress on `stream`."""
    jobs = experiment.jobs(request.quick, request.seed)
    progress = JobProgress(experiment.name, len(jobs), stream)
    workers = request.workers if request.workers is not None else os.cpu_count() or 1
    try:
        results = results_of(
            jobs, workers, request.scheduler, lambda count, job: progress.update(count, job.label)
        )
    finally:
        progress.close()
    return experiment.report(jobs, results, request.quick)


def listing() -> str:
    """The experiments with their questions, for `--list`."""
    from vita.experiments import all as every  # noqa: F401 - importing it registers them

    width = max(map(len, EXPERIMENTS), default=0)
    return "\n".join(f"{name:{width}}  {e.doc}" for name, e in EXPERIMENTS.items())


def _chosen(names: Sequence[str]) -> list[Experiment]:
    """The experiments of these names, each once; raises `UnknownName` with the choices."""
    if not names:
        raise BadInput(f"name an experiment, or all. Choices: {', '.join(EXPERIMENTS)}, {ALL}.")
    if ALL in names:
        names = [*(name for name in names if name != ALL), *EXPERIMENTS]
    return [experiment_of(name) for name in dict.fromkeys(names)]
