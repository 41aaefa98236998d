"""Small experiments of the tests, in a module of their own: worker processes import them by name."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from typing import Any

from vita.experiments.base import Check, Experiment, Job, Report, Table


def squared(number: int) -> tuple[int, int]:
    """The square, and which process has found it."""
    return number**2, os.getpid()


def slow(seconds: float) -> None:
    time.sleep(seconds)


def broken() -> None:
    raise ValueError("this job is broken")


def vanish() -> None:
    """What the system does to a process when memory runs out."""
    os.kill(os.getpid(), signal.SIGKILL)


def squares(count: int) -> list[Job]:
    return [Job(f"square of {i}", squared, {"number": i}) for i in range(count)]


class Squares(Experiment):
    """Its report has one figure to reach, which the largest square may miss."""

    name = "squares"
    title = "Squares"
    doc = "How large do squares get?"
    most = 1000.0

    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        return squares(3 if quick else 6)

    def report(self, jobs: Sequence[Job], results: Sequence[Any], quick: bool) -> Report:
        rows = [(job.arguments["number"], result[0]) for job, result in zip(jobs, results, strict=True)]
        table = Table("Squares", ("number", "square"), rows)
        check = Check("largest square", rows[-1][1], most=self.most)
        return Report("Squares grow.", [table], {"squares": table}, checks=[check])


class TooLarge(Squares):
    name = "too-large"
    most = 3.0


class Interrupted(Squares):
    """Somebody presses Ctrl-C when it is to report."""

    name = "interrupted"

    def report(self, jobs: Sequence[Job], results: Sequence[Any], quick: bool) -> Report:
        raise KeyboardInterrupt


class Sleepers(Squares):
    name = "sleepers"

    def jobs(self, quick: bool, seed: int) -> Sequence[Job]:
        return [Job("a long sleep", slow, {"seconds": 60.0})] * 2
